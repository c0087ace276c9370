#include "server/render/tier_numbers.h"

#include <half.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/render/settings/tiers.h"

namespace candela {

namespace {

constexpr int kTimedFrames = 3;
constexpr uint64_t kMaxTimedPixels = uint64_t{8} << 20;
constexpr uint64_t kMaxHostPixels = uint64_t{1}
                                    << 17;  // for the reference, which takes a thousand times as long
constexpr double kErrorMargin = 1.5;
// Odd on both sides, several tiles.
constexpr uint32_t kErrorWidth = 257;
constexpr uint32_t kErrorHeight = 131;
// Clients choose the settings, so the number of kept entries is limited.
constexpr size_t kMaxKept = 1024;

uint32_t hash(uint32_t v) {
  // PCG: M. Jarzynski and M. Olano, "Hash Functions for GPU Rendering", 2020.
  v = v * 747796405u + 2891336453u;
  v = ((v >> ((v >> 28) + 4u)) ^ v) * 277803737u;
  return (v >> 22) ^ v;
}

// A ramp from 2^-9 to 2^5 with noise, and lights up to 1000 on a hundredth of it. Every texel is one of
// RGB9E5, so that all formats hold the same picture.
struct Texel {
  uint32_t exponent;  // scale is 2^(exponent - 24)
  uint32_t mantissa[3];
};

Texel texel(const FrameDesc& desc, uint32_t x, uint32_t y) {
  const uint32_t noise = hash(x + 16411u * y);
  const uint32_t block = hash(x / 5 + 32771u * (y / 5));
  const bool light = block % 100 == 0;
  const uint32_t ramp = 6 + 14 * x / desc.width;
  return {light ? 25 : ramp,
          {128 + noise % 384, 128 + (noise >> 9) % 384, light ? block >> 23 : 128 + (noise >> 18) % 384}};
}

void fill(const FrameDesc& desc, uint32_t y, std::byte* out) {
  for (uint32_t x = 0; x < desc.width; ++x, out += bytes_per_pixel(desc.format)) {
    const Texel t = texel(desc, x, y);
    if (desc.format == v1::PIXEL_FORMAT_RGB9E5) {
      const uint32_t word = t.mantissa[0] | (t.mantissa[1] << 9) | (t.mantissa[2] << 18) | (t.exponent << 27);
      std::memcpy(out, &word, sizeof word);
      continue;
    }
    float values[4] = {0, 0, 0, 1};
    for (int i = 0; i < 3; ++i) {
      values[i] = std::ldexp(static_cast<float>(t.mantissa[i]), static_cast<int>(t.exponent) - 24);
    }
    if (desc.format == v1::PIXEL_FORMAT_RGBA32F) {
      std::memcpy(out, values, sizeof values);
      continue;
    }
    uint16_t halves[4];
    for (int i = 0; i < 4; ++i) halves[i] = imath_float_to_half(values[i]);
    std::memcpy(out, halves, sizeof halves);
  }
}

absl::StatusOr<FrameMemory> picture(Renderer& renderer, const FrameDesc& desc, const Settings& settings,
                                    Verify verify = Verify::kNo) {
  absl::StatusOr<FrameMemory> memory = renderer.allocate(desc, settings, verify);
  if (!memory.ok()) return memory;
  for (uint32_t y = 0; y < desc.height; ++y) fill(desc, y, memory->input_row(y).data());
  return memory;
}

double device_ms(const FrameReport& report) {
  uint64_t ns = 0;
  for (const StageTime& stage : report.stages) ns += stage.ns;
  return static_cast<double>(ns) * 1e-6;
}

// Everything that a frame's time or error depends on.
std::string key_of(const std::string& device, const FrameDesc& desc, const Settings& settings) {
  return absl::StrFormat("%s|%dx%d %s|%s", device, desc.width, desc.height, v1::word_of(desc.format),
                         settings.measurement_key());
}

}  // namespace

TierBenchmark::TierBenchmark(std::function<std::shared_ptr<Renderer>()> renderer, std::string device,
                             std::string cache_file)
    : renderer_(std::move(renderer)), device_(std::move(device)), cache_file_(std::move(cache_file)) {
  load();
}

absl::StatusOr<std::vector<TierNumbers>> TierBenchmark::numbers(const FrameDesc& desc,
                                                                const Settings& settings) {
  const std::string key = key_of(device_, desc, settings);
  if (const auto found = known_.find(key); found != known_.end()) return found->second;
  std::vector<TierNumbers> all;
  for (const Tier& tier : tiers()) {
    absl::StatusOr<TierNumbers> measured = measure(desc, settings.for_measuring(tier, desc));
    if (!measured.ok()) return measured.status();
    all.push_back(*std::move(measured));
  }
  if (known_.size() >= kMaxKept) known_.clear();
  known_[key] = all;
  save();
  return all;
}

absl::StatusOr<TierChoice> TierBenchmark::choose(const FrameDesc& desc, const Settings& settings) {
  const absl::StatusOr<std::vector<TierNumbers>> measured = numbers(desc, settings);
  if (!measured.ok()) return measured.status();
  return choose_tier(*measured, *settings);
}

absl::StatusOr<TierNumbers> TierBenchmark::measure(const FrameDesc& desc, const Settings& settings) {
  const std::shared_ptr<Renderer> renderer = renderer_();  // outlives its memory
  FrameDesc timed = desc;
  const bool host = settings.tier().host_reference;
  const uint64_t most = host ? kMaxHostPixels : kMaxTimedPixels;
  timed.height = static_cast<uint32_t>(std::clamp<uint64_t>(most / desc.width, 1, desc.height));
  absl::StatusOr<FrameMemory> memory = picture(*renderer, timed, settings);
  if (!memory.ok()) return memory.status();
  std::vector<double> times;
  for (int i = 0; i <= kTimedFrames; ++i) {
    const absl::StatusOr<FrameReport> report = renderer->render(*memory, settings);
    if (!report.ok()) return report.status();
    if (i > 0) times.push_back(device_ms(*report));  // the first one compiles
  }
  std::nth_element(times.begin(), times.begin() + kTimedFrames / 2, times.end());

  const FrameDesc small = {std::min(desc.width, kErrorWidth), std::min(desc.height, kErrorHeight),
                           desc.format};
  memory = picture(*renderer, small, settings, Verify::kYes);
  if (!memory.ok()) return memory.status();
  const absl::StatusOr<FrameReport> report = renderer->render(*memory, settings);
  if (!report.ok()) return report.status();
  const double scale = static_cast<double>(desc.height) / timed.height;
  return TierNumbers{
      settings.tier().name, times[kTimedFrames / 2] * scale,
      std::max(report->verification->rounded.max_codes * kErrorMargin, settings.tier().bound_codes)};
}

void TierBenchmark::load() {
  try {
    std::ifstream file(cache_file_);
    const nlohmann::json kept = nlohmann::json::parse(file, nullptr, /*allow_exceptions=*/false);
    if (!kept.is_object()) return;
    for (const auto& [key, rows] : kept.items()) {
      std::vector<TierNumbers> all;
      for (const auto& row : rows) all.push_back({row.at("tier"), row.at("ms"), row.at("max_error_codes")});
      const bool complete =
          std::equal(all.begin(), all.end(), tiers().begin(), tiers().end(),
                     [](const TierNumbers& n, const Tier& tier) { return n.tier == tier.name; });
      if (complete && known_.size() < kMaxKept) known_[key] = std::move(all);
    }
  } catch (const std::exception&) {  // from nlohmann, or from a failed read, as of a folder
    known_.clear();                  // not our file, or an older version's
  }
}

void TierBenchmark::save() const {
  if (cache_file_.empty()) return;
  nlohmann::json kept = nlohmann::json::object();
  for (const auto& [key, all] : known_) {
    for (const TierNumbers& n : all) {
      kept[key].push_back({{"tier", n.tier}, {"ms", n.ms}, {"max_error_codes", n.max_error_codes}});
    }
  }
  namespace fs = std::filesystem;
  std::error_code failed;
  fs::create_directories(fs::path(cache_file_).parent_path(), failed);
  const std::string temporary = absl::StrFormat("%s.%d", cache_file_, getpid());
  {
    std::ofstream file(temporary, std::ios::trunc);
    file << kept.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) << "\n";
    if (!file.flush()) return;
  }
  fs::rename(temporary, cache_file_, failed);
}

}  // namespace candela
