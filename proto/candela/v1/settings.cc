#include "proto/candela/v1/settings.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <algorithm>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

namespace candela::v1 {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

void collect(const Descriptor& type, const std::string& prefix,
             const std::vector<const FieldDescriptor*>& parents, std::vector<SettingField>& fields) {
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor& field = *type.field(i);
    const std::string path = prefix + field.name();
    if (field.options().HasExtension(setting)) {
      fields.push_back({path, parents, &field});
    } else if (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      std::vector<const FieldDescriptor*> way = parents;
      way.push_back(&field);
      collect(*field.message_type(), path + ".", way, fields);
    }
  }
}

double number_in(const Message& holder, const FieldDescriptor& field) {
  const google::protobuf::Reflection& reflection = *holder.GetReflection();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_FLOAT:
      return reflection.GetFloat(holder, &field);
    case FieldDescriptor::CPPTYPE_UINT32:
      return reflection.GetUInt32(holder, &field);
    default:
      return reflection.GetDouble(holder, &field);
  }
}

// The field's declaration, with the exceptions that apply under the message's choices. `range_word`, if it is
// not null, gets the word of the choice that changes the range.
Setting in_force(const SettingField& field, const Message& holder, std::string* range_word = nullptr) {
  Setting declaration = field.declaration();
  for (const Setting::Exception& exception : field.declaration().except()) {
    const FieldDescriptor* choice = field.field->containing_type()->FindFieldByName(exception.choice());
    const int value = holder.GetReflection()->GetEnumValue(holder, choice);
    if (enum_word(*choice->enum_type(), value) != exception.word()) continue;
    if (range_word != nullptr && (exception.has_min() || exception.has_max())) *range_word = exception.word();
    if (exception.has_min()) declaration.set_min(exception.min());
    if (exception.has_max()) declaration.set_max(exception.max());
    if (exception.has_default_()) declaration.set_default_(exception.default_());
    if (!exception.default_word().empty()) declaration.set_default_word(exception.default_word());
  }
  return declaration;
}

int value_of_word(const EnumDescriptor& type, const std::string& word) {
  for (int i = 0; i < type.value_count(); ++i) {
    if (enum_word(type, type.value(i)->number()) == word) return type.value(i)->number();
  }
  return 0;
}

absl::Status complete_choice(const SettingField& setting_field, Message& holder) {
  const FieldDescriptor& field = *setting_field.field;
  const google::protobuf::Reflection& reflection = *holder.GetReflection();
  const int value = reflection.GetEnumValue(holder, &field);
  if (field.enum_type()->FindValueByNumber(value) == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s is %d, which this server does not know; GetServerInfo lists what it does",
                        setting_field.path, value));
  }
  if (value == 0) {
    reflection.SetEnumValue(
        &holder, &field, value_of_word(*field.enum_type(), in_force(setting_field, holder).default_word()));
  }
  return absl::OkStatus();
}

absl::Status complete_number(const SettingField& setting_field, Message& holder) {
  const FieldDescriptor& field = *setting_field.field;
  std::string word;
  const Setting declaration = in_force(setting_field, holder, &word);
  if (!holder.GetReflection()->HasField(holder, &field)) {
    if (declaration.has_default_()) setting_field.set_number(holder, declaration.default_());
    return absl::OkStatus();
  }
  const double value = number_in(holder, field);
  const bool single = field.cpp_type() == FieldDescriptor::CPPTYPE_FLOAT;
  const double min = single ? static_cast<float>(declaration.min()) : declaration.min();
  const double max = single ? static_cast<float>(declaration.max()) : declaration.max();
  if (value >= min && value <= max) return absl::OkStatus();  // false for NaN
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %g; %sit must be between %s and %s", setting_field.path, value,
                      word.empty() ? "" : absl::StrCat("with ", word, " "), format_number(declaration.min()),
                      format_number(declaration.max())));
}

void complete_other(const SettingField& setting_field, Message& holder) {
  const FieldDescriptor& field = *setting_field.field;
  const google::protobuf::Reflection& reflection = *holder.GetReflection();
  const Setting& declaration = setting_field.declaration();
  if (field.cpp_type() == FieldDescriptor::CPPTYPE_BOOL && field.has_presence() &&
      !reflection.HasField(holder, &field)) {
    reflection.SetBool(&holder, &field, declaration.default_() != 0);
  }
  if (field.cpp_type() == FieldDescriptor::CPPTYPE_STRING && reflection.GetString(holder, &field).empty()) {
    reflection.SetString(&holder, &field, declaration.default_word());
  }
}

SettingInfo::Kind kind_of(const SettingField& field) {
  switch (field.field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_UINT32:
      return SettingInfo::KIND_WHOLE_NUMBER;
    case FieldDescriptor::CPPTYPE_BOOL:
      return SettingInfo::KIND_SWITCH;
    case FieldDescriptor::CPPTYPE_ENUM:
      return SettingInfo::KIND_CHOICE;
    case FieldDescriptor::CPPTYPE_STRING:
      return SettingInfo::KIND_TEXT;
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return field.field->message_type() == OutputSize::descriptor() ? SettingInfo::KIND_SIZE
                                                                     : SettingInfo::KIND_RECTANGLE;
    default:
      return SettingInfo::KIND_NUMBER;
  }
}

}  // namespace

