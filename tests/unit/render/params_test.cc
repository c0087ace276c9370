// shaders/params.h means the same to GLSL and to C++: the offsets of its structs, and the ids of its
// specialisation constants, are those of the SPIR-V.
#include "shaders/params.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstring>
#include <map>
#include <span>
#include <string>

#include "shaders/bloom_down.spv.h"
#include "shaders/bloom_up.spv.h"
#include "shaders/bright_pass.spv.h"
#include "shaders/gaussian.spv.h"
#include "shaders/ingest.spv.h"
#include "shaders/resize.spv.h"
#include "shaders/resolve.spv.h"

namespace candela {
namespace {

// Maps a struct's member names to byte offsets.
using Offsets = std::map<std::string, uint32_t>;

std::string text(std::span<const uint32_t> words) {
  const std::string bytes(reinterpret_cast<const char*>(words.data()), words.size_bytes());
  return bytes.c_str();
}

// Maps the names of the structs that SPIR-V decorates to their offsets. Several types can have one name;
// those without offsets are copies inside functions.
std::map<std::string, Offsets> structs(std::span<const uint32_t> spirv) {
  constexpr uint32_t kOpName = 5;
  constexpr uint32_t kOpMemberName = 6;
  constexpr uint32_t kOpMemberDecorate = 72;
  constexpr uint32_t kDecorationOffset = 35;
  std::map<uint32_t, std::string> names;
  std::map<uint32_t, std::map<uint32_t, std::string>> members;
  std::map<std::string, Offsets> found;
  for (size_t at = 5; at < spirv.size(); at += spirv[at] >> 16) {
    const std::span<const uint32_t> op = spirv.subspan(at, spirv[at] >> 16);
    const uint32_t code = op[0] & 0xffff;
    if (code == kOpName) names[op[1]] = text(op.subspan(2));
    if (code == kOpMemberName) members[op[1]][op[2]] = text(op.subspan(3));
    if (code == kOpMemberDecorate && op[3] == kDecorationOffset)
      found[names[op[1]]][members[op[1]][op[2]]] = op[4];
  }
  return found;
}

// Maps the names of the specialisation constants that SPIR-V decorates to their ids.
std::map<std::string, uint32_t> constant_ids(std::span<const uint32_t> spirv) {
  constexpr uint32_t kOpName = 5;
  constexpr uint32_t kOpDecorate = 71;
  constexpr uint32_t kDecorationSpecId = 1;
  std::map<uint32_t, std::string> names;
  std::map<std::string, uint32_t> ids;
  for (size_t at = 5; at < spirv.size(); at += spirv[at] >> 16) {
    const std::span<const uint32_t> op = spirv.subspan(at, spirv[at] >> 16);
    const uint32_t code = op[0] & 0xffff;
    if (code == kOpName) names[op[1]] = text(op.subspan(2));
    if (code == kOpDecorate && op[2] == kDecorationSpecId) ids[names[op[1]]] = op[3];
  }
  return ids;
}

// Expects that the constant's id is the position of the struct's member.
#define EXPECT_CONSTANT(ids, Struct, member, NAME)        \
  ASSERT_TRUE(ids.contains(NAME)) << #Struct "." #member; \
  EXPECT_EQ(ids[NAME] * 4, offsetof(shader::Struct, member)) << #Struct "." #member

#define EXPECT_OFFSET(all, Struct, member)                            \
  ASSERT_TRUE(all[#Struct].contains(#member)) << #Struct "." #member; \
  EXPECT_EQ(all[#Struct][#member], offsetof(shader::Struct, member)) << #Struct "." #member

TEST(Params, OffsetsAreThoseOfTheSpirv) {
  auto ingest = structs(k_ingest_spirv);
  EXPECT_EQ(ingest["IngestParams"].size(), 11u);
  EXPECT_OFFSET(ingest, InputParams, width);
  EXPECT_OFFSET(ingest, InputParams, input_pitch);
  EXPECT_OFFSET(ingest, InputParams, m00);
  EXPECT_OFFSET(ingest, InputParams, m22);
  EXPECT_OFFSET(ingest, IngestParams, frame);
  EXPECT_OFFSET(ingest, IngestParams, tiles_hi);
  EXPECT_OFFSET(ingest, IngestParams, tiles_x);
  EXPECT_OFFSET(ingest, IngestParams, histogram_hi);
  EXPECT_OFFSET(ingest, IngestParams, spot_y1);
  EXPECT_OFFSET(ingest, IngestParams, ignore_below);
  EXPECT_OFFSET(ingest, HistogramBin, offset_sum);
  EXPECT_OFFSET(ingest, TileRecord, log2_sum_low);
  EXPECT_OFFSET(ingest, TileRecord, max_magnitude_bits);
  EXPECT_OFFSET(ingest, TileRecord, max_light_bits);
  EXPECT_OFFSET(ingest, TileRecord, first_bad_texel_inverted);
  EXPECT_EQ(ingest["TileRecord"].size() * 4, sizeof(shader::TileRecord));

  for (const std::span<const uint32_t> spirv :
       {std::span<const uint32_t>(k_bloom_down_spirv), std::span<const uint32_t>(k_bloom_up_spirv)}) {
    auto bloom = structs(spirv);
    EXPECT_EQ(bloom["BloomLevelParams"].size() * 4, sizeof(shader::BloomLevelParams));
    EXPECT_OFFSET(bloom, BloomLevelParams, first_row);
    EXPECT_OFFSET(bloom, BloomLevelParams, to_height);
  }

  auto bright_pass = structs(k_bright_pass_spirv);
  EXPECT_OFFSET(bright_pass, BrightPassParams, frame);
  EXPECT_OFFSET(bright_pass, BrightPassParams, first_row);
  EXPECT_OFFSET(bright_pass, BrightPassParams, knee);

  auto gaussian = structs(k_gaussian_spirv);
  EXPECT_EQ(gaussian["GaussianParams"].size() * 4, sizeof(shader::GaussianParams));
  EXPECT_OFFSET(gaussian, GaussianParams, first_row);
  EXPECT_OFFSET(gaussian, GaussianParams, height);

  auto resize = structs(k_resize_spirv);
  EXPECT_EQ((resize["InputParams"].size() + resize["ResizeParams"].size() - 1) * 4,
            sizeof(shader::ResizeParams));
  EXPECT_OFFSET(resize, ResizeParams, frame);
  EXPECT_OFFSET(resize, ResizeParams, first_row);
  EXPECT_OFFSET(resize, ResizeParams, scene_scale);
  EXPECT_OFFSET(resize, ResizeParams, to_pitch);

  auto resolve = structs(k_resolve_spirv);
  EXPECT_OFFSET(resolve, ResolveParams, frame);
  EXPECT_OFFSET(resolve, ResolveParams, first_row);
  EXPECT_OFFSET(resolve, ResolveParams, output_pitch);
  EXPECT_OFFSET(resolve, ResolveParams, exposure);
  EXPECT_OFFSET(resolve, ResolveParams, bloom_scale);
  EXPECT_OFFSET(resolve, ResolveParams, dither_frame);
  EXPECT_OFFSET(resolve, ResolveParams, table_end);
  EXPECT_OFFSET(resolve, ResolveParams, tiles_hi);
  EXPECT_OFFSET(resolve, TileRecord, gamut_cut_components);
}

TEST(Params, ConstantsHaveTheIdsOfTheirPlaces) {
  auto ingest = constant_ids(k_ingest_spirv);
  EXPECT_EQ(ingest.size() * 4, sizeof(shader::IngestConstants));
  EXPECT_CONSTANT(ingest, IngestConstants, pixels, "PIXELS");
  EXPECT_CONSTANT(ingest, IngestConstants, matrix, "MATRIX");
  EXPECT_CONSTANT(ingest, IngestConstants, scrub, "SCRUB");
  EXPECT_CONSTANT(ingest, IngestConstants, light, "LIGHT");
  EXPECT_CONSTANT(ingest, IngestConstants, weights, "WEIGHTS");
  EXPECT_CONSTANT(ingest, IngestConstants, histogram, "HISTOGRAM");
  EXPECT_CONSTANT(ingest, IngestConstants, whole, "WHOLE");
  EXPECT_CONSTANT(ingest, IngestConstants, ignore, "IGNORE");
  EXPECT_CONSTANT(ingest, IngestConstants, alpha, "ALPHA");

  auto bright = constant_ids(k_bright_pass_spirv);
  EXPECT_EQ(bright.size() * 4, sizeof(shader::BrightPassConstants));
  EXPECT_CONSTANT(bright, BrightPassConstants, pixels, "PIXELS");
  EXPECT_CONSTANT(bright, BrightPassConstants, matrix, "MATRIX");
  EXPECT_CONSTANT(bright, BrightPassConstants, scrub, "SCRUB");
  EXPECT_CONSTANT(bright, BrightPassConstants, bloom, "BLOOM");
  EXPECT_CONSTANT(bright, BrightPassConstants, firefly_weights, "FIREFLY_WEIGHTS");
  EXPECT_CONSTANT(bright, BrightPassConstants, level_size, "LEVEL_SIZE");
  EXPECT_CONSTANT(bright, BrightPassConstants, whole, "WHOLE");

  EXPECT_TRUE(constant_ids(k_bloom_down_spirv).empty());
  auto up = constant_ids(k_bloom_up_spirv);
  EXPECT_EQ(up.size() * 4, sizeof(shader::BloomUpConstants));
  EXPECT_CONSTANT(up, BloomUpConstants, fine_weight, "FINE_WEIGHT");
  auto gaussian = constant_ids(k_gaussian_spirv);
  EXPECT_EQ(gaussian.size() * 4, sizeof(shader::GaussianConstants));
  EXPECT_CONSTANT(gaussian, GaussianConstants, vertical, "VERTICAL");

  auto resize = constant_ids(k_resize_spirv);
  EXPECT_EQ(resize.size() * 4, sizeof(shader::ResizeConstants));
  EXPECT_CONSTANT(resize, ResizeConstants, pixels, "PIXELS");
  EXPECT_CONSTANT(resize, ResizeConstants, matrix, "MATRIX");
  EXPECT_CONSTANT(resize, ResizeConstants, scrub, "SCRUB");
  EXPECT_CONSTANT(resize, ResizeConstants, bloom, "BLOOM");
  EXPECT_CONSTANT(resize, ResizeConstants, level_size, "LEVEL_SIZE");
  EXPECT_CONSTANT(resize, ResizeConstants, wide, "WIDE");
  EXPECT_CONSTANT(resize, ResizeConstants, down, "DOWN");

  auto resolve = constant_ids(k_resolve_spirv);
  EXPECT_EQ(resolve.size() * 4, sizeof(shader::ResolveConstants));
  EXPECT_CONSTANT(resolve, ResolveConstants, pixels, "PIXELS");
  EXPECT_CONSTANT(resolve, ResolveConstants, matrix, "MATRIX");
  EXPECT_CONSTANT(resolve, ResolveConstants, scrub, "SCRUB");
  EXPECT_CONSTANT(resolve, ResolveConstants, bloom, "BLOOM");
  EXPECT_CONSTANT(resolve, ResolveConstants, curve, "CURVE");
  EXPECT_CONSTANT(resolve, ResolveConstants, transfer, "TRANSFER");
  EXPECT_CONSTANT(resolve, ResolveConstants, output_format, "OUTPUT");
  EXPECT_CONSTANT(resolve, ResolveConstants, dither, "DITHER");
  EXPECT_CONSTANT(resolve, ResolveConstants, level_size, "LEVEL_SIZE");
  EXPECT_CONSTANT(resolve, ResolveConstants, transfer_terms, "TRANSFER_TERMS");
  EXPECT_CONSTANT(resolve, ResolveConstants, wide, "WIDE");
}

}  // namespace
}  // namespace candela
