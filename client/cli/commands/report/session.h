// The server under measurement, shared by all measurements of a
// report: rendering, tiers, curves and progress.
#pragma once

#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/cli/terminal.h"
#include "client/connection.h"
#include "client/image/image.h"

namespace candela {

using Json = nlohmann::ordered_json;

// A JSON number, or "inf", "-inf" or "nan", which JSON has no numbers for.
Json json_number(double value);

// A measurement's options in addition to the picture.
struct FrameWishes {
  bool verify = false;
  bool error_map = false;
  std::optional<v1::ExposureState> previous = std::nullopt;
};

// Used by one thread. The connection and the progress must outlive it.
class ReportSession {
 public:
  ReportSession(const Connection& server, v1::GetServerInfoResponse info, Progress& progress);

  const v1::GetServerInfoResponse& info() const { return info_; }
  std::vector<std::string> tiers() const;
  bool has_tier(const std::string& name) const;
  // The tier that promises the bounds of docs/pipeline.md: "standard", or
  // the server's first tier if it has no "standard".
  std::string bounded_tier() const;
  std::string most_accurate_tier() const;  // "reference" if the server has it, else bounded_tier()
  // The curve of that name, if the server has it.
  std::optional<v1::ToneCurve> curve(const std::string& word) const;

  // Default settings at `tier`.
  static v1::Settings settings(const std::string& tier);

  // `image` is kRgba16f or kRgba32f. Adds its chromaticities to the settings.
  absl::StatusOr<RenderResult> render(v1::Settings settings, const Image& image,
                                      const FrameWishes& wishes = {}) const;

  const Connection& server() const { return server_; }

  void show(const std::string& what) const { progress_.show(what); }

 private:
  const Connection& server_;
  const v1::GetServerInfoResponse info_;
  Progress& progress_;
};

using Stages = google::protobuf::RepeatedPtrField<v1::StageTime>;

// Device time is the time of all stages except the queue and the verification.
bool is_device_stage(const v1::StageTime& stage);
double device_ms(const Stages& stages);

// The size of a result in pixels, and component `k` of its pixel `i`; codes are 0 .. 1.
size_t pixel_count(const RenderResult& result);
float component(const RenderResult& result, size_t i, size_t k);

// The times of several frames or bakes, and their spread.

double ms_since(std::chrono::steady_clock::time_point begin);

// Interpolates linearly between neighbouring values; `values` is not empty.
double quantile(std::vector<double> values, double q);

// {p10, median, p90} of docs/report/format.md.
Json spread(const std::vector<double>& values);

// The times of each device stage over several runs.
class StageTimes {
 public:
  void add(const Stages& stages);

  // Rows of `name` and `ms`, in execution order.
  Json json() const;

 private:
  std::vector<std::pair<std::string, std::vector<double>>> stages_;
};

}  // namespace candela
