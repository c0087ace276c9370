// The plan of a frame: everything that executors need to meter and render it, decided by pure functions.
//
// A frame is rendered in two phases. Phase A reads it once, meters it and counts its bad values (IngestPlan).
// Phase B follows when the exposure is decided (Plan). An executor (frame/executor.h) renders a plan; it
// reads no settings.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/render/color/hdr_signal.h"
#include "server/render/plan/exposure.h"
#include "server/render/plan/frame_stats.h"
#include "server/render/plan/lit_area.h"
#include "server/render/plan/resize_plan.h"
#include "server/render/plan/texture_layout.h"
#include "server/render/settings/error_bound.h"
#include "server/render/settings/settings.h"
#include "shaders/color_table.h"
#include "shaders/params.h"
#include "shaders/reference.h"

namespace candela {

enum class Pass : uint32_t { kIngest, kBrightPass, kBloomDown, kBloomUp, kGaussian, kResolve, kResize };
// "ingest", "bright_pass", "bloom_down", "bloom_up", "gaussian", "resolve", "resize"
const char* name(Pass pass);

// A shader's specialisation constants and push constants. The executor fills in addresses and `first_row`.
template <typename Constants, typename Params>
struct ShaderInputs {
  Constants constants{};
  Params params{};
};

struct IngestPlan {
  ShaderInputs<shader::IngestConstants, shader::IngestParams> inputs;  // without the scrub and alpha
  // The mean is that of the luminances between these percentiles of the histogram; absent: of all.
  std::optional<std::array<double, 2>> percentiles;
  bool wants_histogram = false;     // among the frame's statistics
  bool rejects_bad_values = false;  // a NaN or an infinite component is an error
  bool ignores_alpha = false;       // every alpha is taken as 1
  // The same for the float64 reference.
  std::optional<reference::Matrix> matrix;
  reference::MeterParams reference;
};

// How ingest reads a frame. The first read is without either.
struct IngestRead {
  bool scrub = false;                     // a component is not finite or beyond the largest half
  uint32_t alpha = shader::METER_OPAQUE;  // another METER_* if an alpha is not 1
};

// One pass of the bloom. It writes level `level`: for kBrightPass 0, for kBloomDown n+1, for kBloomUp n, for
// kGaussian 1 in the vertical pass and 0 in the horizontal one.
struct BloomStep {
  Pass pass;
  uint32_t level = 0;
  std::variant<ShaderInputs<shader::BrightPassConstants, shader::BrightPassParams>,
               ShaderInputs<shader::BloomDownConstants, shader::BloomLevelParams>,
               ShaderInputs<shader::BloomUpConstants, shader::BloomLevelParams>,
               ShaderInputs<shader::GaussianConstants, shader::GaussianParams>>
      inputs;
  uint32_t from_level = 0;  // not for kBrightPass
  uint32_t group_rows = 0;  // of the level that a work group writes
  uint32_t group_columns = 0;
  std::vector<Box> groups;   // work groups to dispatch
  bool clear_first = false;  // the groups are not the whole level, and it holds nothing yet
};

// Rows of the image that a work group of resolve writes.
inline constexpr uint32_t kResolveGroupRows = shader::RESOLVE_ROWS * shader::RESOLVE_GROUP_Y;

// The last pass, which writes the image. The groups that bloom does not reach run a shader without it.
struct ResolveStep {
  ShaderInputs<shader::ResolveConstants, shader::ResolveParams> inputs;
  bool opaque = false;  // every alpha is 1
  std::vector<Box> bloom_groups;
  std::vector<Box> plain_groups;
};

// Before resolve, if the image has another size: the frame's light with its bloom becomes the scene that
// resolve reads, of the image's size. First along y, then along x.
struct ResizeStep {
  // How resolve would read the frame: it makes the light at an exposure of 1. Its groups are of the frame.
  ResolveStep frame;
  AxisFilter down;
  AxisFilter across;
};

// The same picture for the float64 reference, which works on whole images.
struct ReferencePlan {
  std::optional<reference::Matrix> matrix;
  reference::MeterParams meter;
  std::optional<reference::BloomSpec> bloom;  // absent if the settings ask for none
  reference::ResolveParams resolve;           // without `look`
  bool unrounded = false;                     // the image's scene is not rounded to halves
  std::optional<uint32_t> dither_frame;       // absent: no dither
  ImageSize image;
};

struct Plan {
  std::vector<BloomStep> bloom_steps;  // in order; empty if no light passes the threshold
  std::optional<ResizeStep> resize;    // absent: the image has the frame's size
  ResolveStep resolve;
  std::shared_ptr<const ColorTable> table;  // of the curves that have one
  std::shared_ptr<const GainCurve> gain;    // if the fourth component is a gain map's code
  ReferencePlan reference;
  std::vector<Box> lit;            // texels of the frame that may pass the bright pass; no others do
  std::vector<std::string> words;  // the plan for people, with the reasons

  bool bloom() const { return !bloom_steps.empty(); }
};

// Pure.
IngestPlan plan_ingest(const TextureLayout& layout, const Settings& settings);

// How bright an image in PQ or HLG is, in units of the display's peak: the largest of R, G and B of all
// pixels, and the mean of each pixel's largest. With straight alpha they are those of the pixels' objects.
struct ShownLight {
  double largest = 0.0;
  double mean = 0.0;
};

// The decisions about a frame between its two phases.
struct FrameDecisions {
  double exposure = 1.0;                    // the factor E
  uint64_t sequence = 0;                    // the dither depends on its low 32 bits
  std::shared_ptr<const ColorTable> table;  // see color_table_of()
};

// Pure: the same arguments give the same plan.
Plan plan_frame(const TextureLayout& layout, const Metered& metered, const Settings& settings,
                const FrameDecisions& decisions);

// What the error bound of a metered frame depends on. `exposure` is the frame's factor E. Pure.
BoundFacts frame_facts(const Metered& metered, const Settings& settings, double exposure,
                       const FrameDesc& desc);

// The table that resolve looks colours up in: the settings' own, or one of the two that are baked for aces-1,
// as the frame has light outside of Rec.709 or not; null for curves that are formulas. Fails as aces_1_table
// does. Any thread.
absl::StatusOr<std::shared_ptr<const ColorTable>> color_table_of(const Settings& settings,
                                                                 const Metered& metered);

// The bloom's part of a frame's plan.

// The shader inputs that all passes share that read the frame.
shader::InputParams input_params(const TextureLayout& layout, const std::optional<reference::Matrix>& matrix);

// Scene luminance above which there is bloom: the settings' threshold, or kGaussian's multiple of the mean.
float bright_threshold(const v1::Bloom& bloom, const FrameStats& stats);
// True if the frame blooms. Also true if it would bloom with a metered mean that is lower by `mean_error` EV:
// the reference's may be.
bool may_bloom(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc, double mean_error);

void plan_bloom(const TextureLayout& layout, const Metered& metered, const v1::Bloom& bloom,
                const std::optional<reference::Matrix>& matrix, Plan& plan);

// The frame's texels that the finished bloom reaches.
Area bloom_reach(const TextureLayout& layout, const Plan& plan);

}  // namespace candela
