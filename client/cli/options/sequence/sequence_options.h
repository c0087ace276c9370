// The options that choose the frames of a sequence: --range, --missing, --cut-at and --fps.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "client/run/sequence.h"

namespace candela {

inline constexpr char kSequenceSection[] = "Sequence";

// Defines the options; parsing fills `choice`, which outlives the app.
void add_sequence_options(CLI::App& app, const std::string& section, SequenceChoice& choice);

}  // namespace candela
