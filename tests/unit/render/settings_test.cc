// Declarations of settings, and how a message of settings is completed and checked. Everything but the list
// of today's defaults goes through reflection, so that a new setting is tested without a line here.
#include "proto/candela/v1/settings.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/render/color/primaries.h"
#include "server/render/settings/settings.h"
#include "shaders/params.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::v1 {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Options that set several settings.
const std::map<std::string, int> kSharedFlags = {{"exposure", 2}, {"percentiles", 2}, {"background", 3}};

Settings with_number(const SettingField& setting, double value) {
  Settings settings;
  setting.set_number(setting.holder(settings), value);
  return settings;
}

// The field of the setting's message with this name; null if there is none.
const FieldDescriptor* sibling(const SettingField& setting, const std::string& name) {
  return setting.field->containing_type()->FindFieldByName(name);
}

void choose(Settings& settings, const SettingField& setting, const Setting::Exception& exception) {
  const FieldDescriptor& choice = *sibling(setting, exception.choice());
  Message& holder = setting.holder(settings);
  for (int i = 0; i < choice.enum_type()->value_count(); ++i) {
    const int number = choice.enum_type()->value(i)->number();
    if (enum_word(*choice.enum_type(), number) == exception.word()) {
      holder.GetReflection()->SetEnumValue(&holder, &choice, number);
    }
  }
}

// The nearest number of the field's type beyond `from`, in the direction of `to`.
double next_number(const SettingField& setting, double from, double to) {
  if (setting.is_whole_number()) return from + (to > from ? 1 : -1);
  if (setting.field->cpp_type() == FieldDescriptor::CPPTYPE_FLOAT) {
    return std::nextafter(static_cast<float>(from), static_cast<float>(to));
  }
  return std::nextafter(from, to);
}

void expect_refused(const SettingField& setting, Settings settings, double value, double min, double max,
                    const std::string& condition = "") {
  const absl::Status status = complete_settings(settings);
  EXPECT_REFUSED(kInvalidArgument, "", status) << setting.path << " " << value;
  EXPECT_EQ(status.message(), absl::StrFormat("%s is %g; %sit must be between %s and %s", setting.path, value,
                                              condition, format_number(min), format_number(max)));
}

// Everything at a value that the user could have given: numbers at their maximum, choices at their last
// value.
Settings everything_given() {
  Settings settings;
  for (const SettingField& setting : setting_fields()) {
    Message& holder = setting.holder(settings);
    const google::protobuf::Reflection& reflection = *holder.GetReflection();
    if (setting.is_number()) {
      double max = setting.declaration().max();
      for (const Setting::Exception& exception : setting.declaration().except()) {
        if (exception.has_max()) max = std::min(max, exception.max());
      }
      setting.set_number(holder, max);
    } else if (setting.field->cpp_type() == FieldDescriptor::CPPTYPE_ENUM) {
      const google::protobuf::EnumDescriptor& type = *setting.field->enum_type();
      reflection.SetEnumValue(&holder, setting.field, type.value(type.value_count() - 1)->number());
    } else if (setting.field->cpp_type() == FieldDescriptor::CPPTYPE_BOOL) {
      reflection.SetBool(&holder, setting.field, setting.declaration().default_() == 0);
    } else if (setting.field->cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
      reflection.SetString(&holder, setting.field, "given");
    }
  }
  return settings;
}

TEST(Settings, EachDeclarationIsComplete) {
  EXPECT_GT(setting_fields().size(), 20u);
  for (const SettingField& setting : setting_fields()) {
    const Setting& declaration = setting.declaration();
    EXPECT_FALSE(declaration.group().empty()) << setting.path;
    EXPECT_FALSE(declaration.help().empty()) << setting.path;
    EXPECT_EQ(declaration.help().find('\n'), std::string::npos) << setting.path;
    const bool is_choice = setting.field->cpp_type() == FieldDescriptor::CPPTYPE_ENUM;
    if (is_choice && !declaration.default_word().empty()) {
      const std::vector<std::string> words = enum_words(*setting.field->enum_type());
      EXPECT_EQ(std::count(words.begin(), words.end(), declaration.default_word()), 1) << setting.path;
    }
    for (const std::string& word : declaration.words()) {
      ASSERT_TRUE(is_choice) << setting.path;
      const std::vector<std::string> all = enum_words(*setting.field->enum_type());
      EXPECT_EQ(std::count(all.begin(), all.end(), word), 1) << setting.path << " " << word;
    }
    if (!setting.is_number()) continue;
    EXPECT_LT(declaration.min(), declaration.max()) << setting.path;
    EXPECT_TRUE(setting.field->has_presence()) << setting.path << ": absent and 0 must differ";
    if (!declaration.has_default_()) continue;
    EXPECT_GE(declaration.default_(), declaration.min()) << setting.path;
    EXPECT_LE(declaration.default_(), declaration.max()) << setting.path;
  }
}

