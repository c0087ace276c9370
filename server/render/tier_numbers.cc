#include "server/render/tier_numbers.h"

#include <fcntl.h>
#include <half.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <exception>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/base/option_file.h"
#include "server/render/settings/tiers.h"

namespace candela {

namespace {

constexpr int kTimedFrames = 5;
// Large enough for a time per pixel, and small enough that a frame takes far less than a slice of the render
// thread; the reference takes a hundred times as long. Small first.
struct Size {
  uint32_t width;
  uint32_t height;
  double pixels() const { return static_cast<double>(width) * height; }
};
using Sizes = std::array<Size, 2>;
constexpr Sizes kDeviceSizes = {{{128, 128}, {1024, 512}}};
constexpr Sizes kHostSizes = {{{32, 32}, {128, 64}}};
// Clients choose the settings, so the number of kept entries is limited.
constexpr size_t kMaxKept = 512;
constexpr size_t kMaxCacheBytes = size_t{1} << 20;

const Sizes& sizes_of(const Tier& tier) { return tier.host_reference ? kHostSizes : kDeviceSizes; }

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

absl::StatusOr<FrameMemory> picture(Renderer& renderer, const FrameDesc& desc, const Settings& settings) {
  absl::StatusOr<FrameMemory> memory = renderer.allocate(desc, settings);
  if (!memory.ok()) return memory;
  for (uint32_t y = 0; y < desc.height; ++y) fill(desc, y, memory->input_row(y).data());
  return memory;
}

double device_ms(const FrameReport& report) {
  uint64_t ns = 0;
  for (const StageTime& stage : report.stages) ns += stage.ns;
  return static_cast<double>(ns) * 1e-6;
}

// The median time of a frame of this size. Calls `checkpoint` before each frame.
absl::StatusOr<double> measure_frame(Renderer& renderer, const FrameDesc& desc, const Settings& settings,
                                     const TierBenchmark::Checkpoint& checkpoint) {
  if (absl::Status status = checkpoint(); !status.ok()) return status;
  absl::StatusOr<FrameMemory> memory = picture(renderer, desc, settings);
  if (!memory.ok()) return memory.status();
  std::vector<double> times;
  for (int i = 0; i <= kTimedFrames; ++i) {
    if (absl::Status status = checkpoint(); !status.ok()) return status;
    const absl::StatusOr<FrameReport> report = renderer.render(*memory, settings);
    if (!report.ok()) return report.status();
    if (i > 0) times.push_back(device_ms(*report));  // the first one compiles
  }
  std::nth_element(times.begin(), times.begin() + kTimedFrames / 2, times.end());
  return times[kTimedFrames / 2];
}

// A time for `pixels`, on the line through the two measured ones. Never less than the smaller one's.
double ms_for(double pixels, const Tier& tier, const std::array<double, 2>& ms) {
  const Sizes& sizes = sizes_of(tier);
  const double per_pixel = std::max(ms[1] - ms[0], 0.0) / (sizes[1].pixels() - sizes[0].pixels());
  return ms[0] + per_pixel * std::max(pixels - sizes[0].pixels(), 0.0);
}

// Writes a file of our own, so that a link or a pipe of that name is not followed. Leaves nothing if it
// fails.
bool write_new_file(const std::string& path, const std::string& text) {
  unlink(path.c_str());
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (file < 0) return false;
  size_t written = 0;
  while (written < text.size()) {
    const ssize_t count = ::write(file, text.data() + written, text.size() - written);
    if (count <= 0) break;
    written += static_cast<size_t>(count);
  }
  if (close(file) == 0 && written == text.size()) return true;
  unlink(path.c_str());
  return false;
}

}  // namespace

TierBenchmark::TierBenchmark(std::function<std::shared_ptr<Renderer>()> renderer, std::string device,
                             std::string cache_file)
    : renderer_(std::move(renderer)), device_(std::move(device)), cache_file_(std::move(cache_file)) {
  load();
}

std::string TierBenchmark::key(v1::PixelFormat format, const Settings& settings) const {
  return absl::StrFormat("%s|%s|%s", device_, v1::word_of(format), settings.measurement_key());
}

std::shared_ptr<void> TierBenchmark::take_turn(uint64_t client) {
  absl::MutexLock lock(&mutex_);
  if (!measuring_.insert(client).second) return nullptr;
  return {this, [client](TierBenchmark* benchmark) {
            absl::MutexLock end(&benchmark->mutex_);
            benchmark->measuring_.erase(client);
          }};
}

std::optional<std::vector<TierNumbers>> TierBenchmark::known(const FrameDesc& desc,
                                                             const Settings& settings) const {
  absl::MutexLock lock(&mutex_);
  const auto found = known_.find(key(desc.format, settings));
  if (found == known_.end()) return std::nullopt;
  std::vector<TierNumbers> numbers;
  for (size_t i = 0; i < found->second.size(); ++i) {
    const Tier& tier = tiers()[i];
    numbers.push_back(
        {tier.name, ms_for(static_cast<double>(desc.width) * desc.height, tier, found->second[i])});
  }
  return numbers;
}

std::vector<MeasuredTime> TierBenchmark::measured(const Tier& tier, v1::PixelFormat format,
                                                  const Settings& settings) const {
  absl::MutexLock lock(&mutex_);
  const auto found = known_.find(key(format, settings));
  if (found == known_.end()) return {};
  std::vector<MeasuredTime> times;
  for (size_t i = 0; i < sizes_of(tier).size(); ++i) {
    const Size& size = sizes_of(tier)[i];
    times.push_back({size.width, size.height, found->second[static_cast<size_t>(&tier - tiers().data())][i]});
  }
  return times;
}

absl::Status TierBenchmark::measure(v1::PixelFormat format, const Settings& settings,
                                    const Checkpoint& checkpoint) {
  const std::shared_ptr<Renderer> renderer = renderer_();  // outlives its memory
  Times all;
  for (const Tier& tier : tiers()) {
    std::array<double, 2>& ms = all.emplace_back();
    for (size_t i = 0; i < ms.size(); ++i) {
      const Size& size = sizes_of(tier)[i];
      const absl::StatusOr<double> median = measure_frame(*renderer, {size.width, size.height, format},
                                                          settings.for_measuring(tier), checkpoint);
      if (!median.ok()) return median.status();
      ms[i] = *median;
    }
  }
  std::string text;
  {
    absl::MutexLock lock(&mutex_);
    if (known_.size() >= kMaxKept) known_.clear();
    known_[key(format, settings)] = std::move(all);
    text = to_text();
  }
  save(text);
  return absl::OkStatus();
}

void TierBenchmark::load() {
  if (cache_file_.empty()) return;
  const absl::StatusOr<std::string> text =
      read_option_file("cache-dir", cache_file_, kMaxCacheBytes, Secrecy::kPublic);
  if (!text.ok()) return;
  absl::MutexLock lock(&mutex_);
  try {
    const nlohmann::json kept = nlohmann::json::parse(*text, nullptr, /*allow_exceptions=*/false);
    if (!kept.is_object()) return;
    for (const auto& [name, rows] : kept.items()) {
      Times all;
      for (const Tier& tier : tiers()) {
        const auto& ms = rows.at(tier.name).at("ms");
        all.push_back({ms.at(0).get<double>(), ms.at(1).get<double>()});
      }
      if (known_.size() < kMaxKept) known_[name] = std::move(all);
    }
  } catch (const std::exception&) {  // from nlohmann
    known_.clear();                  // not our file, or another version's
  }
}

std::string TierBenchmark::to_text() const {
  nlohmann::json kept = nlohmann::json::object();
  for (const auto& [name, all] : known_) {
    for (size_t i = 0; i < all.size(); ++i) kept[name][tiers()[i].name]["ms"] = all[i];
  }
  return kept.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

void TierBenchmark::save(const std::string& text) const {
  if (cache_file_.empty()) return;
  namespace fs = std::filesystem;
  std::error_code failed;
  fs::create_directories(fs::path(cache_file_).parent_path(), failed);
  // A device or a pipe in its place is somebody's, and stays.
  const fs::file_type there = fs::symlink_status(cache_file_, failed).type();
  if (there != fs::file_type::not_found && there != fs::file_type::regular) return;
  const std::string temporary = absl::StrFormat("%s.%d", cache_file_, getpid());
  if (!write_new_file(temporary, text)) return;
  fs::rename(temporary, cache_file_, failed);
  if (failed) unlink(temporary.c_str());
}

}  // namespace candela
