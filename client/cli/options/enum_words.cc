#include "client/cli/options/enum_words.h"

#include <google/protobuf/descriptor.h>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/cli/options/usage.h"

namespace candela {
namespace {

// TONE_CURVE_ of TONE_CURVE_UNSPECIFIED.
size_t prefix_length(const google::protobuf::EnumDescriptor& type) {
  const std::string& unspecified = type.FindValueByNumber(0)->name();
  return unspecified.rfind('_') + 1;
}

}  // namespace

std::vector<std::string> enum_words(const google::protobuf::EnumDescriptor& type) {
  std::vector<std::string> words;
  for (int i = 0; i < type.value_count(); ++i) {
    if (type.value(i)->number() != 0) words.push_back(enum_word(type, type.value(i)->number()));
  }
  return words;
}

std::string enum_word(const google::protobuf::EnumDescriptor& type, int value) {
  const google::protobuf::EnumValueDescriptor* known = type.FindValueByNumber(value);
  if (known == nullptr) return absl::StrCat(value);
  return absl::StrReplaceAll(absl::AsciiStrToLower(known->name().substr(prefix_length(type))), {{"_", "-"}});
}

absl::StatusOr<int> enum_value(const google::protobuf::EnumDescriptor& type, const std::string& what,
                               const std::string& word) {
  for (int i = 0; i < type.value_count(); ++i) {
    const int value = type.value(i)->number();
    if (value != 0 && enum_word(type, value) == word) return value;
  }
  return unknown_word(what, word, enum_words(type));
}

}  // namespace candela
