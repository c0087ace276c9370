#include "tests/support/simulated/frame_maker.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>

#include "absl/status/status.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/environment/environment.h"
#include "server/render/environment/view.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/texture_layout.h"
#include "tests/support/simulated/chance.h"

namespace candela::testing {
namespace {

// From -8 to 8, in steps that a float holds.
double ev_of(uint64_t hash) { return std::ldexp(static_cast<double>(hash >> 40), -20) - 8.0; }

// The words of `bytes` in turn; the last one is filled up with zeros.
void each_word(std::span<const std::byte> bytes, absl::FunctionRef<void(uint64_t)> take) {
  for (size_t i = 0; i < bytes.size(); i += sizeof(uint64_t)) {
    uint64_t word = 0;
    std::memcpy(&word, &bytes[i], std::min(sizeof word, bytes.size() - i));
    take(word);
  }
}

uint64_t hash_of(const Settings& settings) {
  const std::string message = settings->SerializeAsString();
  uint64_t hash = message.size();
  each_word(std::as_bytes(std::span(message)), [&](uint64_t word) { hash = mixed(hash ^ word); });
  return hash;
}

DeviceSummary simulated_device(uint64_t bytes) {
  DeviceSummary device;
  device.name = "simulated";
  device.unified_memory = true;
  device.max_allocation_bytes = bytes;
  return device;
}

absl::Status lost_error() { return absl::UnavailableError("simulated frame maker (device lost)"); }

SimulatedScene scene_in(FrameMemory& memory) {
  return {memory.desc(), [&memory](uint32_t y) { return std::span<const std::byte>(memory.input_row(y)); }};
}

}  // namespace

SimulatedScene::SimulatedScene(const FrameDesc& desc, Row row) : desc_(desc) {
  uint64_t any = 0;
  std::optional<uint64_t> first;
  for (uint32_t y = 0; y < desc.height; ++y) {
    each_word(row(y), [&](uint64_t word) {
      if (!first) first = word;
      any |= word;
      if (word == ~uint64_t{0}) ++stats_.nan_components;
      hash_ = mixed(hash_ ^ word);
    });
  }
  if (any == 0) {
    stats_.mean_log2_luminance = kNothingMetered;
    return;
  }
  stats_.mean_log2_luminance = ev_of(hash_);
  stats_.min_luminance = stats_.max_luminance = std::exp2(static_cast<float>(stats_.mean_log2_luminance));
  stats_.metered_weight = uint64_t{desc.width} * desc.height;
  for (size_t i = 0; i < stats_.print.size(); ++i) {
    stats_.print[i] = static_cast<float>(ev_of(mixed(*first + i)));
  }
}

SimulatedScene::SimulatedScene(const FrameDesc& desc, std::span<const std::byte> pixels)
    : SimulatedScene(desc,
                     [&](uint32_t y) { return pixels.subspan(y * desc.row_bytes(), desc.row_bytes()); }) {}

absl::Status SimulatedScene::check(const Settings& settings) const {
  if (stats_.nan_components == 0 || settings->bad_values() != v1::BAD_VALUES_REJECT) return absl::OkStatus();
  return absl::InvalidArgumentError("a pixel of the frame is bad, and bad_values is REJECT");
}

std::vector<std::byte> SimulatedScene::image(const Settings& settings, uint64_t sequence,
                                             double exposure) const {
  const std::array<uint64_t, 4> words = {std::bit_cast<uint64_t>(exposure), sequence, hash_,
                                         hash_of(settings)};
  const auto bytes = std::as_bytes(std::span(words));
  const ImageSize size = image_size(*settings, desc_);
  std::vector<std::byte> image(size_t{size.width} * size.height * bytes_per_pixel(settings->output_format()));
  for (size_t i = 0; i < image.size(); ++i) image[i] = bytes[i % bytes.size()];
  return image;
}

std::vector<std::byte> simulated_view(const Environment& environment, const View& view,
                                      const FrameDesc& desc) {
  uint64_t word = 0;
  const auto add = [&word](double number) { word = mixed(word ^ std::bit_cast<uint64_t>(number)); };
  if (environment.radiance) add((*environment.radiance)[0][0]);
  for (const double number : view.camera.rotation) add(number);
  for (const double number : view.camera.position) add(number);
  add(view.camera.fov_deg);
  std::vector<std::byte> pixels(desc.bytes());
  for (size_t i = 0; i < pixels.size(); i += sizeof word) {
    word = mixed(word);
    std::memcpy(&pixels[i], &word, std::min(sizeof word, pixels.size() - i));
  }
  return pixels;
}

SimulatedFrameMaker::SimulatedFrameMaker(uint64_t budget_bytes, Clock& clock)
    : device_(simulated_device(budget_bytes)), pool_(*host_, budget_bytes, clock) {}

absl::StatusOr<FrameMemory> SimulatedFrameMaker::allocate(const FrameDesc& desc, const Settings& settings,
                                                          Verify verify) {
  return FrameMemory::take(pool_, device_, layout_textures(desc, settings), verify);
}

absl::StatusOr<uint64_t> SimulatedFrameMaker::bytes_for(const FrameDesc& desc, const Settings& settings,
                                                        Verify verify) const {
  return FrameMemory::bytes_for(pool_, device_, layout_textures(desc, settings), verify);
}

absl::StatusOr<Metered> SimulatedFrameMaker::meter(FrameMemory& memory, const Settings& settings) {
  FrameTextures& textures = memory.textures();
  CHECK(textures.stage == FrameStage::kTaken);
  if (lost_) return lost_error();
  const SimulatedScene scene = scene_in(memory);
  RETURN_IF_ERROR(scene.check(settings));
  textures.stage = FrameStage::kMetered;
  return Metered{scene.stats()};
}

absl::StatusOr<FrameReport> SimulatedFrameMaker::draw(FrameMemory& memory, const Settings& settings,
                                                      uint64_t sequence, const Metered& metered,
                                                      const Exposed& exposed) {
  FrameTextures& textures = memory.textures();
  CHECK(textures.stage == FrameStage::kMetered);
  FrameReport report = report_of(metered, exposed);
  if (lost_) return lost_error();
  const std::vector<std::byte> image = scene_in(memory).image(settings, sequence, exposed.exposure);
  const uint64_t pitch =
      uint64_t{textures.layout.image_pitch} * bytes_per_pixel(textures.layout.output_format);
  const uint64_t row = memory.output_row(0).size();
  for (uint32_t y = 0; y < memory.image().height; ++y) {
    std::memcpy(textures.host_output().mapped() + y * pitch, &image[y * row], row);
  }
  textures.stage = FrameStage::kDrawn;
  report.tier = device_.name;
  return report;
}

absl::Status SimulatedFrameMaker::prepare_view(Environment&, const BakeQuality&, bool) {
  return lost_ ? lost_error() : absl::OkStatus();
}

absl::Status SimulatedFrameMaker::render_view(Environment& environment, const View& view,
                                              FrameMemory& memory) {
  if (lost_) return lost_error();
  const FrameDesc& desc = memory.desc();
  const std::vector<std::byte> pixels = simulated_view(environment, view, desc);
  for (uint32_t y = 0; y < desc.height; ++y) {
    std::memcpy(memory.input_row(y).data(), &pixels[y * desc.row_bytes()], desc.row_bytes());
  }
  return absl::OkStatus();
}

EnvironmentBaker& SimulatedFrameMaker::baker() const {
  check_failed("a simulated frame maker has environments", __FILE__, __LINE__);
}

}  // namespace candela::testing
