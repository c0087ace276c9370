// What all measurements of a report share: the server, what it can do, and where progress is shown.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/cli/files/terminal.h"
#include "client/connection.h"
#include "client/image/image.h"

namespace candela {

using Json = nlohmann::ordered_json;

// A number; one that JSON cannot hold is "inf", "-inf" or "nan".
Json json_number(double value);

// What a frame is rendered for besides its picture.
struct FrameWishes {
  bool verify = false;
  bool error_map = false;
  std::optional<v1::ExposureState> previous = std::nullopt;
};

// Used by one thread; the connection and the progress outlive it.
class ReportSession {
 public:
  ReportSession(const Connection& server, v1::GetServerInfoResponse info, Progress& progress);

  const v1::GetServerInfoResponse& info() const { return info_; }
  std::vector<std::string> tiers() const;
  bool has_tier(const std::string& name) const;
  // The tier that promises the bounds of docs/pipeline.md: "standard", or the first one of a server without.
  std::string bounded_tier() const;
  std::string most_accurate_tier() const;  // "reference" where there is one, else bounded_tier()
  // The server's curve of that name.
  std::optional<v1::ToneCurve> curve(const std::string& word) const;

  // The settings of `tier` with all else at its default.
  static v1::Settings settings(const std::string& tier);

  // `image` is kRgba16f or kRgba32f. Its chromaticities are added to the settings.
  absl::StatusOr<RenderResult> render(v1::Settings settings, const Image& image,
                                      const FrameWishes& wishes = {}) const;

  void show(const std::string& what) const { progress_.show(what); }

 private:
  const Connection& server_;
  const v1::GetServerInfoResponse info_;
  Progress& progress_;
};

// Device time: all stages but the queue and the verification.
bool is_device_stage(const v1::StageTime& stage);
double device_ms(const v1::ResultHeader& header);

}  // namespace candela
