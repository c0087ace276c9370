// The settings as render.proto declares them, read by reflection: nothing here knows a setting by name.
#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/generated_enum_reflection.h>

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"

namespace candela::v1 {

// One field of Settings, or of a message in it, that carries the option (setting).
struct SettingField {
  std::string path;                                               // "bloom.intensity"
  std::vector<const google::protobuf::FieldDescriptor*> parents;  // the messages from Settings down to it
  const google::protobuf::FieldDescriptor* field = nullptr;

  const Setting& declaration() const;
  bool is_number() const;        // double, float or whole
  bool is_whole_number() const;  // uint32

  // The message that holds the field, made if it is absent.
  google::protobuf::Message& holder(Settings& settings) const;

  // Sets the field of its holder to a number, converted to the field's type. The field is a number and the
  // value is in its range.
  void set_number(google::protobuf::Message& holder, double value) const;
};

// Every setting, in the order of the contract. Lives as long as the process.
const std::vector<SettingField>& setting_fields();

// Gives every absent setting its default and checks every setting by itself. If a number is NaN or outside
// its range, or this build does not know an enum value, INVALID_ARGUMENT names the field, its value and what
// it may be. The caller checks settings that depend on each other.
absl::Status complete_settings(Settings& settings);

// All that a client needs to show the setting to a user.
SettingInfo setting_info(const SettingField& field);

// An enum's values as words for people, without the unspecified one: TONE_CURVE_ACES_HILL is "aces-hill".
std::vector<std::string> enum_words(const google::protobuf::EnumDescriptor& type);

// The words of a setting that is a choice: its declaration's, else all of its enum's.
std::vector<std::string> words_of(const SettingField& field);

// One value's word; the number itself if this build does not know it.
std::string enum_word(const google::protobuf::EnumDescriptor& type, int value);

template <typename Enum>
std::string word_of(Enum value) {
  return enum_word(*google::protobuf::GetEnumDescriptor<Enum>(), value);
}

// The message's deterministic serialisation: equal messages give the same bytes in one version of protobuf.
std::string deterministic_bytes(const google::protobuf::Message& message);

// A number as people write it: "64", "0.18", "2^40".
std::string format_number(double value);
std::string format_range(double min, double max);  // "0 .. 10"
// The range of numbers that the exception leaves: its own ends, else the declaration's.
std::string format_range(const Setting& declaration, const Setting::Exception& exception);

}  // namespace candela::v1
