#include "server/render/reference/reference_frame.h"

#include <ImathMatrix.h>
#include <ImathVec.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "server/base/process.h"
#include "server/base/slices.h"
#include "server/render/color/aces.h"
#include "server/render/color/aces2.h"

namespace candela {
namespace {

// The costliest curve takes some microseconds a texel, so this takes a few milliseconds.
constexpr uint32_t kSpan = 1024;

// The spans of some rows that are left to do.
struct Part {
  uint64_t next;
  uint64_t last;
};

}  // namespace

uint32_t row_parts(uint32_t height) {
  static const uint32_t cpus = usable_cpus();  // it reads files
  return std::clamp<uint32_t>(cpus, 1, height);
}

void for_row_parts(uint32_t width, uint32_t height, uint32_t parts,
                   const std::function<void(const RowSpan& span, uint32_t part)>& work) {
  const uint64_t spans_a_row = (uint64_t{width} + kSpan - 1) / kSpan;
  std::vector<Part> spans_left;
  for (uint64_t i = 0; i < parts; ++i) {
    spans_left.push_back({spans_a_row * (height * i / parts), spans_a_row * (height * (i + 1) / parts)});
  }
  const auto run = [&](uint32_t i, std::chrono::steady_clock::time_point end) {
    Part& part = spans_left[i];
    do {
      const auto y = static_cast<uint32_t>(part.next / spans_a_row);
      const auto first = static_cast<uint32_t>(part.next % spans_a_row) * kSpan;
      work({y, first, std::min(first + kSpan, width)}, i);
      ++part.next;
    } while (part.next < part.last && std::chrono::steady_clock::now() < end);
  };
  const auto left = [](const Part& part) { return part.next < part.last; };
  while (std::any_of(spans_left.begin(), spans_left.end(), left)) {
    checkpoint();
    std::vector<std::jthread> threads;
    for (uint32_t i = 0; i < parts; ++i) {
      if (!left(spans_left[i])) continue;
      try {
        threads.emplace_back(run, i, slice_end());
      } catch (const std::system_error&) {  // the system gives no more threads
        run(i, slice_end());
        break;  // one part takes the slice
      }
    }
  }
}

namespace {

// While it lives, the twins that this thread calls go through checkpoints.
class TwinCheckpoints {
 public:
  TwinCheckpoints() { reference::after_row = checkpoint; }
  ~TwinCheckpoints() { reference::after_row = nullptr; }
};

// Exposed light, cut to the gamut of ACES AP1. Light inside of it keeps its bits.
reference::Rgb cut_to_ap1(const reference::Rgb& light) {
  static constexpr double kFromScene[] = {TABLE_FROM_SCENE_AP1};
  // Imath multiplies row vectors from the left.
  static const Imath::M33d to_ap1 =
      Imath::M33d(kFromScene[0], kFromScene[1], kFromScene[2], kFromScene[3], kFromScene[4], kFromScene[5],
                  kFromScene[6], kFromScene[7], kFromScene[8])
          .transposed();
  static const Imath::M33d from_ap1 = to_ap1.inverse();
  const Imath::V3d ap1 = Imath::V3d(light[0], light[1], light[2]) * to_ap1;
  if (ap1.x >= 0.0 && ap1.y >= 0.0 && ap1.z >= 0.0) return light;
  const Imath::V3d cut =
      Imath::V3d(std::max(ap1.x, 0.0), std::max(ap1.y, 0.0), std::max(ap1.z, 0.0)) * from_ap1;
  return {cut.x, cut.y, cut.z};
}

// aces-2, on an HDR display in its primaries.
std::function<reference::Rgb(const reference::Rgb&)> aces_2_look(const reference::ResolveParams& params) {
  if (params.display == shader::DISPLAY_REC709) return [](const reference::Rgb& c) { return aces_2(c); };
  const Aces2Display display = {params.peak_nits, static_cast<v1::Primaries>(params.limit)};
  if (params.limit == params.display)
    return [display](const reference::Rgb& c) { return aces_2(c, display); };
  return [display](const reference::Rgb& c) -> reference::Rgb {
    static constexpr double kP3InRec2020[] = {0.753833034361720,  0.198597369052618, 0.047569596585662,
                                              0.045743848965358,  0.941777219811693, 0.012478931222948,
                                              -0.001210340354518, 0.017601717301089, 0.983608623053428};
    const reference::Rgb p3 = aces_2(c, display);
    reference::Rgb out{};
    for (size_t i = 0; i < 9; ++i) out[i / 3] += kP3InRec2020[i] * p3[i % 3];
    return out;
  };
}

// aces-1 is computed by OpenColorIO itself, so that the error of the baked table counts. It cuts light where
// every executor does. A client's own table is exact by definition.
std::function<reference::Rgb(const reference::Rgb&)> look_of(const Plan& plan) {
  if (plan.reference.resolve.curve == shader::CURVE_TABLE) {
    return [table = plan.table](const reference::Rgb& c) { return reference::look_up(*table, c); };
  }
  if (plan.reference.resolve.curve == shader::CURVE_ACES_2) return aces_2_look(plan.reference.resolve);
  if (plan.reference.resolve.curve != shader::CURVE_ACES_1) return nullptr;
  return [](const reference::Rgb& exposed) -> reference::Rgb {
    const reference::Rgb c = cut_to_ap1(exposed);
    std::array<float, 3> rgb = {static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])};
    if (!aces_1(rgb).ok()) return {NAN, NAN, NAN};
    return {rgb[0], rgb[1], rgb[2]};
  };
}

