// The parameters and constants of environments (docs/environments.md) that the host and the shaders share,
// after the rules of params.h.
#ifdef __cplusplus
#pragma once
#include "shaders/params.h"
namespace candela::shader {
#define CANDELA_CONST(type) inline constexpr type
#else
#define CANDELA_CONST(type) const type
#endif

// A pass of an environment writes one range of its output after another. Each of its work groups is a row of
// ENVIRONMENT_GROUP invocations.
CANDELA_CONST(uint) ENVIRONMENT_GROUP = 64u;
// A cube level is stored with a border of one texel around each face, so that a lookup needs no neighbouring
// face: face by face, row by row, size + 2 texels a row. A border texel holds the texel across the edge, or
// at a corner the mean of the three that meet there. Levels follow each other in one buffer. Level `level`,
// with `n` texels a side, begins at this texel of a chain whose level 0 has `size` a side: a multiple of 16.
#define CUBE_LEVEL_START(size, n, level) \
  (8u * ((size) * (size) - (n) * (n)) + 56u * ((size) - (n)) + 32u * (level))
// panorama_sh: a row of the panorama becomes this many partial sums of 16 floats each.
CANDELA_CONST(uint) SH_PARTS = 32u;
// brdf_table: texels a side, and the points of its quadrature.
CANDELA_CONST(uint) BRDF_SIZE = 128u;
CANDELA_CONST(uint) BRDF_POLAR_POINTS = 64u;
CANDELA_CONST(uint) BRDF_ROUND_POINTS = 16u;
// view: a work group of VIEW_TILE x VIEW_TILE invocations draws the objects in a tile of as many pixels, or
// the sky in VIEW_SKY_X x VIEW_TILE pixels.
CANDELA_CONST(uint) VIEW_TILE = 8u;
CANDELA_CONST(uint) VIEW_SKY_X = 256u;
CANDELA_CONST(uint) VIEW_OBJECTS = 64u;

#ifdef __cplusplus
// The specialisation constants of each shader, as in params.h.
struct PanoramaConstants {
  uint pixels;  // PIXELS_*
  uint matrix;
  uint floats;  // of the texels that it writes
};

// Of cube_face and panorama_sh.
struct PanoramaReadConstants {
  uint floats;  // the panorama's texels are floats
};

struct ViewConstants {
  uint objects;    // draws objects, over the sky
  uint magnified;  // the sky is level 0; used without objects
  uint sharp;      // reads the chain; used with objects
  uint rough;      // reads specular levels; used with objects
  uint samples;    // the view has more than one sample; used with objects
  uint floats;     // it writes floats
};
#endif

// What a pass of an environment writes: invocations `first` to `first + count - 1` of the whole pass. The
// output of the first one is the beginning of the range bound for writing.
struct PassRange {
  uint first;
  uint count;
};

// A panorama as the shaders read it: RGBA halves, or floats if it has light that no half holds.
struct PanoramaLayout {
  uint width, height;
  uint pitch;           // texels from row to row, a multiple of GROUP_TEXELS
  uint turn;            // lookups go this many texels to the right, 0 .. width - 1,
  float turn_fraction;  // and this part of one
};

// An invocation makes GROUP_TEXELS texels.
struct PanoramaParams {
  InputParams frame;
  PassRange range;
  uint counts_lo, counts_hi;  // a PanoramaCounts, zeroed before the pass adds to it
};

// An invocation makes one texel of a level, counted with the border.
struct CubeFaceParams {
  PanoramaLayout panorama;
  PassRange range;
  uint size;
  uint samples;  // K: sub-texels along a side
};

// The same. `from` is the level above in the same chain, of 2 * size texels a side.
struct CubeDownParams {
  PassRange range;
  uint size;
  uint from;  // its first texel
};

// An invocation adds up every SH_PARTS-th pair of texels of a row.
struct PanoramaShParams {
  PanoramaLayout panorama;
  PassRange range;
};

// An invocation makes one texel of a level, counted with the border.
struct CubeSpecularParams {
  PassRange range;
  uint size;
  uint chain_size, chain_last;  // of the chain's level 0, and the last level, of 1 x 1
  float alpha2;                 // alpha^2
  float detail2;  // the square of the largest side of a texel that is taken whole, by what k changes over
};

// An invocation makes four pairs of a row.
struct BrdfTableParams {
  PassRange range;
};

struct ViewParams {
  uint first_row;  // the first row in the range bound for writing
  uint width, height;
  uint pitch;         // texels from row to row, a multiple of GROUP_TEXELS
  uint samples_side;  // g
  float pixel;        // p
  float lod;          // log2(p N / 2)
  uint chain_size, chain_last;
  uint first_object, end_object;  // those that a work group may show; used with objects
  // Camera axes to those of the environment, which is turned; row by row.
  float m00, m01, m02, m10, m11, m12, m20, m21, m22;
};

// A sphere as the view's shader needs it, in camera axes. The shader reads it four words at a time.
struct ViewObject {
  float ox, oy, oz;  // from the centre to the camera
  float radius_squared;
  float to_surface;  // |o|^2 - radius^2
  float inverse_radius;
  float chain_weight;  // of level 0; the rest is that of two specular levels
  float near_weight;
  float f0_r, f0_g, f0_b;
  float far_weight;
  float diffuse_r, diffuse_g, diffuse_b;  // (1 - metallic) base_color / pi
  uint near_start;                        // texels
  uint near_size, far_start, far_size;
  uint unused;
  float brdf[4u * BRDF_SIZE];  // (scale, bias) at its roughness, and those of the next column
};

// A view's scene is a ViewLight and its objects.
struct ViewLight {
  // Irr(n) is the sum of these times 1, y, z, x, x y, y z, 3 z^2 - 1, x z, x^2 - y^2; R, G, B and 0 each.
  float irradiance[36];
};

// What panorama found on the wire, in R, G and B.
struct PanoramaCounts {
  uint nan_components;
  uint infinite_components;
  uint negative_components;
  uint clamped_components;        // as in TileRecord
  uint first_bad_texel_inverted;  // as in TileRecord
  uint max_scene_bits;            // the largest magnitude of R, G and B in the scene
};

#ifdef __cplusplus
}  // namespace candela::shader
#endif
#undef CANDELA_CONST
