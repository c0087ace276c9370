#include "client/base/number_words.h"

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace candela {
namespace {

constexpr int kLeastExponent = -9;
constexpr int kMostExponent = 15;

}  // namespace

std::string in_digits(double value, int digits) {
  if (value == 0) return "0";
  const std::string text = absl::StrFormat("%.*g", digits, value);
  const size_t mark = text.find('e');
  int exponent = 0;
  if (mark == std::string::npos || !absl::SimpleAtoi(text.substr(mark + 1), &exponent)) return text;
  if (exponent < kLeastExponent || exponent > kMostExponent) return text;
  std::string plain = absl::StrFormat("%.*f", std::max(0, digits - 1 - exponent), value);
  if (exponent < 0) plain.erase(plain.find_last_not_of('0') + 1);
  return plain;
}

std::string in_decimals(double value, int decimals) {
  std::string text = absl::StrFormat("%.*f", decimals, value);
  if (text.find_first_of("123456789n") == std::string::npos) text.erase(0, text.find('0'));
  return text;
}

std::string with_sign(double value, int decimals) {
  const std::string text = in_decimals(value, decimals);
  return absl::StrCat(text[0] == '-' ? "" : "+", text);
}

}  // namespace candela