TEST(Settings, EachExceptionNamesAChoiceOfTheSameMessage) {
  for (const SettingField& setting : setting_fields()) {
    const Setting& declaration = setting.declaration();
    for (const Setting::Exception& exception : declaration.except()) {
      const FieldDescriptor* choice = sibling(setting, exception.choice());
      ASSERT_NE(choice, nullptr) << setting.path << " " << exception.choice();
      ASSERT_EQ(choice->cpp_type(), FieldDescriptor::CPPTYPE_ENUM) << setting.path;
      const std::vector<std::string> words = enum_words(*choice->enum_type());
      EXPECT_EQ(std::count(words.begin(), words.end(), exception.word()), 1)
          << setting.path << " " << exception.word();
      EXPECT_TRUE(exception.has_min() || exception.has_max() || exception.has_default_() ||
                  !exception.default_word().empty())
          << setting.path;
      if (!exception.default_word().empty()) {
        const std::vector<std::string> own = enum_words(*setting.field->enum_type());
        EXPECT_EQ(std::count(own.begin(), own.end(), exception.default_word()), 1) << setting.path;
      }
      if (!setting.is_number()) continue;
      const double min = exception.has_min() ? exception.min() : declaration.min();
      const double max = exception.has_max() ? exception.max() : declaration.max();
      const double initial = exception.has_default_() ? exception.default_() : declaration.default_();
      EXPECT_LT(min, max) << setting.path;
      EXPECT_GE(initial, min) << setting.path;
      EXPECT_LE(initial, max) << setting.path;
    }
  }
}

TEST(Settings, EachOptionSetsOneSettingOrIsKnownToSetMore) {
  std::map<std::string, int> flags;
  for (const SettingField& setting : setting_fields()) {
    if (!setting.declaration().flag().empty()) ++flags[setting.declaration().flag()];
  }
  for (const auto& [flag, count] : flags) {
    EXPECT_EQ(count, kSharedFlags.count(flag) != 0 ? kSharedFlags.at(flag) : 1) << flag;
  }
}

// A default that changes gives the same request another image. A new setting's default joins the list.
TEST(Settings, AbsentSettingsTakeTheirDefaults) {
  constexpr char kDefaults[] = R"pb(
    exposure {
      mode: MODE_AUTO
      manual_ev: 0
      compensation_ev: 0
      key: 0.18
      min_exposure: 0.015625
      max_exposure: 64
      metering {
        statistic: STATISTIC_LOG_AVERAGE
        percentile_low: 10
        percentile_high: 90
        weights: WEIGHTS_AVERAGE
        ignore_below: 0
      }
      adaptation { domain: DOMAIN_LOG speed_up: 3 speed_down: 1 }
    }
    bloom { intensity: 0.05 threshold: 1 softness: 0.5 levels: 5 firefly_weights: true kind: KIND_MIP }
    curve: TONE_CURVE_ACES_HILL
    prescale: 1
    transfer: TRANSFER_SRGB
    output_format: OUTPUT_FORMAT_RGBA8
    bad_values: BAD_VALUES_SCRUB
    tier: "standard"
    curve_white: 4
    alpha: ALPHA_ASSOCIATED
    background { red: 0 green: 0 blue: 0 }
  )pb";
  Settings expected;
  ASSERT_TRUE(google::protobuf::TextFormat::ParseFromString(kDefaults, &expected));
  Settings completed;
  ASSERT_OK(complete_settings(completed));
  EXPECT_EQ(completed.DebugString(), expected.DebugString());
}

TEST(Settings, ASettingWithoutADefaultStaysAbsent) {
  Settings completed;
  ASSERT_OK(complete_settings(completed));
  EXPECT_FALSE(completed.has_max_error_codes());
  EXPECT_FALSE(completed.has_input_chromaticities());
  EXPECT_FALSE(completed.has_table());
  EXPECT_FALSE(completed.exposure().metering().has_spot());
  EXPECT_EQ(completed.input_primaries(), PRIMARIES_UNSPECIFIED);
}

