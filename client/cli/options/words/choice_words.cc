#include "client/cli/options/words/choice_words.h"

#include <algorithm>
#include <iterator>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "candela/v1/render.pb.h"
#include "client/base/usage.h"
#include "proto/candela/v1/settings.h"
#include "server/base/words/near_words.h"

namespace candela {
namespace {

using google::protobuf::EnumDescriptor;

// Another name for one of an enum's words.
struct OtherName {
  const EnumDescriptor* (*type)();
  const char* name;
  const char* word;
};
constexpr OtherName kOtherNames[] = {
    {v1::Primaries_descriptor, "srgb", "rec709"},       {v1::Primaries_descriptor, "linear-srgb", "rec709"},
    {v1::Primaries_descriptor, "bt709", "rec709"},      {v1::Primaries_descriptor, "bt2020", "rec2020"},
    {v1::Primaries_descriptor, "display-p3", "p3-d65"}, {v1::Primaries_descriptor, "aces2065-1", "aces-ap0"},
    {v1::Primaries_descriptor, "ap0", "aces-ap0"},      {v1::Primaries_descriptor, "acescg", "aces-ap1"},
    {v1::Primaries_descriptor, "ap1", "aces-ap1"},
};

// Words that people try, and what does what they mean.
struct Instead {
  const EnumDescriptor* (*type)();
  std::vector<std::string> typed;
  const char* words;
};
const Instead kInstead[] = {
    {v1::Bloom::Kind_descriptor, {"none", "off", "no", "0"}, "--bloom-intensity 0 turns bloom off."},
    {v1::Metering::Statistic_descriptor, {"none", "off", "no"}, "--exposure EV fixes the exposure."},
    {v1::ToneCurve_descriptor, {"none", "off", "no"}, "linear only cuts light at 0 and 1."},
    {v1::ToneCurve_descriptor, {"srgb", "gamma22"}, "--transfer chooses the display encoding."},
    {v1::Alpha_descriptor, {"none", "off", "no", "opaque"}, "ignore takes every pixel as opaque."},
    {v1::Alpha_descriptor, {"premultiplied", "premult"}, "associated is that."},
    {v1::Alpha_descriptor, {"unassociated", "unpremultiplied"}, "straight is that."},
    {v1::Transfer_descriptor, {"none", "off", "no"}, "linear writes light as it is."},
};

// The names of the value `word` that are not its own.
std::vector<std::string> other_names(const EnumDescriptor& type, const std::string& word) {
  std::vector<std::string> names;
  for (const OtherName& other : kOtherNames) {
    if (other.type() == &type && other.word == word) names.emplace_back(other.name);
  }
  return names;
}

absl::Status unknown_choice(const EnumDescriptor& type, const std::string& what, const std::string& word) {
  const std::string typed = folded(word);
  std::vector<std::string> names;
  for (const std::string& own : choice_words(type)) {
    names.push_back(own);
    for (std::string& other : other_names(type, own)) names.push_back(std::move(other));
  }
  std::string hint = did_you_mean(near_words(word, names));
  for (const Instead& instead : kInstead) {
    if (instead.type() != &type) continue;
    if (std::find(instead.typed.begin(), instead.typed.end(), typed) != instead.typed.end()) {
      hint = instead.words;
    }
  }
  return usage_error(absl::StrFormat("unknown %s \"%s\"; %s %s", what, word,
                                     hint.empty() ? "there are:" : hint + " There are:", choice_help(type)));
}

}  // namespace

std::vector<std::string> choice_words(const EnumDescriptor& type) {
  std::vector<std::string> words = v1::enum_words(type);
  // --ocio makes the table, so a user cannot choose that curve by name.
  if (&type == v1::ToneCurve_descriptor()) std::erase(words, v1::word_of(v1::TONE_CURVE_TABLE));
  // `candela meter` is the command that makes no image.
  if (&type == v1::Encoding_descriptor()) std::erase(words, v1::word_of(v1::ENCODING_NONE));
  return words;
}

std::string choice_help(const EnumDescriptor& type) { return choice_help(type, choice_words(type)); }

std::string choice_help(const EnumDescriptor& type, std::vector<std::string> words) {
  for (std::string& word : words) {
    const std::vector<std::string> others = other_names(type, word);
    if (!others.empty()) absl::StrAppend(&word, " (", absl::StrJoin(others, ", "), ")");
  }
  return absl::StrJoin(words, ", ");
}

absl::StatusOr<int> enum_value(const EnumDescriptor& type, const std::string& what, const std::string& word) {
  std::string typed = folded(word);
  for (const OtherName& other : kOtherNames) {
    if (other.type() == &type && folded(other.name) == typed) typed = folded(other.word);
  }
  const std::vector<std::string> words = choice_words(type);
  for (int i = 0; i < type.value_count(); ++i) {
    const std::string own = v1::enum_word(type, type.value(i)->number());
    const bool may = std::find(words.begin(), words.end(), own) != words.end();
    if (may && folded(own) == typed) return type.value(i)->number();
  }
  return unknown_choice(type, what, word);
}

}  // namespace candela
