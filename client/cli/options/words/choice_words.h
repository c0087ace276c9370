// The words for the values of an enum on the command line: its own, and the other names by which people know
// them. Case, spaces, dots, hyphens and underscores do not matter: "Rec.709" is rec709.
#pragma once

#include <google/protobuf/descriptor.h>

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace candela {

// The enum's own words that a user may give, in the order of the contract.
std::vector<std::string> choice_words(const google::protobuf::EnumDescriptor& type);

// The same for --help, with other names: "rec709 (srgb, linear-srgb, bt709), rec2020 (bt2020)".
std::string choice_help(const google::protobuf::EnumDescriptor& type);
// The same of some of the enum's words.
std::string choice_help(const google::protobuf::EnumDescriptor& type, std::vector<std::string> words);

// The value that a word means. The usage error suggests near words, or what to do instead. `what` is, for
// example, "curve".
absl::StatusOr<int> enum_value(const google::protobuf::EnumDescriptor& type, const std::string& what,
                               const std::string& word);

}  // namespace candela