TEST(Settings, AnotherDefaultHoldsWithTheChoiceThatItNames) {
  Settings settings;
  settings.mutable_bloom()->set_kind(Bloom::KIND_GAUSSIAN);
  ASSERT_OK(complete_settings(settings));
  EXPECT_EQ(settings.bloom().threshold(), 8.0f);
  settings.mutable_bloom()->set_threshold(2);
  ASSERT_OK(complete_settings(settings));
  EXPECT_EQ(settings.bloom().threshold(), 2.0f);
  Settings hdr;
  hdr.set_transfer(TRANSFER_PQ);
  ASSERT_OK(complete_settings(hdr));
  EXPECT_EQ(hdr.curve(), TONE_CURVE_BT2390);
  EXPECT_EQ(hdr.peak_nits(), 1000);
  hdr.set_curve(TONE_CURVE_LINEAR);
  ASSERT_OK(complete_settings(hdr));
  EXPECT_EQ(hdr.curve(), TONE_CURVE_LINEAR);
}

TEST(Settings, WhatIsGivenStaysAsItIs) {
  const Settings given = everything_given();
  Settings completed = given;
  ASSERT_OK(complete_settings(completed));
  EXPECT_EQ(completed.DebugString(), given.DebugString());
}

TEST(Settings, CompletingTwiceChangesNothing) {
  Settings once;
  ASSERT_OK(complete_settings(once));
  Settings twice = once;
  ASSERT_OK(complete_settings(twice));
  EXPECT_EQ(deterministic_bytes(twice), deterministic_bytes(once));
}

TEST(Settings, EachNumberIsAcceptedUpToBothEndsOfItsRange) {
  for (const SettingField& setting : setting_fields()) {
    if (!setting.is_number()) continue;
    for (const double end : {setting.declaration().min(), setting.declaration().max()}) {
      Settings settings = with_number(setting, end);
      EXPECT_OK(complete_settings(settings)) << setting.path << " " << end;
    }
  }
}

TEST(Settings, EachNumberIsRefusedBeyondBothEndsOfItsRange) {
  for (const SettingField& setting : setting_fields()) {
    if (!setting.is_number()) continue;
    const double min = setting.declaration().min();
    const double max = setting.declaration().max();
    std::vector<double> bad = {next_number(setting, max, kInfinity)};
    if (!setting.is_whole_number() || min > 0) bad.push_back(next_number(setting, min, -kInfinity));
    if (!setting.is_whole_number()) bad.insert(bad.end(), {std::nan(""), kInfinity, -kInfinity});
    for (const double value : bad) expect_refused(setting, with_number(setting, value), value, min, max);
  }
}

TEST(Settings, AnotherRangeHoldsWithTheChoiceThatItNames) {
  int tested = 0;
  for (const SettingField& setting : setting_fields()) {
    for (const Setting::Exception& exception : setting.declaration().except()) {
      if (!exception.has_min() && !exception.has_max()) continue;
      const double min = exception.has_min() ? exception.min() : setting.declaration().min();
      const double max = exception.has_max() ? exception.max() : setting.declaration().max();
      for (const auto& [end, outside] : {std::pair(min, -kInfinity), std::pair(max, kInfinity)}) {
        Settings at = with_number(setting, end);
        choose(at, setting, exception);
        EXPECT_OK(complete_settings(at)) << setting.path;
        const double beyond = next_number(setting, end, outside);
        Settings refused = with_number(setting, beyond);
        choose(refused, setting, exception);
        expect_refused(setting, refused, beyond, min, max, "with " + exception.word() + " ");
      }
      ++tested;
    }
  }
  EXPECT_GT(tested, 0);
}

TEST(Settings, AChoiceThatTakesSomeWordsOfItsEnumListsThese) {
  const auto words_at = [](const std::string& path) {
    std::vector<std::string> words;
    for (const SettingField& setting : setting_fields()) {
      const SettingInfo info = setting_info(setting);
      if (setting.path != path) continue;
      for (const SettingInfo::Choice& choice : info.choices()) words.push_back(choice.word());
    }
    return words;
  };
  EXPECT_EQ(words_at("display_primaries"), (std::vector<std::string>{"rec2020", "p3-d65"}));
  EXPECT_EQ(words_at("limit_primaries"), (std::vector<std::string>{"rec2020", "p3-d65"}));
  EXPECT_EQ(words_at("input_primaries").size(), 6u);
}

