// Finds the words that a user most likely meant by a word that does not exist.
#pragma once

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace candela {

// The word in lower case and without spaces, dots, hyphens and underscores: "Rec.709" is "rec709".
std::string folded(absl::string_view word);

// The words near `typed`, in their order; none if no word is near. Near are those with the fewest wrong,
// missing, superfluous or swapped letters, if these are at most a third of `typed`, and those that begin with
// `typed`, if these are at most four. Compares folded words.
std::vector<std::string> near_words(absl::string_view typed, const std::vector<std::string>& words);

// "did you mean aces-1, aces-hill or aces-narkowicz?" for these near words; "" for none.
std::string did_you_mean(std::vector<std::string> near);

}  // namespace candela
