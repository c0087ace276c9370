// The options of a session that `candela stream` and `candela bench` share.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/limits.h"

namespace candela {

inline constexpr v1::Range<double> kSeconds{0.001, 86400};
inline constexpr v1::Range<double> kFps{0.001, 100000};

void add_lookahead_option(CLI::App& app, const std::string& section, uint32_t& frames);
void add_encoding_option(CLI::App& app, const std::string& section, v1::Encoding& encoding,
                         const std::string& help);
void add_timeout_option(CLI::App& app, const std::string& section, absl::Duration& timeout);

}  // namespace candela