TEST(Settings, AnUnknownChoiceIsRefusedByNameAndNumber) {
  for (const SettingField& setting : setting_fields()) {
    if (setting.field->cpp_type() != FieldDescriptor::CPPTYPE_ENUM) continue;
    Settings settings;
    Message& holder = setting.holder(settings);
    holder.GetReflection()->SetEnumValue(&holder, setting.field, 4711);
    EXPECT_EQ(
        complete_settings(settings),
        absl::InvalidArgumentError(
            setting.path + " is 4711, which this server does not know; GetServerInfo lists what it does"));
  }
}

TEST(Settings, AClientThatKnowsNoSettingLearnsWhatThereIs) {
  std::map<std::string, SettingInfo> known;
  for (const SettingField& setting : setting_fields()) known[setting.path] = setting_info(setting);
  EXPECT_EQ(known.size(), setting_fields().size());
  for (const auto& [path, info] : known) EXPECT_NE(info.kind(), SettingInfo::KIND_UNSPECIFIED) << path;
  EXPECT_EQ(known["exposure.key"].kind(), SettingInfo::KIND_NUMBER);
  EXPECT_EQ(known["bloom.levels"].kind(), SettingInfo::KIND_WHOLE_NUMBER);
  EXPECT_EQ(known["dither"].kind(), SettingInfo::KIND_SWITCH);
  EXPECT_EQ(known["tier"].kind(), SettingInfo::KIND_TEXT);
  EXPECT_EQ(known["exposure.metering.spot"].kind(), SettingInfo::KIND_RECTANGLE);
  EXPECT_EQ(known["output_size"].kind(), SettingInfo::KIND_SIZE);
  const SettingInfo& transfer = known["transfer"];
  EXPECT_EQ(transfer.kind(), SettingInfo::KIND_CHOICE);
  EXPECT_EQ(transfer.declaration().default_word(), "srgb");
  ASSERT_EQ(transfer.choices_size(), 5);
  EXPECT_EQ(transfer.choices(1).word(), "gamma22");
  EXPECT_EQ(transfer.choices(1).number(), TRANSFER_GAMMA22);
  EXPECT_FALSE(transfer.choices(0).summary().empty());
}

TEST(Settings, WordsAndNumbersAreWrittenAsPeopleWriteThem) {
  EXPECT_EQ(word_of(TONE_CURVE_ACES_HILL), "aces-hill");
  EXPECT_EQ(word_of(Bloom::KIND_MIP), "mip");
  EXPECT_EQ(word_of(static_cast<ToneCurve>(4711)), "4711");
  EXPECT_EQ(format_number(64), "64");
  EXPECT_EQ(format_number(0.18), "0.18");
  EXPECT_EQ(format_number(0x1p40), "2^40");
  EXPECT_EQ(format_number(0x1p-40), "2^-40");
  EXPECT_EQ(format_range(0, 65504), "0 .. 65504");
}

}  // namespace
}  // namespace candela::v1

