// The numbers of a sequence's frames: which are chosen, which are missing, and when each is shown.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/image/image.h"
#include "proto/candela/v1/limits.h"

namespace candela {

// A frame's number has at most this many digits, without its sign: -kLargestFrameNumber ..
// kLargestFrameNumber.
inline constexpr int kMostDigits = 12;
inline constexpr int64_t kLargestFrameNumber = 999'999'999'999;
// The most numbers that --range may choose and --missing hold may fill.
inline constexpr uint64_t kMostNumbers = 1'000'000;

// The numbers first, first + step, first + 2 step ... that are not above `last`.
struct NumberRange {
  int64_t first = 0;
  int64_t last = 0;   // at least `first`; kLargestFrameNumber if the user gave no end
  uint64_t step = 1;  // at least 1; at most kLargestFrameNumber

  uint64_t count() const { return static_cast<uint64_t>(last - first) / step + 1; }
  bool operator==(const NumberRange& other) const = default;
};

// A number as text with at most kMostDigits digits, and a minus before them if it is below 0. Nothing for
// other text.
std::optional<int64_t> parse_frame_number(absl::string_view text);

// Parses "12", "100-200", "-10--5", "100-200x2", "100-" (to the last frame), and lists of these with commas.
// A usage error names `option`.
absl::StatusOr<std::vector<NumberRange>> parse_number_ranges(const std::string& option,
                                                             const std::string& text);

// Parses numbers with commas between them, such as "-5,24,87". Returns them in order, each once. A usage
// error names `option`.
absl::StatusOr<std::vector<int64_t>> parse_frame_numbers(const std::string& option, const std::string& text);

// The numbers of all ranges in order, each once; ranges without an end go to `last`. RESOURCE_EXHAUSTED for
// more than kMostNumbers.
absl::StatusOr<std::vector<int64_t>> numbers_in(const std::vector<NumberRange>& ranges, int64_t last);

// The shortest ranges of step 1 with exactly these ascending numbers.
std::vector<NumberRange> ranges_of(const std::vector<int64_t>& numbers);

// How many numbers there are in ranges that do not overlap.
uint64_t count_of(const std::vector<NumberRange>& ranges);

// "4,10-12,21-99x2", as --range takes it. After `most` parts follow words such as " and 7 more".
std::string to_text(const std::vector<NumberRange>& ranges, const std::string& separator = ",",
                    size_t most = SIZE_MAX);

inline constexpr v1::Range<double> kFps{0.001, 100000};  // frames a second

// Parses "24", "12.5" or "24000/1001": a rate in kFps. A decimal number may stand for a film rate, as
// film_rate() says: "23.976" is 24000/1001. A usage error names `option`.
absl::StatusOr<FrameRate> parse_frame_rate(const std::string& option, const std::string& text);

// Whether the rate is one that parse_frame_rate() would accept.
bool is_usable(FrameRate rate);

// The same rate in its smallest numbers.
FrameRate reduced(FrameRate rate);

// "24", "12.5", "24000/1001": parse_frame_rate() makes exactly this rate of it.
std::string to_text(FrameRate rate);

// The time from a frame to the one that is `frames` later, in whole nanoseconds, rounded to the nearest.
// `frames` is at most twice kLargestFrameNumber. A time above 2^62 ns becomes 2^62 + 1.
int64_t media_time_ns(uint64_t frames, FrameRate rate);

}  // namespace candela
