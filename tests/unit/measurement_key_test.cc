// The key under which the server keeps measured times tells apart all settings that change them, and no
// others.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "server/render/settings/settings.h"

namespace candela {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

// Messages with another value of one setting; some may be refused because they do not go with the other
// defaults.
std::vector<v1::Settings> variants(const v1::SettingField& setting) {
  std::vector<v1::Settings> all;
  const auto add = [&](const auto& set) {
    v1::Settings message;
    if (setting.path == "tint") message.set_white_balance(5000);  // a tint needs a temperature
    Message& holder = setting.holder(message);
    set(holder, *holder.GetReflection());
    all.push_back(std::move(message));
  };
  const v1::Setting& declaration = setting.declaration();
  const v1::SettingInfo info = v1::setting_info(setting);
  if (setting.is_number()) {
    for (const double value : {declaration.min(), declaration.max()}) {
      if (declaration.has_default_() && value == declaration.default_()) continue;
      add([&](Message& holder, const auto&) { setting.set_number(holder, value); });
    }
    return all;
  }
  switch (setting.field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_ENUM:
      for (const v1::SettingInfo::Choice& choice : info.choices()) {
        if (choice.word() == declaration.default_word()) continue;
        add([&](Message& holder, const auto& reflection) {
          reflection.SetEnumValue(&holder, setting.field, choice.number());
        });
      }
      break;
    case FieldDescriptor::CPPTYPE_BOOL:
      add([&](Message& holder, const auto& reflection) {
        reflection.SetBool(&holder, setting.field, declaration.default_() == 0);
      });
      break;
    case FieldDescriptor::CPPTYPE_STRING:  // the only text is the tier
      for (const Tier& tier : tiers()) {
        if (tier.name == declaration.default_word()) continue;
        add([&](Message& holder, const auto& reflection) {
          reflection.SetString(&holder, setting.field, std::string(tier.name));
        });
      }
      break;
    default:
      add([&](Message& holder, const auto& reflection) {
        v1::Rectangle rectangle;
        rectangle.set_x1(5);
        rectangle.set_y1(7);
        reflection.MutableMessage(&holder, setting.field)->CopyFrom(rectangle);
      });
  }
  return all;
}

std::string key_of(const v1::Settings& message) { return Settings::from(message)->measurement_key(); }

TEST(MeasurementKey, DiffersWithEachSettingThatIsMeasured) {
  const std::string key = Settings().measurement_key();
  for (const v1::SettingField& setting : v1::setting_fields()) {
    std::vector<std::string> keys;  // of the setting's other values
    for (const v1::Settings& message : variants(setting)) {
      if (Settings::from(message).ok()) keys.push_back(key_of(message));
    }
    EXPECT_FALSE(keys.empty()) << setting.path << " has no other value that this test knows";
    if (setting.path == "tint") {  // its variants are balanced
      v1::Settings balanced;
      balanced.set_white_balance(5000);
      EXPECT_EQ(std::count(keys.begin(), keys.end(), key_of(balanced)), static_cast<ptrdiff_t>(keys.size()));
      continue;
    }
    if (setting.declaration().not_measured()) {
      EXPECT_EQ(std::count(keys.begin(), keys.end(), key), static_cast<ptrdiff_t>(keys.size()))
          << setting.path;
      continue;
    }
    if (!setting.is_number() && setting.path != "input_primaries") {
      keys.push_back(key);
      std::sort(keys.begin(), keys.end());
      EXPECT_EQ(std::adjacent_find(keys.begin(), keys.end()), keys.end())
          << setting.path << ": another value has the same key";
    } else {  // of primaries only whether there is a matrix, of most numbers whether they are 0
      EXPECT_LT(std::count(keys.begin(), keys.end(), key), static_cast<ptrdiff_t>(keys.size()))
          << setting.path;
    }
  }
}

TEST(MeasurementKey, IsTheSameForADefaultThatIsGivenAndOneThatIsAbsent) {
  EXPECT_EQ(key_of(*Settings()), Settings().measurement_key());
}

// Of fields of the message that are no settings by themselves, only what changes the time.
TEST(MeasurementKey, DiffersWithAMatrixAndTheSizeOfATable) {
  v1::Settings message;
  v1::Chromaticities& xy = *message.mutable_input_chromaticities();
  for (const float value : {0.3127f, 0.32f}) {
    xy.set_red_x(0.64f);
    xy.set_red_y(0.33f);
    xy.set_green_x(0.3f);
    xy.set_green_y(0.6f);
    xy.set_blue_x(0.15f);
    xy.set_blue_y(0.06f);
    xy.set_white_x(value);
    xy.set_white_y(0.329f);
    // With D65 they are Rec.709 itself.
    EXPECT_EQ(key_of(message) != Settings().measurement_key(), value != 0.3127f) << value;
  }

  v1::Settings with_table;
  with_table.set_curve(v1::TONE_CURVE_TABLE);
  with_table.mutable_table()->set_size(2);
  with_table.mutable_table()->set_values(std::string(2 * 2 * 2 * 6, '\0'));
  const std::string black = key_of(with_table);
  EXPECT_NE(black, Settings().measurement_key());
  (*with_table.mutable_table()->mutable_values())[0] = 1;
  EXPECT_EQ(key_of(with_table), black);
  with_table.mutable_table()->set_size(3);
  with_table.mutable_table()->set_values(std::string(3 * 3 * 3 * 6, '\0'));
  EXPECT_NE(key_of(with_table), black);
}

}  // namespace
}  // namespace candela