namespace candela {
namespace {

// The size of the image that is made of a frame.

struct Asked {
  uint32_t width = 0;
  uint32_t height = 0;
  double percent = 0;
  uint32_t max_side = 0;
  double pixel_aspect = 0;
};

v1::Settings settings_of(const Asked& asked) {
  v1::Settings settings;
  v1::OutputSize& size = *settings.mutable_output_size();
  size.set_width(asked.width);
  size.set_height(asked.height);
  if (asked.percent != 0) size.set_percent(asked.percent);
  size.set_max_side(asked.max_side);
  if (asked.pixel_aspect != 0) size.set_pixel_aspect(asked.pixel_aspect);
  return settings;
}

ImageSize made(const Asked& asked, uint32_t width = 1920, uint32_t height = 1080) {
  return image_size(settings_of(asked), {width, height, v1::PIXEL_FORMAT_RGBA16F});
}

TEST(OutputSize, FollowsFromTheFramesShape) {
  EXPECT_EQ(image_size({}, {1920, 1080, v1::PIXEL_FORMAT_RGBA16F}), (ImageSize{1920, 1080}));
  EXPECT_EQ(made({}), (ImageSize{1920, 1080}));
  EXPECT_EQ(made({.width = 1000}), (ImageSize{1000, 563}));  // 562.5
  EXPECT_EQ(made({.height = 270}), (ImageSize{480, 270}));
  EXPECT_EQ(made({.width = 7, .height = 4000}), (ImageSize{7, 4000}));
  EXPECT_EQ(made({.percent = 12.5}), (ImageSize{240, 135}));
  EXPECT_EQ(made({.percent = 1000}), (ImageSize{19200, 10800}));
  EXPECT_EQ(made({.max_side = 480}), (ImageSize{480, 270}));
  EXPECT_EQ(made({.max_side = 480}, 1080, 1920), (ImageSize{270, 480}));
  EXPECT_EQ(made({.max_side = 1920}), (ImageSize{1920, 1080}));
  EXPECT_EQ(made({.max_side = 4000}), (ImageSize{1920, 1080}));
}

TEST(OutputSize, HasSquarePixels) {
  EXPECT_EQ(made({.pixel_aspect = 2}, 1828, 1556), (ImageSize{3656, 1556}));
  EXPECT_EQ(made({.width = 1000, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1000, 426}));
  EXPECT_EQ(made({.height = 778, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1828, 778}));
  EXPECT_EQ(made({.percent = 50, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1828, 778}));
  EXPECT_EQ(made({.max_side = 1828, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1828, 778}));
  EXPECT_EQ(made({.width = 5, .height = 6, .pixel_aspect = 2}), (ImageSize{5, 6}));
}

TEST(OutputSize, HasAtLeastOnePixelASide) {
  EXPECT_EQ(made({.max_side = 4}, 16384, 1), (ImageSize{4, 1}));
  EXPECT_EQ(made({.percent = 1e-9}), (ImageSize{1, 1}));
  EXPECT_EQ(made({.height = std::numeric_limits<uint32_t>::max()}, 16384, 1),
            (ImageSize{std::numeric_limits<uint32_t>::max(), std::numeric_limits<uint32_t>::max()}));
}

TEST(OutputSize, RefusesWhatIsOutOfItsRangeOrDoesNotGoTogether) {
  const auto refusal = [](const Asked& asked) {
    return std::string(Settings::from(settings_of(asked)).status().message());
  };
  EXPECT_EQ(refusal({.percent = -1}), "output_size.percent is -1; it must be above 0 and at most 1000");
  EXPECT_EQ(refusal({.percent = 1000.5}),
            "output_size.percent is 1000.5; it must be above 0 and at most 1000");
  EXPECT_NE(refusal({.percent = std::numeric_limits<double>::quiet_NaN()}), "");
  EXPECT_EQ(refusal({.pixel_aspect = 17}),
            "output_size.pixel_aspect is 17; it must be between 0.0625 and 16");
  EXPECT_EQ(refusal({.width = 9, .percent = 5}),
            "output_size.percent is 5 and the size is 9x0; give one of them");
  EXPECT_EQ(refusal({.height = 9, .max_side = 5}),
            "output_size.max_side is 5 and there is a width or a height, too; give one of them");
  EXPECT_EQ(refusal({.percent = 9, .max_side = 5}),
            "output_size.max_side is 5 and there is a percent, too; give one of them");
  EXPECT_EQ(refusal({.width = 9, .pixel_aspect = 0.0625}), "");
}

TEST(OutputSize, ASideIsWithinTheServersLimit) {
  const absl::StatusOr<Settings> settings = Settings::from(settings_of({.width = 300}));
  ASSERT_OK(settings);
  const FrameDesc desc = {100, 50, v1::PIXEL_FORMAT_RGBA16F};
  EXPECT_OK(check_settings_for(*settings, desc, 300));
  EXPECT_EQ(
      check_settings_for(*settings, desc, 299),
      absl::ResourceExhaustedError("output_size makes an image of 300x150 pixels of a frame of 100x50, and "
                                   "this server makes at most 299 a side; ask for a smaller one"));
  EXPECT_OK(check_settings_for(settings->for_metering(false), desc, 299));
}

// White balance: the Planckian locus, the tint, and what it does to the matrix. No device.

struct Uv {
  double u;
  double v;
};

Uv uv_of(const White& white) {
  const double scale = -2 * white.x + 12 * white.y + 3;
  return {4 * white.x / scale, 6 * white.y / scale};
}

using Rgb = std::array<double, 3>;

Rgb times(const std::array<float, 9>& m, const Rgb& c) {
  return {m[0] * c[0] + m[1] * c[1] + m[2] * c[2], m[3] * c[0] + m[4] * c[1] + m[5] * c[2],
          m[6] * c[0] + m[7] * c[1] + m[8] * c[2]};
}

// Linear Rec.709 of a chromaticity at luminance 1, by the matrix of IEC 61966-2-1.
Rgb rec709_of(const White& white) {
  const double x = white.x / white.y;
  const double z = (1 - white.x - white.y) / white.y;
  return {3.2406 * x - 1.5372 - 0.4986 * z, -0.9689 * x + 1.8758 + 0.0415 * z,
          0.0557 * x - 0.2040 + 1.0570 * z};
}

Settings balanced(double kelvin, double tint) {
  v1::Settings settings;
  settings.set_white_balance(kelvin);
  settings.set_tint(tint);
  return Settings::from(settings).value();
}

// G. Wyszecki and W. Stiles, "Color Science", 2nd edition, table 1(5.3.1)'s Planckian radiators; illuminant A
// is CIE 15's.
TEST(WhiteBalance, TheLocusIsPlancks) {
  struct Published {
    double kelvin, x, y;
  };
  for (const auto& [kelvin, x, y] : {Published{2000, 0.5267, 0.4133},
                                     {2856, 0.4476, 0.4074},
                                     {3000, 0.4369, 0.4041},
                                     {4000, 0.3805, 0.3768},
                                     {5000, 0.3451, 0.3516},
                                     {6500, 0.3135, 0.3237},
                                     {10000, 0.2807, 0.2884}}) {
    const White white = white_of(kelvin, 0);
    EXPECT_NEAR(white.x, x, 1e-4) << kelvin;
    EXPECT_NEAR(white.y, y, 1e-4) << kelvin;
  }
}

// Light of 0.18 in linear Rec.709, balanced.
Rgb grey(double kelvin, double tint) {
  const std::optional<std::array<float, 9>> matrix = balanced(kelvin, tint).to_scene();
  return matrix ? times(*matrix, {0.18, 0.18, 0.18}) : Rgb{0.18, 0.18, 0.18};
}

// From 1 K to the next, a white moves by 0.1 % more or less than it just did, and never back.
TEST(WhiteBalance, AStepOfOneKelvinIsAsLongAsTheOneBefore) {
  for (double tint : {-1.0, 0.0, 1.0}) {
    White white = white_of(2001, tint);
    White before = white_of(2000, tint);
    for (int kelvin = 2002; kelvin <= 25000; ++kelvin) {
      const White next = white_of(kelvin, tint);
      const double x = white.x - before.x, y = white.y - before.y;
      const double next_x = next.x - white.x, next_y = next.y - white.y;
      ASSERT_NEAR(std::hypot(next_x, next_y) / std::hypot(x, y), 1.0, 1e-3) << kelvin << " " << tint;
      ASSERT_GT(x * next_x + y * next_y, 0.999 * std::hypot(x, y) * std::hypot(next_x, next_y))
          << kelvin << " " << tint;
      before = white;
      white = next;
    }
  }
}

// At 2222 and 4000 K the cubics of Kang et al. have joints. With tint 1 at 4000 K the blue of a grey is 44
// times itself, and moves by 1 % from one kelvin to the next.
TEST(WhiteBalance, AGreyMovesSmoothlyOverItsTemperature) {
  for (double kelvin : {2222.0, 4000.0, 9000.0}) {
    for (double tint : {-1.0, 0.0, 1.0}) {
      const Rgb below = grey(kelvin - 1, tint), at = grey(kelvin, tint), above = grey(kelvin + 1, tint);
      for (size_t k = 0; k < 3; ++k) {
        const double rounding = 2e-7 * std::max(1.0, std::abs(at[k]));  // of the matrix
        EXPECT_NEAR(at[k], (below[k] + above[k]) / 2, 0.02 * std::abs(above[k] - below[k]) + rounding)
            << kelvin << " " << tint << " " << k;
      }
    }
  }
}

TEST(WhiteBalance, ATintIsADistanceFromTheLocusTowardsGreen) {
  for (double kelvin : {2000.0, 2222.0, 3200.0, 4000.0, 6504.0, 12000.0, 25000.0}) {
    const Uv on = uv_of(white_of(kelvin, 0));
    const Uv above = uv_of(white_of(kelvin, 1));
    const Uv below = uv_of(white_of(kelvin, -0.5));
    EXPECT_NEAR(std::hypot(above.u - on.u, above.v - on.v), 0.05, 1e-9) << kelvin;
    EXPECT_NEAR(std::hypot(below.u - on.u, below.v - on.v), 0.025, 1e-9) << kelvin;
    EXPECT_GT(above.v, on.v) << kelvin;
    EXPECT_LT(below.v, on.v) << kelvin;
  }
}

TEST(WhiteBalance, DaylightIsItselfBalanced) {
  const White d65 = white_of(6504, 0.064);
  EXPECT_NEAR(d65.x, 0.3127, 1e-4);
  EXPECT_NEAR(d65.y, 0.3290, 1e-4);
}

TEST(WhiteBalance, TheScenesWhiteBecomesNeutral) {
  for (double kelvin : {2500.0, 3200.0, 5000.0, 9000.0, 20000.0}) {
    for (double tint : {-0.3, 0.0, 0.3}) {
      const Settings settings = balanced(kelvin, tint);
      ASSERT_TRUE(settings.to_scene());
      const Rgb neutral = times(*settings.to_scene(), rec709_of(white_of(kelvin, tint)));
      EXPECT_NEAR(neutral[0] / neutral[1], 1.0, 2e-3) << kelvin << " " << tint;
      EXPECT_NEAR(neutral[2] / neutral[1], 1.0, 2e-3) << kelvin << " " << tint;
    }
  }
}

TEST(WhiteBalance, FollowsThePrimariesOfTheFrame) {
  v1::Settings settings;
  settings.set_input_primaries(v1::PRIMARIES_ACES_AP1);
  const auto plain = *Settings::from(settings)->to_scene();
  settings.set_white_balance(3200);
  const auto both = *Settings::from(settings)->to_scene();
  const auto balance = *balanced(3200, 0).to_scene();
  for (const Rgb& c : {Rgb{1, 0, 0}, Rgb{0, 1, 0}, Rgb{0, 0, 1}}) {
    const Rgb in_two_steps = times(balance, times(plain, c));
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(times(both, c)[k], in_two_steps[k], 2e-6);
  }
}

TEST(WhiteBalance, AbsentItIsNoMatrixAndATintNeedsIt) {
  EXPECT_FALSE(Settings().to_scene());
  v1::Settings settings;
  settings.set_tint(0.2);
  const absl::Status status = Settings::from(settings).status();
  EXPECT_EQ(status.message(), "tint is 0.2 and there is no white_balance; give both, or leave the tint out");
  settings.set_white_balance(1999);
  EXPECT_EQ(Settings::from(settings).status().message(),
            "white_balance is 1999; it must be between 2000 and 25000");
}

// The specialisation constants in shaders/params.h have the numbers that the contract's enums give the same
// names.

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
      NAMED(CURVE, ACES_1), NAMED(CURVE, ACES_2), NAMED(CURVE, BT2390), NAMED(CURVE, SHOULDER),
      NAMED(CURVE, TABLE)}},
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

