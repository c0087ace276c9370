// The specialisation constants in shaders/params.h have the numbers that the contract's enums give the same
// names.
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "candela/v1/render.pb.h"
#include "proto/candela/v1/pixel_size.h"
#include "shaders/params.h"

namespace candela {
namespace {

// Frames without alpha are kept with one.
bool is_for_bands_only(const google::protobuf::EnumValueDescriptor& value) {
  const auto format = static_cast<v1::PixelFormat>(value.number());
  return value.type() == v1::PixelFormat_descriptor() && v1::with_alpha(format) != format;
}

struct Constants {
  const google::protobuf::EnumDescriptor* type;
  std::string prefix;                     // of the values' names in the contract
  std::map<std::string, uint32_t> known;  // the rest of the name, and the shaders' number
};

#define NAMED(prefix, name) \
  { #name, shader::prefix##_##name }

const Constants kConstants[] = {
    {v1::PixelFormat_descriptor(),
     "PIXEL_FORMAT_",
     {NAMED(PIXELS, RGBA16F), NAMED(PIXELS, RGBA32F), NAMED(PIXELS, RGB9E5)}},
    {v1::OutputFormat_descriptor(),
     "OUTPUT_FORMAT_",
     {NAMED(OUTPUT, RGBA8), NAMED(OUTPUT, RGBA16), NAMED(OUTPUT, RGBA16F)}},
    {v1::ToneCurve_descriptor(),
     "TONE_CURVE_",
     {NAMED(CURVE, LINEAR), NAMED(CURVE, REINHARD), NAMED(CURVE, ACES_NARKOWICZ), NAMED(CURVE, ACES_HILL),
      NAMED(CURVE, REINHARD_EXTENDED), NAMED(CURVE, HABLE), NAMED(CURVE, AGX), NAMED(CURVE, PBR_NEUTRAL),
      NAMED(CURVE, ACES_1), NAMED(CURVE, ACES_2), NAMED(CURVE, BT2390), NAMED(CURVE, TABLE)}},
    {v1::Metering::Weights_descriptor(),
     "WEIGHTS_",
     {NAMED(WEIGHTS, AVERAGE), NAMED(WEIGHTS, CENTER), NAMED(WEIGHTS, SPOT)}},
    {v1::Bloom::Kind_descriptor(),
     "KIND_",
     {NAMED(BLOOM, MIP), NAMED(BLOOM, CONSERVE), NAMED(BLOOM, GAUSSIAN)}},
    {v1::Transfer_descriptor(),
     "TRANSFER_",
     {NAMED(TRANSFER, SRGB), NAMED(TRANSFER, GAMMA22), NAMED(TRANSFER, LINEAR), NAMED(TRANSFER, PQ),
      NAMED(TRANSFER, HLG)}},
    {v1::Alpha_descriptor(),
     "ALPHA_",
     {NAMED(ALPHA, ASSOCIATED), NAMED(ALPHA, STRAIGHT), NAMED(ALPHA, OVER), NAMED(ALPHA, IGNORE)}},
    {v1::ColorTable::Axes_descriptor(), "AXES_", {NAMED(AXES, ACES), NAMED(AXES, REC709), NAMED(AXES, AP1)}},
};
#undef NAMED

TEST(WireConstants, EveryValueOfAnEnumHasAConstantWithItsNumber) {
  for (const Constants& constants : kConstants) {
    std::map<std::string, uint32_t> contract;
    for (int i = 0; i < constants.type->value_count(); ++i) {
      const google::protobuf::EnumValueDescriptor& value = *constants.type->value(i);
      if (value.number() == 0 || is_for_bands_only(value)) continue;
      ASSERT_EQ(value.name().rfind(constants.prefix, 0), 0u) << value.full_name();
      contract[value.name().substr(constants.prefix.size())] = static_cast<uint32_t>(value.number());
    }
    EXPECT_EQ(constants.known, contract) << constants.type->full_name() << " and shaders/params.h differ";
  }
}

// The shaders' own values are none of the contract's.
TEST(WireConstants, ValuesOfTheShadersAloneAreNotOnTheWire) {
  EXPECT_FALSE(v1::OutputFormat_IsValid(shader::OUTPUT_FLOAT));
  EXPECT_FALSE(v1::ToneCurve_IsValid(shader::CURVE_TABLE_REC709));
  EXPECT_EQ(shader::BLOOM_NONE, static_cast<uint32_t>(v1::Bloom::KIND_UNSPECIFIED));
}

}  // namespace
}  // namespace candela