const Setting& SettingField::declaration() const { return field->options().GetExtension(setting); }

bool SettingField::is_whole_number() const { return field->cpp_type() == FieldDescriptor::CPPTYPE_UINT32; }

bool SettingField::is_number() const {
  return is_whole_number() || field->cpp_type() == FieldDescriptor::CPPTYPE_FLOAT ||
         field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE;
}

Message& SettingField::holder(Settings& settings) const {
  Message* message = &settings;
  for (const FieldDescriptor* parent : parents) {
    message = message->GetReflection()->MutableMessage(message, parent);
  }
  return *message;
}

void SettingField::set_number(Message& holder, double value) const {
  const google::protobuf::Reflection& reflection = *holder.GetReflection();
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_FLOAT:
      return reflection.SetFloat(&holder, field, static_cast<float>(value));
    case FieldDescriptor::CPPTYPE_UINT32:
      return reflection.SetUInt32(&holder, field, static_cast<uint32_t>(value));
    default:
      return reflection.SetDouble(&holder, field, value);
  }
}

const std::vector<SettingField>& setting_fields() {
  static const auto* const kFields = [] {
    auto* fields = new std::vector<SettingField>;
    collect(*Settings::descriptor(), "", {}, *fields);
    return fields;
  }();
  return *kFields;
}

absl::Status complete_settings(Settings& settings) {
  // Choices first: ranges and defaults of numbers may depend on them.
  for (const SettingField& field : setting_fields()) {
    if (field.field->cpp_type() != FieldDescriptor::CPPTYPE_ENUM) continue;
    if (absl::Status status = complete_choice(field, field.holder(settings)); !status.ok()) return status;
  }
  for (const SettingField& field : setting_fields()) {
    Message& holder = field.holder(settings);
    if (!field.is_number()) {
      complete_other(field, holder);
    } else if (absl::Status status = complete_number(field, holder); !status.ok()) {
      return status;
    }
  }
  return absl::OkStatus();
}

SettingInfo setting_info(const SettingField& field) {
  SettingInfo info;
  info.set_path(field.path);
  info.set_kind(kind_of(field));
  *info.mutable_declaration() = field.declaration();
  if (field.field->cpp_type() != FieldDescriptor::CPPTYPE_ENUM) return info;
  const EnumDescriptor& type = *field.field->enum_type();
  const std::vector<std::string> words = words_of(field);
  for (int i = 0; i < type.value_count(); ++i) {
    const EnumValueDescriptor& value = *type.value(i);
    const std::string word = enum_word(type, value.number());
    if (std::find(words.begin(), words.end(), word) == words.end()) continue;
    SettingInfo::Choice& choice = *info.add_choices();
    choice.set_number(value.number());
    choice.set_word(word);
    choice.set_summary(value.options().GetExtension(summary));
  }
  return info;
}

std::vector<std::string> enum_words(const EnumDescriptor& type) {
  std::vector<std::string> words;
  for (int i = 0; i < type.value_count(); ++i) {
    if (type.value(i)->number() != 0) words.push_back(enum_word(type, type.value(i)->number()));
  }
  return words;
}

std::vector<std::string> words_of(const SettingField& field) {
  const auto& words = field.declaration().words();
  return words.empty() ? enum_words(*field.field->enum_type())
                       : std::vector<std::string>(words.begin(), words.end());
}

std::string enum_word(const EnumDescriptor& type, int value) {
  const EnumValueDescriptor* known = type.FindValueByNumber(value);
  if (known == nullptr) return absl::StrCat(value);
  // TONE_CURVE_ of TONE_CURVE_UNSPECIFIED is what all names begin with.
  const size_t prefix = type.FindValueByNumber(0)->name().rfind('_') + 1;
  return absl::StrReplaceAll(absl::AsciiStrToLower(known->name().substr(prefix)), {{"_", "-"}});
}

std::string deterministic_bytes(const Message& message) {
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream out(&stream);
  out.SetSerializationDeterministic(true);
  message.SerializePartialToCodedStream(&out);
  out.Trim();
  return bytes;
}

std::string format_number(double value) {
  int exponent = 0;
  if (std::frexp(value, &exponent) == 0.5 && std::abs(exponent - 1) >= 20) {
    return absl::StrFormat("2^%d", exponent - 1);
  }
  // Few people read 1e+09.
  const bool is_large = std::fabs(value) >= 1e6 && std::fabs(value) < 1e15;
  return is_large ? absl::StrFormat("%.0f", value) : absl::StrFormat("%.7g", value);
}

std::string format_range(double min, double max) {
  return absl::StrFormat("%s .. %s", format_number(min), format_number(max));
}

std::string format_range(const Setting& declaration, const Setting::Exception& exception) {
  return format_range(exception.has_min() ? exception.min() : declaration.min(),
                      exception.has_max() ? exception.max() : declaration.max());
}

}  // namespace candela::v1
