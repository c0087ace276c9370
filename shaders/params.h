// The parameters and constants that the host and the shaders share. Both GLSL and C++ include this file. Its
// structs have only 4-byte scalars, so that both languages lay them out alike. An address is two words, the
// low one first. Sizes are in texels.
#ifdef __cplusplus
#pragma once
#include <cstdint>
namespace candela::shader {
using uint = uint32_t;
#define CANDELA_CONST(type) inline constexpr type
#else
#define CANDELA_CONST(type) const type
#endif

// Values of specialisation constants. Those that are also on the wire have the same numbers there.
CANDELA_CONST(uint) PIXELS_RGBA16F = 1u;
CANDELA_CONST(uint) PIXELS_RGBA32F = 2u;
CANDELA_CONST(uint) PIXELS_RGB9E5 = 3u;
// Not on the wire: the resized scene, four floats a texel, which are scene light already. Only for resolve.
CANDELA_CONST(uint) PIXELS_SCENE = 4u;
CANDELA_CONST(uint) OUTPUT_RGBA8 = 1u;
CANDELA_CONST(uint) OUTPUT_RGBA16 = 2u;
CANDELA_CONST(uint) OUTPUT_RGBA16F = 3u;
CANDELA_CONST(uint) OUTPUT_FLOAT = 4u;  // not on the wire: display values as four floats, for verification
CANDELA_CONST(uint) CURVE_LINEAR = 1u;
CANDELA_CONST(uint) CURVE_REINHARD = 2u;
CANDELA_CONST(uint) CURVE_ACES_NARKOWICZ = 3u;
CANDELA_CONST(uint) CURVE_ACES_HILL = 4u;
CANDELA_CONST(uint) CURVE_REINHARD_EXTENDED = 5u;
CANDELA_CONST(uint) CURVE_HABLE = 6u;
CANDELA_CONST(uint) CURVE_AGX = 7u;
CANDELA_CONST(uint) CURVE_PBR_NEUTRAL = 8u;
CANDELA_CONST(uint) CURVE_ACES_1 = 9u;
CANDELA_CONST(uint) CURVE_TABLE = 10u;
CANDELA_CONST(uint) CURVE_ACES_2 = 11u;
CANDELA_CONST(uint) CURVE_BT2390 = 12u;
CANDELA_CONST(uint) CURVE_SHOULDER = 13u;
// Not on the wire: TABLE with AXES_REC709; TABLE with AXES_AP1, and ACES_1 of a frame with wide-gamut light.
CANDELA_CONST(uint) CURVE_TABLE_REC709 = 101u;
CANDELA_CONST(uint) CURVE_TABLE_AP1 = 102u;
CANDELA_CONST(uint) WEIGHTS_AVERAGE = 1u;
CANDELA_CONST(uint) WEIGHTS_CENTER = 2u;
CANDELA_CONST(uint) WEIGHTS_SPOT = 3u;
CANDELA_CONST(uint) BLOOM_NONE = 0u;
CANDELA_CONST(uint) BLOOM_MIP = 1u;
CANDELA_CONST(uint) BLOOM_CONSERVE = 2u;
CANDELA_CONST(uint) BLOOM_GAUSSIAN = 3u;
CANDELA_CONST(uint) TRANSFER_SRGB = 1u;
CANDELA_CONST(uint) TRANSFER_GAMMA22 = 2u;
CANDELA_CONST(uint) TRANSFER_LINEAR = 3u;
CANDELA_CONST(uint) TRANSFER_PQ = 4u;
CANDELA_CONST(uint) TRANSFER_HLG = 5u;
// The display's primaries.
CANDELA_CONST(uint) DISPLAY_REC709 = 1u;
CANDELA_CONST(uint) DISPLAY_REC2020 = 2u;
CANDELA_CONST(uint) DISPLAY_P3_D65 = 3u;
CANDELA_CONST(uint) ALPHA_ASSOCIATED = 1u;
CANDELA_CONST(uint) ALPHA_STRAIGHT = 2u;
CANDELA_CONST(uint) ALPHA_OVER = 3u;
CANDELA_CONST(uint) ALPHA_IGNORE = 4u;
// How ingest meters alpha. Not on the wire.
CANDELA_CONST(uint) METER_OPAQUE = 0u;    // every alpha is 1, or taken as 1
CANDELA_CONST(uint) METER_COVERAGE = 1u;  // a texel counts by its alpha
CANDELA_CONST(uint) METER_ALIKE = 2u;  // no texel has an alpha above 0: those that are not absent count alike

// An invocation of a full-size pass handles GROUP_TEXELS texels of a row at a time; input and output rows are
// padded to whole groups.
CANDELA_CONST(uint) GROUP_TEXELS = 4u;
// `ingest` meters the frame in square tiles of TILE_TEXELS a side. A work group meters INGEST_TILES of them,
// side by side.
CANDELA_CONST(uint) TILE_TEXELS = 64u;
CANDELA_CONST(uint) INGEST_TILES = 8u;
// Rows: how many rows one invocation walks down. Steps: how often it does so, from left to right. Group: the
// work group's shape in invocations.
CANDELA_CONST(uint) INGEST_ROWS = 16u;
CANDELA_CONST(uint) INGEST_GROUP_X = 8u;
CANDELA_CONST(uint) INGEST_GROUP_Y = 4u;
CANDELA_CONST(uint) BRIGHT_ROWS = 8u;
CANDELA_CONST(uint) BRIGHT_STEPS = 16u;
CANDELA_CONST(uint) BRIGHT_GROUP_X = 8u;
CANDELA_CONST(uint) BRIGHT_GROUP_Y = 4u;
CANDELA_CONST(uint) BLOOM_ROWS = 8u;
CANDELA_CONST(uint) BLOOM_GROUP_X = 32u;
CANDELA_CONST(uint) BLOOM_GROUP_Y = 1u;
CANDELA_CONST(uint) RESIZE_GROUP_X = 32u;
CANDELA_CONST(uint) RESOLVE_ROWS = 4u;
CANDELA_CONST(uint) RESOLVE_STEPS = 16u;
CANDELA_CONST(uint) RESOLVE_GROUP_X = 8u;
CANDELA_CONST(uint) RESOLVE_GROUP_Y = 4u;

// An invocation of resolve makes at most 2^8 texels, a subgroup has at most 2^7 of them, and an image at most
// 2^17 subgroups of 8 or more: neither part of the sum of light leaves 32 bits.
CANDELA_CONST(float) SHOWN_SCALE = 16384.0f;  // 2^14
CANDELA_CONST(uint) SHOWN_LOW_BITS = 12u;

// The smallest luminance that is metered, and the smallest divisor in bloom. Darker texels count as this.
CANDELA_CONST(float) MIN_METERED_LUMINANCE = 1e-4f;
// Metered log2 luminance is (log2 L + LOG2_BIAS) * 2^LOG2_FRACTION_BITS, rounded: 25 bits, or 26 with the
// constant `scrub`, and never negative.
CANDELA_CONST(uint) LOG2_BIAS = 14u;
CANDELA_CONST(uint) LOG2_FRACTION_BITS = 20u;
// The histogram of percentile metering: 64 bins an octave of the metered fixed-point value, above
// 2^-LOG2_BIAS. One copy serves HISTOGRAM_TILES tiles, so that 2^18 texels of weight 255, or of 14 bits below
// a bin, fit into 32 bits. With the constant `scrub` luminance is up to 2^30, and there are more bins.
CANDELA_CONST(uint) HISTOGRAM_SHIFT = 14u;
CANDELA_CONST(uint) HISTOGRAM_BINS = 1920u;
CANDELA_CONST(uint) HISTOGRAM_SCRUB_BINS = 2880u;
CANDELA_CONST(uint) HISTOGRAM_TILES = 64u;
// CENTER weights come in 256 steps of the squared distance, each at most 255.
CANDELA_CONST(uint) CENTER_STEPS_LOG2 = 8u;
// The largest finite half. Scene components within it are rounded to half; those beyond are floats.
CANDELA_CONST(float) MAX_HALF = 65504.0f;
// The largest scene value.
CANDELA_CONST(float) MAX_LIGHT = 1073741824.0f;  // 2^30
// A scene component is negative if it is below this. What is above it rounds to a half of 0.
CANDELA_CONST(float) NEGATIVE_BELOW = -2.98023223876953125e-8f;  // -2^-25
// An exposed scene value is cut here, far above where every curve is flat, so that its square stays finite.
CANDELA_CONST(float) MAX_EXPOSED_VALUE = 1.15292150460684698e18f;  // 2^60
// With straight alpha, the most exposed light that a pixel's object has where it is nearly transparent; the
// rest is light of its own.
CANDELA_CONST(float) MAX_OBJECT_LIGHT = 8.0f;

// Colour tables (shaders/color_table.h): an axis is log2(1 + v / knee) made of parabolas. The largest
// stored number stands for this square root of light.
CANDELA_CONST(float) TABLE_AXIS_KNEE = 0.03125f;
CANDELA_CONST(float) TABLE_AXIS_KNEE_AP1 = 0.02083333f;  // of AXES_AP1: 1/48
CANDELA_CONST(float) TABLE_MAX_ROOT = 1.25f;
// The primaries of a table's axes: TABLE_FROM_SCENE, Rec.709 unchanged, or ACES AP1. Its values are in those
// of TABLE_TO_DISPLAY, or with AXES_REC709 in Rec.709.
CANDELA_CONST(uint) AXES_ACES = 1u;
CANDELA_CONST(uint) AXES_REC709 = 2u;
CANDELA_CONST(uint) AXES_AP1 = 3u;
// Fraction bits of a position along an axis. The step, below 2^TABLE_STEP_BITS, shares the word and leaves no
// more bits.
CANDELA_CONST(int) TABLE_FRACTION_BITS = 17;
CANDELA_CONST(int) TABLE_STEP_BITS = 32 - TABLE_FRACTION_BITS;
// Rec.709 to the primaries in which the ACES 1.x tone curve works (AP1, desaturated as the RRT does), and
// from those of its output (AP1, before the ODT's desaturation) to Rec.709; row by row. Source: S. Hill's fit
// of the ACES RRT and ODT, published in M. Pettineo's BakingLab.
#define TABLE_FROM_SCENE \
  0.59719f, 0.35458f, 0.04823f, 0.07600f, 0.90834f, 0.01566f, 0.02840f, 0.13383f, 0.83777f
#define TABLE_TO_DISPLAY \
  1.60475f, -0.53108f, -0.07367f, -0.10208f, 1.10813f, -0.00605f, -0.00327f, -0.07276f, 1.07602f
// Rec.709 to ACES AP1, by Bradford; row by row. Source: AMPAS S-2014-004.
#define TABLE_FROM_SCENE_AP1                                                                              \
  0.61309740f, 0.33952315f, 0.04737945f, 0.07019372f, 0.91635388f, 0.01345240f, 0.02061559f, 0.10956977f, \
      0.86981463f
// ACES 2.0 (shaders/glsl/aces2.glsl): the elements from which it is evaluated. First the constants, then the
// pieces of the tone scale, 2^(23 - SHIFT) an octave above the knee, then hues, evenly along a diamond, the
// first of them again at the end.
CANDELA_CONST(uint) ACES2_CONSTANTS = 12u;
CANDELA_CONST(float) ACES2_TONE_KNEE = 0.0625f;  // of the achromatic response
CANDELA_CONST(int) ACES2_TONE_SHIFT = 18;
CANDELA_CONST(uint) ACES2_TONE_PIECES = 288u;  // to a response of 32
CANDELA_CONST(uint) ACES2_HUE_BEGIN = ACES2_CONSTANTS + ACES2_TONE_PIECES;
CANDELA_CONST(uint) ACES2_HUES = 16384u;
// A gain map beside an SDR image (shaders/glsl/gain.glsl): cubic pieces, 2^(23 - SHIFT) an octave above the
// knee, of light to GAIN_END.
CANDELA_CONST(float) GAIN_KNEE = 0.0625f;
CANDELA_CONST(float) GAIN_END = 1023.875f;
CANDELA_CONST(int) GAIN_SHIFT = 18;
CANDELA_CONST(uint) GAIN_PIECES = 448u;
// AgX: Rec.709 to the primaries in which its curve works; row by row. Source: T. Sobotka's AgX.
#define AGX_INSET                                                                                        \
  0.842479062253094f, 0.0784335999999992f, 0.0792237451477643f, 0.0423282422610123f, 0.878468636469772f, \
      0.0791661274605434f, 0.0423756549057051f, 0.0784336f, 0.879142973793104f
// What the RRT adds of AP1's R, G and B to the other two components. Source: AMPAS aces-dev 1.x, RRT_SAT_MAT.
#define RRT_DESATURATION 0.01088918f, 0.02696327f, 0.00214758f
// Rec.709 to Rec.2020 and to P3-D65, and P3-D65 to Rec.2020; row by row. All have a D65 white. Computed from
// their chromaticities (SMPTE RP 177).
#define REC709_TO_REC2020                                                                           \
  0.627403896f, 0.329283038f, 0.043313066f, 0.069097289f, 0.919540395f, 0.011362316f, 0.016391439f, \
      0.088013308f, 0.895595253f
#define REC709_TO_P3_D65 \
  0.822461969f, 0.177538031f, 0.0f, 0.033194199f, 0.966805801f, 0.0f, 0.017082631f, 0.072397441f, 0.910519929f
#define P3_D65_TO_REC2020                                                                            \
  0.753833034f, 0.198597369f, 0.047569597f, 0.045743849f, 0.941777220f, 0.012478931f, -0.001210340f, \
      0.017601717f, 0.983608623f
// A component counts as cut if it is below minus this part of the colour's largest component. The rounding of
// a file's halves is less than that.
CANDELA_CONST(float) GAMUT_TOLERANCE = 0.00048828125f;  // 2^-11

#ifdef __cplusplus
// The largest factor that exposes the scene. Up to it the arithmetic stays finite; beyond it no curve changes
// any more, not even for the smallest half.
inline constexpr float MAX_EXPOSURE = 0x1p46f;
// gaussian.comp reads this many texels on either side.
inline constexpr uint GAUSSIAN_REACH = 6u;

// The specialisation constants of each shader, in the order of their ids from 0. Booleans are 0 or 1.
struct IngestConstants {
  uint pixels;     // PIXELS_*
  uint matrix;     // the input's primaries are not the scene's
  uint scrub;      // some components are not finite or beyond +-MAX_HALF, on the wire or in the scene
  uint light;      // bloom needs max_light_bits
  uint weights;    // WEIGHTS_*
  uint histogram;  // also fill the histogram
  uint whole;      // the frame's width is a multiple of GROUP_TEXELS
  uint ignore;     // texels darker than IngestParams.ignore_below have no weight
  uint alpha;      // METER_*; unless METER_OPAQUE, absent texels are counted and have no weight
};

struct BrightPassConstants {
  uint pixels;
  uint matrix;
  uint scrub;
  uint bloom;  // BLOOM_*
  uint firefly_weights;
  uint level_size;  // frame texels per level texel, along a side: 2 or 4
  uint whole;
};

struct BloomDownConstants {};

struct BloomUpConstants {
  float fine_weight;  // weight of D_n: 2 if it also stands for a finer level
};

struct GaussianConstants {
  uint vertical;
};

struct ResolveConstants {
  uint pixels;
  uint matrix;
  uint scrub;
  uint bloom;
  uint curve;          // CURVE_*
  uint transfer;       // TRANSFER_*
  uint output_format;  // OUTPUT_*
  uint dither;
  uint level_size;
  uint transfer_terms;  // number of terms of the sRGB transfer's polynomial
  uint wide;     // some scene components are negative; also counts what the curve cuts. Always for PQ and HLG
  uint alpha;    // ALPHA_*; ALPHA_ASSOCIATED if every alpha is 1
  uint display;  // DISPLAY_*; DISPLAY_REC709 unless the transfer is PQ or HLG
  uint unrounded;  // the scene is not rounded to halves
  uint limit;      // DISPLAY_*: in whose primaries aces-2 gives light
  uint gain;       // alpha holds the code of a gain map
};

struct ResizeConstants {
  uint pixels;
  uint matrix;
  uint scrub;
  uint bloom;
  uint level_size;
  uint wide;
  uint unrounded;  // as in ResolveConstants
  uint down;       // along y, from the frame; else along x, from the block that was made so
};

#endif

// Input texels to scene texels; shared by the passes that read the frame.
struct InputParams {
  uint width, height;
  uint input_pitch;  // texels from row to row, a multiple of GROUP_TEXELS
  // Input primaries to Rec.709, row by row; used if the constant `matrix` is set.
  float m00, m01, m02, m10, m11, m12, m20, m21, m22;
};

struct IngestParams {
  InputParams frame;
  uint tiles_lo, tiles_hi;  // one TileRecord per tile, zeroed before the pass adds to it
  uint tiles_x;
  uint histogram_lo, histogram_hi;          // copies of HistogramBin[], zeroed before the pass adds to them
  uint spot_x0, spot_y0, spot_x1, spot_y1;  // only for WEIGHTS_SPOT
  float ignore_below;                       // scene luminance; only if the constant `ignore` is set
};

struct BrightPassParams {
  InputParams frame;
  uint first_row;  // the level's first row in the range bound for writing
  uint level_width;
  float threshold;  // scene luminance
  float knee;       // softness * threshold; only for BLOOM_MIP
};

struct BloomLevelParams {
  uint first_row;  // the written level's first row in the range bound for writing
  uint from_width, from_height;
  uint to_width, to_height;
};

struct GaussianParams {
  uint first_row;      // the written level's first row in the range bound for writing
  uint width, height;  // the size of both levels
};

struct ResolveParams {
  InputParams frame;
  uint first_row;  // the output's first row in the range bound for writing
  uint level_width, level_height;
  uint output_pitch;  // texels from row to row, a multiple of GROUP_TEXELS
  float exposure;     // E * prescale
  float bloom_scale;  // intensity / number of levels
  float scene_scale;  // 1 - intensity; only for BLOOM_CONSERVE
  // reinhard-extended: the luminance that becomes 1. bt2390: the PQ signal of the source's peak. shoulder:
  // that peak in units of white.
  float curve_white;
  uint dither_frame;  // the frame's sequence number, low 32 bits
  uint table_size;    // points a side; only for aces-1 and TABLE
  float table_scale;  // points an octave of the axes, times 2^TABLE_FRACTION_BITS; only for aces-1 and TABLE
  float table_end;    // the light at the end of the axes; only for AXES_AP1
  uint tiles_lo,
      tiles_hi;  // the first TileRecord counts gamut_cut_components; only if the constant `wide` is set
  float background_r, background_g, background_b;  // scene light; only for ALPHA_OVER
  // Only for PQ, HLG and bt2390. The display's peak in units of 10000 nit, the PQ signal of it, and (1 - g) /
  // g for the gamma g of HLG's OOTF.
  float display_peak;
  float peak_signal;
  float hlg_exponent;
};

struct ResizeParams {
  InputParams frame;
  uint first_row;  // the output's first row in the range bound for writing
  uint level_width, level_height;
  float bloom_scale;  // as in ResolveParams, and the next one
  float scene_scale;
  uint from, to;    // texels of the axis before and after
  uint mean;        // an output is the mean of this many texels; 0: it is weighted
  uint taps;        // weights of an output
  uint weights;     // the first of the axis
  uint block_row;   // the image's row that is the block's first
  uint from_pitch;  // texels from row to row of the block; only along x
  uint to_pitch;    // texels from row to row of the output
};

// The statistics of one tile of the frame. All zeros is the empty record: a minimum is stored as the maximum
// of the complement.
struct TileRecord {
  uint log2_sum_low;  // sums of the low 16 and of the remaining bits of each invocation's weighted
                      // fixed-point sum
  uint log2_sum_high;
  uint weight_sum;  // left 0 with WEIGHTS_AVERAGE, unless dark or absent texels have no weight
  uint max_luminance_bits;
  uint min_luminance_bits_inverted;
  // The largest magnitude of R, G and B on the wire and, with the constant `matrix`, in the scene, and of
  // alpha with the constant `alpha`. If it is larger than MAX_HALF, the frame needs the scrub. For halves on
  // the wire it is either 0 or infinity; without the constants `alpha` and `scrub` it may be infinity because
  // of an alpha other than 1.
  uint max_magnitude_bits;
  uint negative_components;
  uint max_light_bits;  // the largest luminance with negative components cut to 0; only if LIGHT is set
  // These four are counted only with the scrub.
  uint nan_components;
  uint infinite_components;
  uint clamped_components;  // finite and beyond +-MAX_LIGHT, on the wire or after the matrix
  // ~(y * width + x) of the first texel with a component in R, G or B that is one of these
  uint first_bad_texel_inverted;
  uint negative_scene_components;  // of R, G and B; counted only if the constant `matrix` is set
  // The components of the whole frame that the curve cut. Only in the first record, and only after resolve.
  uint gamut_cut_components;
  // The bits of the largest exposed light that a component of the frame has below 0, before bloom. Only in
  // the first record, and only after resolve.
  uint negative_light_bits;
  // Of an image in PQ or HLG, in units of the display's peak: the bits of the largest component of its light,
  // and sums of the low SHOWN_LOW_BITS and of the remaining bits of what its invocations add of each texel's
  // largest component times SHOWN_SCALE. Only in the first record, and only after resolve.
  uint shown_max_bits;
  uint shown_sum_low;
  uint shown_sum_high;
  // Not 0 if some alpha on the wire is not 1; left 0 with the constant `alpha`. For halves without the
  // constant `scrub`, -1 counts only as infinite.
  uint alpha_differs;
  uint absent_texels;  // counted only with the constant `alpha`
  // With METER_COVERAGE: 1 if some texel has an alpha above 0, plus 2 if some texel has one between 0 and 1,
  // all rounded to 255 steps.
  uint coverage;
};

struct HistogramBin {
  uint weight;
  uint offset_sum;  // the texels' offsets within the bin, in 2^-LOG2_FRACTION_BITS; for WEIGHTS_CENTER times
                    // the weight / 256, else with METER_COVERAGE times the weight / 255
};

#ifdef __cplusplus
}  // namespace candela::shader
#endif
#undef CANDELA_CONST
