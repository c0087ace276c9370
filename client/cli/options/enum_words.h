// The wire's enums as words for people: TONE_CURVE_ACES_HILL is "aces-hill". A value that is added to
// render.proto becomes a word by itself.
#pragma once

#include <google/protobuf/generated_enum_reflection.h>

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace candela {

// Every value but the unspecified one, 0, in the order of their numbers.
std::vector<std::string> enum_words(const google::protobuf::EnumDescriptor& type);

// Of one value; a number that this build does not know comes as itself.
std::string enum_word(const google::protobuf::EnumDescriptor& type, int value);

// The value of a word, or a usage error that names the nearest one. `what` is "curve".
absl::StatusOr<int> enum_value(const google::protobuf::EnumDescriptor& type, const std::string& what,
                               const std::string& word);

template <typename Enum>
std::string word_of(Enum value) {
  return enum_word(*google::protobuf::GetEnumDescriptor<Enum>(), value);
}

}  // namespace candela
