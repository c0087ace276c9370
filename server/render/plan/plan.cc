#include "server/render/plan/plan.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/render/color/aces.h"
#include "server/render/color/aces2.h"
#include "server/render/color/hdr_signal.h"
#include "server/render/color/portable_math.h"
#include "server/render/plan/lit_area.h"
#include "server/render/settings/hdr_display.h"
#include "server/render/settings/tiers.h"

namespace candela {
namespace {

// A device may flush the square of a smaller knee to 0, and would then divide 0 by 0.
constexpr float kMinKnee = 1e-15f;

// A margin for the rounding errors of a mean and of the value subtracted from it: at most 8 of 2^-24 each.
constexpr float kRoundings = 0x1p-20f;

// If no light of the frame is above this, no texel of bloom level 0 gets any.
float bright_bound(const v1::Bloom& bloom, float threshold) {
  if (bloom.kind() == v1::Bloom::KIND_CONSERVE) return -1.0f;  // conserving bloom takes light from everywhere
  const float knee = bloom.kind() == v1::Bloom::KIND_MIP ? bloom.softness() * threshold : 0.0f;
  return threshold - knee - kRoundings * threshold;
}

// The parts of the frame with light that may pass the bright pass.
Area bright_area(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc, float threshold) {
  return lit_area(stats.tile_light, desc.width, desc.height, bright_bound(bloom, threshold));
}

uint64_t texels_of(const std::vector<Box>& boxes) {
  uint64_t texels = 0;
  for (const Box& box : boxes) texels += uint64_t{box.x1 - box.x0} * (box.y1 - box.y0);
  return texels;
}

// Tells people where the light is.
std::string light_words(const FrameDesc& desc, const std::vector<Box>& lit) {
  const double part = static_cast<double>(texels_of(lit)) / (static_cast<double>(desc.width) * desc.height);
  return part < 1 ? absl::StrFormat("light in %.2g %% of the frame's tiles", 100 * part)
                  : "light in all tiles of the frame";
}

// The texels of the level that a pass writes where light may be after it.
Area lit_after(Pass pass, uint32_t written, const TextureLayout& layout, std::span<const Box> lit) {
  const std::vector<LevelSize>& sizes = layout.level_sizes;
  Area area = in_level({lit.begin(), lit.end()}, layout.level_size);
  if (pass == Pass::kBrightPass) return area;
  if (pass == Pass::kGaussian) {
    area = after_gaussian(area, sizes[1], 0, shader::GAUSSIAN_REACH);
    return written == 1 ? area : after_gaussian(area, sizes[0], shader::GAUSSIAN_REACH, 0);
  }
  const bool up = pass == Pass::kBloomUp;
  const auto last = static_cast<uint32_t>(up ? sizes.size() - 1 : written);
  for (uint32_t level = 1; level <= last; ++level) area = after_bloom_down(area, sizes[level]);
  for (uint32_t level = last; up && level-- > written;) area = after_bloom_up(area, sizes[level]);
  return area;
}

// A step. Each of its work groups writes `width` x `height` texels. If they are not the whole level, a pass
// that does not work in place clears it first.
BloomStep step_of(Pass pass, uint32_t level, const TextureLayout& layout, std::span<const Box> lit,
                  uint32_t width, uint32_t height) {
  const LevelSize& size = layout.level_sizes[level];
  Cover work = cover(lit_after(pass, level, layout, lit), width, height, groups(size.width, width),
                     groups(size.height, height));
  // What it leaves out keeps what it holds already: the light of its own level, or zeros.
  const bool in_place = pass == Pass::kBloomUp || (pass == Pass::kGaussian && level == 0);
  BloomStep step;
  step.pass = pass;
  step.level = level;
  step.group_rows = height;
  step.group_columns = width;
  step.clear_first = !work.whole() && !in_place;
  step.groups = std::move(work.groups);
  return step;
}

BloomStep bright_pass(const TextureLayout& layout, const v1::Bloom& bloom, float threshold, bool scrub,
                      const std::optional<reference::Matrix>& matrix, std::span<const Box> lit) {
  constexpr uint32_t kWidth = shader::GROUP_TEXELS * shader::BRIGHT_GROUP_X * shader::BRIGHT_STEPS;
  constexpr uint32_t kHeight = shader::BRIGHT_ROWS * shader::BRIGHT_GROUP_Y;
  const uint32_t size = layout.level_size;
  BloomStep step = step_of(Pass::kBrightPass, 0, layout, lit, kWidth / size, kHeight / size);
  const float knee = bloom.softness() * bloom.threshold();
  step.inputs = ShaderInputs<shader::BrightPassConstants, shader::BrightPassParams>{
      .constants = {.pixels = static_cast<uint32_t>(layout.desc.format),
                    .matrix = matrix.has_value(),
                    .scrub = scrub,
                    .bloom = static_cast<uint32_t>(bloom.kind()),
                    .firefly_weights = bloom.firefly_weights(),
                    .level_size = size,
                    .whole = layout.desc.width % shader::GROUP_TEXELS == 0},
      .params = {.frame = input_params(layout, matrix),
                 .first_row = 0,
                 .level_width = layout.level_sizes[0].width,
                 .threshold = threshold,
                 .knee = knee < kMinKnee ? 0.0f : knee}};
  return step;
}

shader::BloomLevelParams level_params(const TextureLayout& layout, uint32_t from, uint32_t to) {
  const std::vector<LevelSize>& sizes = layout.level_sizes;
  return {.first_row = 0,
          .from_width = sizes[from].width,
          .from_height = sizes[from].height,
          .to_width = sizes[to].width,
          .to_height = sizes[to].height};
}

// An invocation of these writes 1 and 2 columns.
BloomStep bloom_down(const TextureLayout& layout, uint32_t level, std::span<const Box> lit) {
  BloomStep step = step_of(Pass::kBloomDown, level, layout, lit, shader::BLOOM_GROUP_X,
                           shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y);
  step.from_level = level - 1;
  step.inputs = ShaderInputs<shader::BloomDownConstants, shader::BloomLevelParams>{
      .constants = {}, .params = level_params(layout, level - 1, level)};
  return step;
}

BloomStep bloom_up(const TextureLayout& layout, uint32_t level, std::span<const Box> lit) {
  BloomStep step = step_of(Pass::kBloomUp, level, layout, lit, 2 * shader::BLOOM_GROUP_X,
                           2 * shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y);
  step.from_level = level + 1;
  step.inputs = ShaderInputs<shader::BloomUpConstants, shader::BloomLevelParams>{
      .constants = {.fine_weight = level == 0 && layout.first_level_twice ? 2.0f : 1.0f},
      .params = level_params(layout, level + 1, level)};
  return step;
}

// The vertical pass writes level 1 from level 0. The horizontal pass writes level 0 from level 1.
BloomStep gaussian(const TextureLayout& layout, uint32_t level, std::span<const Box> lit) {
  BloomStep step = step_of(Pass::kGaussian, level, layout, lit, shader::BLOOM_GROUP_X,
                           shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y);
  step.from_level = 1 - level;
  const LevelSize& size = layout.level_sizes[level];
  step.inputs = ShaderInputs<shader::GaussianConstants, shader::GaussianParams>{
      .constants = {.vertical = level},
      .params = {.first_row = 0, .width = size.width, .height = size.height}};
  return step;
}

std::string gaussian_words(const TextureLayout& layout, const v1::Bloom& bloom, float threshold,
                           const std::vector<Box>& lit) {
  const LevelSize& size = layout.level_sizes[0];
  return absl::StrFormat("gaussian bloom at %dx%d: threshold %g, %g times the mean; %s", size.width,
                         size.height, threshold, bloom.threshold(), light_words(layout.desc, lit));
}

std::string mip_words(const TextureLayout& layout, const v1::Bloom& bloom, const std::vector<Box>& lit) {
  const std::vector<LevelSize>& sizes = layout.level_sizes;
  const auto count = static_cast<uint32_t>(sizes.size());
  const bool left_out = layout.level_size != kWholeBloom && bloom.levels() > 1;
  return absl::StrFormat("bloom over %d level%s from %dx%d to %dx%d: %s%s", count, count == 1 ? "" : "s",
                         sizes.front().width, sizes.front().height, sizes.back().width, sizes.back().height,
                         bloom.kind() == v1::Bloom::KIND_CONSERVE
                             ? absl::StrFormat("%g of the scene's light", bloom.intensity())
                             : light_words(layout.desc, lit),
                         count + left_out < bloom.levels() ? "; the frame is too small for more levels" : "");
}

}  // namespace

shader::InputParams input_params(const TextureLayout& layout,
                                 const std::optional<reference::Matrix>& matrix) {
  const reference::Matrix m = matrix.value_or(reference::Matrix{1, 0, 0, 0, 1, 0, 0, 0, 1});
  return {.width = layout.desc.width,
          .height = layout.desc.height,
          .input_pitch = layout.pitch,
          .m00 = m[0],
          .m01 = m[1],
          .m02 = m[2],
          .m10 = m[3],
          .m11 = m[4],
          .m12 = m[5],
          .m20 = m[6],
          .m21 = m[7],
          .m22 = m[8]};
}

float bright_threshold(const v1::Bloom& bloom, const FrameStats& stats) {
  if (bloom.kind() != v1::Bloom::KIND_GAUSSIAN) return bloom.threshold();
  return static_cast<float>(bloom.threshold() * portable_exp2(stats.mean_log2_luminance));
}

bool may_bloom(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc, double mean_error) {
  if (bloom.intensity() == 0) return false;
  float threshold = bright_threshold(bloom, stats);
  // Its threshold is a multiple of the mean, and falls with it.
  if (bloom.kind() == v1::Bloom::KIND_GAUSSIAN) threshold *= static_cast<float>(portable_exp2(-mean_error));
  return !bright_area(bloom, stats, desc, threshold).empty();
}

void plan_bloom(const TextureLayout& layout, const Metered& metered, const v1::Bloom& bloom,
                const std::optional<reference::Matrix>& matrix, Plan& plan) {
  if (bloom.intensity() == 0) {
    plan.words.push_back("no bloom: its intensity is 0");
    return;
  }
  const FrameStats& stats = metered.stats;
  const bool blurs = bloom.kind() == v1::Bloom::KIND_GAUSSIAN;
  const float threshold = bright_threshold(bloom, stats);
  plan.lit = bright_area(bloom, stats, layout.desc, threshold);
  if (plan.lit.empty()) {
    plan.words.push_back(absl::StrFormat(
        "no bloom: nothing passes the threshold %g%s (the brightest is %g)", threshold,
        blurs ? absl::StrFormat(", %g times the mean", bloom.threshold()) : "", stats.max_luminance));
    return;
  }
  plan.bloom_steps.push_back(bright_pass(layout, bloom, threshold, metered.scrubbed, matrix, plan.lit));
  if (blurs) {
    plan.bloom_steps.push_back(gaussian(layout, 1, plan.lit));
    plan.bloom_steps.push_back(gaussian(layout, 0, plan.lit));
    plan.words.push_back(gaussian_words(layout, bloom, threshold, plan.lit));
    return;
  }
  const auto count = static_cast<uint32_t>(layout.level_sizes.size());
  for (uint32_t level = 1; level < count; ++level) {
    plan.bloom_steps.push_back(bloom_down(layout, level, plan.lit));
  }
  for (uint32_t level = count - 1; level-- > 0;) {
    plan.bloom_steps.push_back(bloom_up(layout, level, plan.lit));
  }
  plan.words.push_back(mip_words(layout, bloom, plan.lit));
}

Area bloom_reach(const TextureLayout& layout, const Plan& plan) {
  if (!plan.bloom()) return {};
  const FrameDesc& desc = layout.desc;
  const Pass last = plan.bloom_steps.back().pass == Pass::kGaussian ? Pass::kGaussian : Pass::kBloomUp;
  return in_frame(lit_after(last, 0, layout, plan.lit), layout.level_size, desc.width, desc.height);
}

namespace {

std::string metering_words(const v1::Metering& metering) {
  std::string words;
  if (metering.statistic() == v1::Metering::STATISTIC_PERCENTILE) {
    absl::StrAppendFormat(&words, " between %g %% and %g %%", metering.percentile_low(),
                          metering.percentile_high());
  }
  if (metering.weights() == v1::Metering::WEIGHTS_CENTER) words += " around the centre";
  if (metering.weights() == v1::Metering::WEIGHTS_SPOT) {
    absl::StrAppendFormat(&words, " in x %d .. %d, y %d .. %d", metering.spot().x0(), metering.spot().x1(),
                          metering.spot().y0(), metering.spot().y1());
  }
  if (metering.ignore_below() > 0) absl::StrAppendFormat(&words, " above %g", metering.ignore_below());
  return words;
}

// "srgb", "pq of 1000 nit in rec2020"
std::string transfer_words(const Settings& settings) {
  const std::string transfer = v1::word_of(settings->transfer());
  if (!is_hdr(*settings)) return transfer;
  return absl::StrFormat("%s of %g nit in %s", transfer, settings->peak_nits(),
                         v1::word_of(settings->display_primaries()));
}

bool ignores_alpha(const Settings& settings) { return settings->alpha() == v1::ALPHA_IGNORE; }

// " with straight alpha"
std::string alpha_words(const Settings& settings) {
  switch (settings->alpha()) {
    case v1::ALPHA_STRAIGHT:
      return " with straight alpha";
    case v1::ALPHA_OVER: {
      const v1::Background& background = settings->background();
      return absl::StrFormat(" over %g,%g,%g", background.red(), background.green(), background.blue());
    }
    case v1::ALPHA_IGNORE:
      return " without alpha";
    default:
      return " with associated alpha";
  }
}

reference::MeterParams reference_meter(const Settings& settings) {
  const v1::Metering& metering = settings->exposure().metering();
  return {.percentile = metering.statistic() == v1::Metering::STATISTIC_PERCENTILE,
          .percentile_low = metering.percentile_low(),
          .percentile_high = metering.percentile_high(),
          .weights = static_cast<uint32_t>(metering.weights()),
          .spot = {metering.spot().x0(), metering.spot().y0(), metering.spot().x1(), metering.spot().y1()},
          .ignore_below = metering.ignore_below(),
          .ignore_absent = !ignores_alpha(settings)};
}

// The factor that exposes the scene: light is then in units of reference white or, for HDR displays, of their
// peak; aces-2 has its own. Any curve is flat before MAX_EXPOSURE, even for a half's smallest step.
double exposure_factor(const Settings& settings, double exposure) {
  double factor = exposure * settings->prescale();
  if (settings->curve() != v1::TONE_CURVE_ACES_2)
    factor *= kReferenceWhiteNits / display_peak_nits(*settings);
  return std::min<double>(factor, shader::MAX_EXPOSURE);
}

// Sets what describes the display.
void set_display(const Settings& settings, shader::ResolveParams& params) {
  const double peak = display_peak_nits(*settings) / kPqPeakNits;
  params.display_peak = static_cast<float>(peak);
  params.peak_signal = static_cast<float>(pq_signal(peak));
  if (is_hdr(*settings)) params.hlg_exponent = static_cast<float>(hlg_exponent(settings->peak_nits()));
  if (settings->curve() == v1::TONE_CURVE_BT2390) {
    params.curve_white = static_cast<float>(pq_signal(settings->source_peak_nits() / kPqPeakNits));
  }
}

uint32_t display_constant(const Settings& settings) {
  return is_hdr(*settings) ? static_cast<uint32_t>(settings->display_primaries()) : shader::DISPLAY_REC709;
}
uint32_t limit_constant(const Settings& settings) {
  const bool own = is_hdr(*settings) && settings->curve() == v1::TONE_CURVE_ACES_2;
  return own ? static_cast<uint32_t>(limit_of(*settings)) : display_constant(settings);
}

// A bound of the scene's components, from their luminance.
double largest_light(const FrameStats& stats) {
  const auto brightest = std::max_element(stats.tile_light.begin(), stats.tile_light.end());
  const double most = brightest == stats.tile_light.end() ? 0.0 : *brightest / 0.0722;
  return std::clamp<double>(most, shader::MAX_HALF, shader::MAX_LIGHT);
}

// Whether the image's scene keeps float32: an HDR display's does, and with 16 bits or max_error_codes every
// one. Other frames are halves, unless a matrix changes them.
bool keeps_floats(const TextureLayout& layout, const Settings& settings, bool matrix) {
  const bool rounds = layout.desc.format == v1::PIXEL_FORMAT_RGBA32F || matrix;
  const bool exact = settings->has_max_error_codes() || settings->output_format() == v1::OUTPUT_FORMAT_RGBA16;
  return is_hdr(*settings) || (exact && rounds);
}

// Whether there is light outside of Rec.709, of which a curve may cut a part.
bool wide(const Metered& metered) { return metered.stats.negative_scene_components > 0; }

// Where the settings' curve cuts light.
reference::Gamut gamut_of(const Settings& settings, const ColorTable* table) {
  switch (settings->curve()) {
    case v1::TONE_CURVE_ACES_HILL:
      return reference::Gamut::kAces;
    case v1::TONE_CURVE_AGX:
      return reference::Gamut::kAgx;
    case v1::TONE_CURVE_ACES_1:
    case v1::TONE_CURVE_ACES_2:
      return reference::Gamut::kAp1;
    case v1::TONE_CURVE_TABLE:
      return table->axes == shader::AXES_ACES  ? reference::Gamut::kAces
             : table->axes == shader::AXES_AP1 ? reference::Gamut::kAp1
                                               : reference::Gamut::kRec709;
    default:
      return settings->display_primaries() == v1::PRIMARIES_REC2020  ? reference::Gamut::kRec2020
             : settings->display_primaries() == v1::PRIMARIES_P3_D65 ? reference::Gamut::kP3D65
                                                                     : reference::Gamut::kRec709;
  }
}

uint32_t curve_constant(const Settings& settings, const ColorTable* table) {
  if (table != nullptr && table->axes == shader::AXES_REC709) return shader::CURVE_TABLE_REC709;
  if (table != nullptr && table->axes == shader::AXES_AP1) return shader::CURVE_TABLE_AP1;
  return static_cast<uint32_t>(settings->curve());
}

bool dithers(const Settings& settings) {
  return settings->dither() && settings->output_format() != v1::OUTPUT_FORMAT_RGBA16F;
}

ReferencePlan plan_reference(const TextureLayout& layout, const Settings& settings,
                             const FrameDecisions& decisions,
                             const std::optional<reference::Matrix>& matrix) {
  const v1::Bloom& bloom = settings->bloom();
  ReferencePlan plan;
  plan.matrix = matrix;
  plan.meter = reference_meter(settings);
  if (bloom.intensity() > 0) {
    plan.bloom = {.kind = static_cast<uint32_t>(bloom.kind()),
                  .threshold = bloom.threshold(),
                  .softness = bloom.softness(),
                  .levels = bloom.levels(),
                  .firefly_weights = bloom.firefly_weights(),
                  .level_size = kWholeBloom};
    plan.resolve.bloom = plan.bloom->kind;
  }
  plan.resolve.exposure = exposure_factor(settings, decisions.exposure);
  plan.resolve.level_size = bloom.kind() == v1::Bloom::KIND_GAUSSIAN ? layout.level_size : kWholeBloom;
  plan.resolve.bloom_intensity = bloom.intensity();
  plan.resolve.curve = static_cast<uint32_t>(settings->curve());
  plan.resolve.gamut = gamut_of(settings, decisions.table.get());
  plan.resolve.curve_white = curve_white(*settings);
  plan.resolve.transfer = static_cast<uint32_t>(output_transfer(*settings));
  plan.resolve.display = display_constant(settings);
  plan.resolve.limit = limit_constant(settings);
  plan.resolve.peak_nits = settings->peak_nits();
  plan.resolve.source_peak_nits = settings->source_peak_nits();
  plan.resolve.alpha = static_cast<uint32_t>(settings->alpha());
  plan.resolve.background = {settings->background().red(), settings->background().green(),
                             settings->background().blue()};
  if (dithers(settings)) plan.dither_frame = static_cast<uint32_t>(decisions.sequence);
  plan.image = layout.image;
  return plan;
}

shader::ResolveConstants resolve_constants(const TextureLayout& layout, const Metered& metered,
                                           const Settings& settings, const ColorTable* table, bool matrix) {
  return {.pixels = static_cast<uint32_t>(layout.desc.format),
          .matrix = matrix,
          .scrub = metered.scrubbed,
          .bloom = static_cast<uint32_t>(settings->bloom().kind()),
          .curve = curve_constant(settings, table),
          .transfer = static_cast<uint32_t>(output_transfer(*settings)),
          .output_format = static_cast<uint32_t>(settings->output_format()),
          .dither = dithers(settings),
          .level_size = layout.level_size,
          .transfer_terms = settings.tier().transfer_terms,
          .wide = wide(metered) || is_hdr(*settings),
          .alpha = metered.alpha ? static_cast<uint32_t>(settings->alpha()) : shader::ALPHA_ASSOCIATED,
          .display = display_constant(settings),
          .unrounded = keeps_floats(layout, settings, matrix),
          .limit = limit_constant(settings),
          .gain = 0};
}

shader::ResolveParams resolve_params(const TextureLayout& layout, const Settings& settings,
                                     const FrameDecisions& decisions, bool bloom,
                                     const std::optional<reference::Matrix>& matrix) {
  shader::ResolveParams params{};
  params.frame = input_params(layout, matrix);
  params.output_pitch = layout.image_pitch;
  params.exposure = static_cast<float>(exposure_factor(settings, decisions.exposure));
  params.curve_white = static_cast<float>(curve_white(*settings));
  set_display(settings, params);
  params.dither_frame = static_cast<uint32_t>(decisions.sequence);
  params.background_r = settings->background().red();
  params.background_g = settings->background().green();
  params.background_b = settings->background().blue();
  if (const ColorTable* table = decisions.table.get(); table != nullptr && table->size > 0) {
    params.table_size = table->size;
    params.table_end = table->end;
    params.table_scale = static_cast<float>(std::ldexp(table->size - 1, shader::TABLE_FRACTION_BITS) /
                                            table_axis_octaves(table->axes, table->end));
  }
  if (bloom) {
    params.level_width = layout.level_sizes[0].width;
    params.level_height = layout.level_sizes[0].height;
    const float intensity = settings->bloom().intensity();
    params.bloom_scale = intensity / static_cast<float>(layout.summed_levels);
    params.scene_scale = 1.0f - intensity;
  }
  return params;
}

// Splits the step's frame into the rows of groups that bloom reaches and the rest. Whole rows: a shorter walk
// along them costs more than it saves.
void set_groups(const Area& reached, ResolveStep& step) {
  constexpr uint32_t kWidth = shader::GROUP_TEXELS * shader::RESOLVE_GROUP_X * shader::RESOLVE_STEPS;
  const shader::InputParams& frame = step.inputs.params.frame;
  Cover rows = cover(reached, frame.width, kResolveGroupRows, 1, groups(frame.height, kResolveGroupRows));
  for (std::vector<Box>* part : {&rows.groups, &rows.rest}) {
    for (Box& box : *part) box.x1 = groups(frame.width, kWidth);
  }
  step.bloom_groups = std::move(rows.groups);
  step.plain_groups = std::move(rows.rest);
}

// Puts the resized scene between the frame and the plan's resolve.
void plan_resize(const TextureLayout& layout, Plan& plan) {
  const FrameDesc& desc = layout.desc;
  ResizeStep& step = plan.resize.emplace();
  step.frame = plan.resolve;
  step.frame.inputs.constants.alpha = shader::ALPHA_ASSOCIATED;
  step.frame.inputs.params.exposure = 1.0f;
  step.down = axis_filter(desc.height, layout.image.height);
  step.across = axis_filter(desc.width, layout.image.width);
  shader::ResolveConstants& constants = plan.resolve.inputs.constants;
  constants.pixels = shader::PIXELS_SCENE;
  constants.matrix = constants.scrub = constants.unrounded = 0;
  constants.bloom = shader::BLOOM_NONE;
  shader::InputParams& frame = plan.resolve.inputs.params.frame;
  frame.width = layout.image.width;
  frame.height = layout.image.height;
  frame.input_pitch = layout.image_pitch;
  set_groups({}, plan.resolve);
  plan.words.push_back(absl::StrFormat("resize%s to %dx%d: %s along y, %s along x",
                                       plan.bloom() ? " with bloom" : "", layout.image.width,
                                       layout.image.height, step.down.words(), step.across.words()));
}

}  // namespace

const char* name(Pass pass) {
  static constexpr const char* kNames[] = {"ingest",   "bright_pass", "bloom_down", "bloom_up",
                                           "gaussian", "resolve",     "resize"};
  return kNames[static_cast<size_t>(pass)];
}

IngestPlan plan_ingest(const TextureLayout& layout, const Settings& settings) {
  const v1::Metering& metering = settings->exposure().metering();
  IngestPlan plan;
  plan.matrix = settings.to_scene();
  plan.inputs.constants = {.pixels = static_cast<uint32_t>(layout.desc.format),
                           .matrix = plan.matrix.has_value(),
                           .scrub = false,
                           .light = !layout.level_sizes.empty(),
                           .weights = static_cast<uint32_t>(metering.weights()),
                           .histogram = layout.histogram_copies > 0,
                           .whole = layout.desc.width % shader::GROUP_TEXELS == 0,
                           .ignore = metering.ignore_below() > 0,
                           .alpha = shader::METER_OPAQUE};
  plan.inputs.params.frame = input_params(layout, plan.matrix);
  plan.inputs.params.tiles_x = layout.tiles_x;
  plan.inputs.params.spot_x0 = metering.spot().x0();
  plan.inputs.params.spot_y0 = metering.spot().y0();
  plan.inputs.params.spot_x1 = metering.spot().x1();
  plan.inputs.params.spot_y1 = metering.spot().y1();
  plan.inputs.params.ignore_below = metering.ignore_below();
  if (metering.statistic() == v1::Metering::STATISTIC_PERCENTILE) {
    plan.percentiles = {metering.percentile_low(), metering.percentile_high()};
  }
  plan.wants_histogram = settings.wants_histogram();
  plan.rejects_bad_values = settings->bad_values() == v1::BAD_VALUES_REJECT;
  plan.ignores_alpha = ignores_alpha(settings);
  plan.reference = reference_meter(settings);
  return plan;
}

Plan plan_frame(const TextureLayout& layout, const Metered& metered, const Settings& settings,
                const FrameDecisions& decisions) {
  const std::optional<reference::Matrix> matrix = settings.to_scene();
  const FrameDesc& desc = layout.desc;
  Plan plan;
  plan.table = decisions.table;
  plan.gain = settings.gain_curve();
  plan.words.push_back(absl::StrFormat("ingest %dx%d %s: meter%s", desc.width, desc.height,
                                       v1::word_of(desc.format),
                                       metering_words(settings->exposure().metering())));
  if (metered.scrubbed) {
    plan.words.push_back("ingest again with the scrub: some components are not finite or beyond +-65504");
  }
  if (metered.alpha && !ignores_alpha(settings)) {
    plan.words.push_back(
        absl::StrFormat("ingest again with alpha: it is %s; %d of %d pixels are absent",
                        metered.uncovered ? "0 everywhere, so all pixels count alike" : "not 1 everywhere",
                        metered.stats.absent_pixels, uint64_t{desc.width} * desc.height));
  }
  plan_bloom(layout, metered, settings->bloom(), matrix, plan);
  const bool bloom = plan.bloom();
  plan.resolve.inputs.constants =
      resolve_constants(layout, metered, settings, plan.table.get(), matrix.has_value());
  plan.resolve.inputs.params = resolve_params(layout, settings, decisions, bloom, matrix);
  plan.resolve.inputs.constants.gain = plan.gain != nullptr;
  plan.resolve.opaque = !metered.alpha;
  set_groups(bloom_reach(layout, plan), plan.resolve);
  if (layout.resizes()) plan_resize(layout, plan);
  if (wide(metered)) {
    plan.words.push_back(
        absl::StrFormat("resolve counts what the curve cuts: %d components are negative in Rec.709",
                        metered.stats.negative_scene_components));
  }
  plan.words.push_back(absl::StrFormat(
      "resolve%s%s: %s, %s, %s, tier %s", bloom && !layout.resizes() ? " with bloom" : "",
      metered.alpha ? alpha_words(settings) : "", v1::word_of(settings->curve()),
      settings->output_format() == v1::OUTPUT_FORMAT_RGBA16F ? "display-linear" : transfer_words(settings),
      absl::StrCat(v1::word_of(settings->output_format()), settings->dither() ? " dithered" : "",
                   plan.gain ? " with a gain map" : ""),
      settings->tier()));
  plan.reference = plan_reference(layout, settings, decisions, matrix);
  plan.reference.unrounded = keeps_floats(layout, settings, matrix.has_value());
  return plan;
}

BoundFacts frame_facts(const Metered& metered, const Settings& settings, double exposure,
                       const FrameDesc& desc) {
  const v1::Bloom& bloom = settings->bloom();
  BoundFacts facts;
  facts.threshold = bright_threshold(bloom, metered.stats);
  facts.blooms = may_bloom(bloom, metered.stats, desc, mean_error(settings->exposure().metering()));
  facts.wide = wide(metered);
  facts.translucent = metered.alpha && settings->alpha() == v1::ALPHA_STRAIGHT;
  facts.exposure = exposure_factor(settings, exposure);
  facts.resized = resizes(*settings, desc);
  if (metered.scrubbed) facts.largest = largest_light(metered.stats);
  return facts;
}

absl::StatusOr<std::shared_ptr<const ColorTable>> color_table_of(const Settings& settings,
                                                                 const Metered& metered) {
  const Tier& tier = settings.tier();
  if (settings->curve() == v1::TONE_CURVE_ACES_2) {
    return aces_2_table(is_hdr(*settings) ? Aces2Display{settings->peak_nits(), limit_of(*settings)}
                                          : Aces2Display{});
  }
  if (settings->curve() != v1::TONE_CURVE_ACES_1 || tier.host_reference) return settings.table();
  return wide(metered) ? aces_1_wide_table(tier.wide_table_size) : aces_1_table(tier.table_size);
}

}  // namespace candela