reference::Scene ingest_scene(const FrameTextures& textures, const std::optional<reference::Matrix>& matrix,
                              reference::Rounding rounding, reference::BadCounts* bad) {
  const FrameDesc& desc = textures.layout.desc;
  const TwinCheckpoints checkpoints;
  const size_t stride = size_t{textures.layout.pitch} * bytes_per_pixel(desc.format);
  reference::BadCounts counts;
  reference::Scene scene =
      reference::ingest({textures.host_input().mapped(), stride * desc.height}, stride, desc.width,
                        desc.height, static_cast<uint32_t>(desc.format), matrix, rounding, &counts);
  if (bad != nullptr) *bad = counts;
  return scene;
}

}  // namespace

double largest_code(uint32_t format) {
  return format == shader::OUTPUT_RGBA8 ? 255.0 : format == shader::OUTPUT_RGBA16 ? 65535.0 : 0.0;
}

ReferenceFrame::ReferenceFrame(MeteredScene scene, const Plan& plan, uint32_t level_size)
    : metered_(std::move(scene)),
      resolve_(plan.reference.resolve),
      image_(plan.reference.image),
      dither_frame_(plan.reference.dither_frame) {
  if (plan.reference.bloom) {
    const TwinCheckpoints checkpoints;
    reference::BloomSpec bloom = *plan.reference.bloom;
    bloom.level_size = level_size;
    if (bloom.kind != shader::BLOOM_GAUSSIAN) resolve_.level_size = level_size;
    bloom_ = reference::bloom(metered_.scene, bloom, metered_.meter.mean_log2_luminance, &levels_);
  }
  resolve_.look = look_of(plan);
  if (plan.gain) {
    resolve_.gain_code = [gain = plan.gain](const reference::Rgb& c) {
      return std::min(gain->log2_gain(std::max({c[0], c[1], c[2]})) / gain->max_log2(), 1.0);
    };
  }
  light_ = resolve_;
  resize();
}

void ReferenceFrame::resize() {
  const reference::Scene& frame = metered_.scene;
  if (image_ == ImageSize{frame.width, frame.height}) return;
  const TwinCheckpoints checkpoints;
  resized_ = reference::resize(frame, bloom_, levels_, light_, image_.width, image_.height);
  resolve_.bloom = shader::BLOOM_NONE;
}

void ReferenceFrame::unround(const FrameTextures& textures, const Plan& plan) {
  metered_.scene = {};  // its memory is needed
  resized_.reset();
  metered_.scene = ingest_scene(
      textures, plan.reference.matrix,
      plan.reference.unrounded ? reference::Rounding::kNone : reference::Rounding::kHalfUnlessNegative,
      nullptr);
  resize();
}

reference::Rgb ReferenceFrame::bloom_light(uint32_t x, uint32_t y) const {
  reference::Rgb light = bloom_.at(x, y);
  for (double& component : light) component /= levels_;
  return light;
}

std::vector<std::array<double, 4>> ReferenceFrame::row(const RowSpan& span) const {
  return reference::resolve_row(scene(), bloom_, levels_, resolve_, span.y, span.first, span.last);
}

uint64_t ReferenceFrame::cut_components() const {
  uint64_t cut = 0;
  for (uint32_t y = 0; y < height(); ++y) {
    cut += reference::cut_components(scene(), bloom_, levels_, resolve_, y);
    checkpoint();
  }
  return cut;
}

ShownLight ReferenceFrame::shown_light() const {
  ShownLight light;
  double sum = 0.0;
  for (uint32_t y = 0; y < height(); ++y) {
    for (const reference::Rgb& c : reference::light_row(scene(), bloom_, levels_, resolve_, y)) {
      const double largest = std::max({c[0], c[1], c[2]});
      light.largest = std::max(light.largest, largest);
      sum += largest;
    }
    checkpoint();
  }
  light.mean = sum / (double{1} * width() * height());
  return light;
}

double ReferenceFrame::code(double value, double largest, uint32_t x, uint32_t y, size_t k) const {
  if (!dither_frame_) return value * largest;
  return std::clamp(value * largest + reference::dither_noise(x, y, *dither_frame_, k), 0.0, largest);
}

MeteredScene meter_scene(const FrameTextures& textures, const std::optional<reference::Matrix>& matrix,
                         const reference::MeterParams& params, reference::Rounding rounding) {
  MeteredScene metered;
  metered.scene = ingest_scene(textures, matrix, rounding, &metered.bad);
  const TwinCheckpoints checkpoints;
  metered.meter = reference::meter(metered.scene, params);
  return metered;
}

}  // namespace candela
