// Declarations of settings, and how a message of settings is completed and checked. Everything but the list
// of today's defaults goes through reflection, so that a new setting is tested without a line here.
#include "proto/candela/v1/settings.h"

#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "absl/strings/str_format.h"
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