namespace v1 {
namespace {

// docs/settings.md, made from the declarations in render.proto.

constexpr char kUpdate[] = "CANDELA_UPDATE_PAGES=1 ctest --test-dir BUILD_FOLDER -R SettingsPage";

constexpr char kOpening[] =
    R"(# Settings

A setting says how Candela renders a frame. This page lists every setting with the option of `candela` that sets it, its range
and its default. A client sets the same settings in the message `candela.v1.Settings`; the names below are the fields' names
there. A client that builds its own controls gets this list from the rpc `GetServerInfo`. `candela info --json -` prints it.

An absent setting takes its default. The server refuses a value outside of its range with INVALID_ARGUMENT and never clamps
it. Ranges are inclusive. "none" means that the setting has no default and stays absent.

[pipeline.md](pipeline.md) defines what each setting does to the image. This page is generated from
[render.proto](../proto/candela/v1/render.proto). Do not edit it. Change the option `(setting)` at the field, then run

    %s
)";

constexpr char kClosing[] =
    R"(
## Settings without an option, and options without a setting

`candela` chooses `output_format` by the type of the output file. Without `--alpha` it asks for `straight` for a .png or .avif, and for
`ignore` if a file's alpha is 0 everywhere although there is light. It sends the primaries that the image's file names, unless
`--primaries` is given; a message without primaries means `rec709`. A finished picture, such as a photograph, gets an exposure of
0 EV, no bloom and the curve `linear` or `shoulder` ([pipeline.md](pipeline.md#7-files)). Two fields of the message are not in the tables above
because each is a message of several numbers. `render.proto` describes them.

| field | option | what it does |
|---|---|---|
| `input_chromaticities` | `--primaries` with eight numbers | the image's primaries and white as CIE xy |
| `table` | `--ocio`, `--display`, `--ocio-view`, `--ocio-input`, `--lut`, `--lut-input` | a colour table in place of a curve; `candela` makes it from an OpenColorIO view or a LUT and sets `curve` to `table` |
)";

std::string code(const std::string& text) { return absl::StrCat("`", text, "`"); }

// A number with its unit: "0.18 luminance".
std::string with_unit(const std::string& number, const Setting& declaration) {
  return declaration.unit().empty() ? number : absl::StrCat(number, " ", declaration.unit());
}

std::string range_text(const SettingField& setting) {
  const Setting& declaration = setting.declaration();
  if (!setting.is_number()) return "";
  std::string text = with_unit(format_range(declaration.min(), declaration.max()), declaration);
  for (const Setting::Exception& exception : declaration.except()) {
    if (!exception.has_min() && !exception.has_max()) continue;
    absl::StrAppendFormat(&text, "; with `%s` %s", exception.word(), format_range(declaration, exception));
  }
  return text;
}

std::string default_text(const SettingField& setting) {
  const Setting& declaration = setting.declaration();
  if (setting.field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_BOOL) {
    return declaration.default_() != 0 ? "on" : "off";
  }
  std::string text = !declaration.default_word().empty() ? code(declaration.default_word())
                     : declaration.has_default_()        ? format_number(declaration.default_())
                                                         : "none";
  for (const Setting::Exception& exception : declaration.except()) {
    if (!exception.has_default_() && exception.default_word().empty()) continue;
    absl::StrAppendFormat(
        &text, "; with `%s` %s", exception.word(),
        exception.has_default_() ? format_number(exception.default_()) : code(exception.default_word()));
  }
  return text;
}

std::string row(const SettingField& setting) {
  const SettingInfo info = setting_info(setting);
  const Setting& declaration = setting.declaration();
  const std::vector<std::string> cells = {
      code(setting.path),
      declaration.flag().empty() ? "" : code("--" + declaration.flag()),
      absl::StrReplaceAll(word_of(info.kind()), {{"-", " "}}),
      range_text(setting),
      default_text(setting),
      absl::StrReplaceAll(declaration.help(), {{"|", "\\|"}}),
  };
  return absl::StrCat("| ", absl::StrJoin(cells, " | "), " |\n");
}

// The choices of a setting, one a line; "" if it is no choice.
std::string choices(const SettingField& setting) {
  const SettingInfo info = setting_info(setting);
  if (info.choices().empty()) return "";
  std::string text = absl::StrCat("\n", code(setting.path), " is one of:\n\n");
  for (const SettingInfo::Choice& choice : info.choices()) {
    absl::StrAppend(&text, "- ", code(choice.word()), choice.summary().empty() ? "" : ": ", choice.summary(),
                    "\n");
  }
  return text;
}

std::string page() {
  std::vector<std::string> groups;  // in the order of the contract
  for (const SettingField& setting : setting_fields()) {
    const std::string& group = setting.declaration().group();
    if (std::find(groups.begin(), groups.end(), group) == groups.end()) groups.push_back(group);
  }
  std::string text = absl::StrFormat(kOpening, kUpdate);
  for (const std::string& group : groups) {
    absl::StrAppend(&text, "\n## ", group,
                    "\n\n| setting | option | kind | range | default | what it does |\n",
                    "|---|---|---|---|---|---|\n");
    std::string lists;
    for (const SettingField& setting : setting_fields()) {
      if (setting.declaration().group() != group) continue;
      absl::StrAppend(&text, row(setting));
      absl::StrAppend(&lists, choices(setting));
    }
    absl::StrAppend(&text, lists);
  }
  return absl::StrCat(text, kClosing);
}

TEST(SettingsPage, IsWhatTheContractDeclares) {
  if (std::getenv("CANDELA_UPDATE_PAGES") != nullptr) write_file(CANDELA_SETTINGS_PAGE, page());
  EXPECT_EQ(read_file(CANDELA_SETTINGS_PAGE), page()) << "docs/settings.md is not current; run: " << kUpdate;
}

}  // namespace
}  // namespace v1
}  // namespace candela
