#include "client/cli/commands/report/session.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "absl/time/clock.h"
#include "client/run/picture_frame.h"
#include "client/run/report.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

// Ends the wait for a server that never answers.
constexpr absl::Duration kFrameTimeout = absl::Minutes(10);

}  // namespace

Json json_number(double value) {
  if (std::isfinite(value)) return value;
  return std::isnan(value) ? "nan" : value > 0 ? "inf" : "-inf";
}

ReportSession::ReportSession(const Connection& server, v1::GetServerInfoResponse info, Progress& progress)
    : server_(server), info_(std::move(info)), progress_(progress) {}

std::vector<std::string> ReportSession::tiers() const {
  std::vector<std::string> names;
  for (const v1::Tier& tier : info_.tiers()) names.push_back(tier.name());
  return names;
}

bool ReportSession::has_tier(const std::string& name) const {
  const std::vector<std::string> names = tiers();
  return std::find(names.begin(), names.end(), name) != names.end();
}

std::string ReportSession::bounded_tier() const {
  return has_tier("standard") || info_.tiers().empty() ? "standard" : info_.tiers(0).name();
}

std::string ReportSession::most_accurate_tier() const {
  return has_tier("reference") ? "reference" : bounded_tier();
}

std::optional<v1::ToneCurve> ReportSession::curve(const std::string& word) const {
  for (const int value : info_.curves()) {
    const auto known = static_cast<v1::ToneCurve>(value);
    if (v1::word_of(known) == word) return known;
  }
  return std::nullopt;
}

v1::Settings ReportSession::settings(const std::string& tier) {
  v1::Settings settings;
  settings.set_tier(tier);
  return settings;
}

absl::StatusOr<RenderResult> ReportSession::render(v1::Settings settings, const Image& image,
                                                   const FrameWishes& wishes) const {
  FrameView view = view_of(image);
  view.previous = wishes.previous;
  view.verify = wishes.verify;
  view.error_map = wishes.error_map;
  return server_.render(settings_for(image, settings, {}).settings, view, absl::Now() + kFrameTimeout);
}

bool is_device_stage(const v1::StageTime& stage) {
  return stage.name() != "queue" && stage.name() != "verify";
}

double device_ms(const Stages& stages) {
  double ms = 0;
  for (const v1::StageTime& stage : stages) {
    if (is_device_stage(stage)) ms += ms_of(stage);
  }
  return ms;
}

size_t pixel_count(const RenderResult& result) {
  return size_t{result.header.width()} * result.header.height();
}

float component(const RenderResult& result, size_t i, size_t k) {
  const std::byte* const values = result.data.get();
  if (result.header.format() == v1::OUTPUT_FORMAT_RGBA8) {
    return static_cast<float>(std::to_integer<int>(values[i * 4 + k])) / 255;
  }
  uint16_t bits = 0;
  std::memcpy(&bits, values + (i * 4 + k) * sizeof bits, sizeof bits);
  return result.header.format() == v1::OUTPUT_FORMAT_RGBA16 ? static_cast<float>(bits) / 65535
                                                            : imath_half_to_float(bits);
}

double ms_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const auto below = static_cast<size_t>(at);
  return std::lerp(values[below], values[std::min(below + 1, values.size() - 1)], at - std::floor(at));
}

Json spread(const std::vector<double>& values) {
  return {{"p10", quantile(values, 0.1)}, {"median", quantile(values, 0.5)}, {"p90", quantile(values, 0.9)}};
}

void StageTimes::add(const Stages& stages) {
  for (const v1::StageTime& stage : stages) {
    if (!is_device_stage(stage)) continue;
    auto known = std::find_if(stages_.begin(), stages_.end(),
                              [&stage](const auto& s) { return s.first == stage.name(); });
    if (known == stages_.end()) known = stages_.insert(known, {stage.name(), {}});
    known->second.push_back(ms_of(stage));
  }
}

Json StageTimes::json() const {
  Json rows = Json::array();
  for (const auto& [name, ms] : stages_) rows.push_back({{"name", name}, {"ms", spread(ms)}});
  return rows;
}

}  // namespace candela
