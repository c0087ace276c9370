#include "client/run/frame_numbers.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <optional>

#include "absl/numeric/int128.h"
#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/base/failure.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

// Decimal rates have at most nine places.
constexpr uint64_t kDecimal = 1'000'000'000;
// The largest numerator or denominator of a rate. It keeps media times within 128 bits.
constexpr uint64_t kMostOfFraction = 1'000'000'000'000;

// The parts of a range as it was written. The numbers of a backward one are good all the same.
struct WrittenRange {
  int64_t first = 0, last = 0, step = 1;
};

// One of "12", "100-200", "100-200x2" and "100-". A minus at the beginning of a number is its sign.
std::optional<WrittenRange> parse_one_range(absl::string_view text) {
  const size_t middle = text.find('-', 1);
  const std::optional<int64_t> first = parse_frame_number(text.substr(0, middle));
  if (!first) return std::nullopt;
  if (middle == absl::string_view::npos) return WrittenRange{*first, *first, 1};
  const std::vector<absl::string_view> last_step =
      absl::StrSplit(text.substr(middle + 1), absl::MaxSplits('x', 1));
  const std::optional<int64_t> last =
      last_step[0].empty() ? kLargestFrameNumber : parse_frame_number(last_step[0]);
  const std::optional<int64_t> step = last_step.size() == 1 ? 1 : parse_frame_number(last_step[1]);
  if (!last || !step || *step == 0 || (*step < 0 && *last >= *first)) return std::nullopt;
  return WrittenRange{*first, *last, *step};
}

// The ranges, with three and more single numbers in equal steps joined to one range.
std::vector<NumberRange> with_steps(const std::vector<NumberRange>& ranges) {
  std::vector<NumberRange> joined;
  const auto single = [&ranges](size_t i) { return i < ranges.size() && ranges[i].first == ranges[i].last; };
  for (size_t i = 0; i < ranges.size();) {
    size_t end = i + 1;
    if (single(i) && single(end)) {
      const int64_t step = ranges[end].first - ranges[i].first;
      while (single(end) && ranges[end].first - ranges[end - 1].first == step) ++end;
      if (end - i >= 3) {
        joined.push_back({ranges[i].first, ranges[end - 1].first, static_cast<uint64_t>(step)});
        i = end;
        continue;
      }
    }
    joined.push_back(ranges[i++]);
  }
  return joined;
}

std::string words_for(const NumberRange& range) {
  std::string text = absl::StrCat(range.first);
  if (range.last == range.first) return text;
  absl::StrAppend(&text, "-");
  if (range.last != kLargestFrameNumber) absl::StrAppend(&text, range.last);
  if (range.step != 1) absl::StrAppend(&text, "x", range.step);
  return text;
}

absl::Status backward(const std::string& option, const std::string& text, const WrittenRange& range) {
  const NumberRange forward{range.last, range.first, static_cast<uint64_t>(std::abs(range.step))};
  return usage_error(
      absl::StrFormat("%s is \"%s\", which runs backwards; frames are rendered in the order of "
                      "their numbers, so give %s",
                      option, text, words_for(forward)));
}

}  // namespace

std::optional<int64_t> parse_frame_number(absl::string_view text) {
  const absl::string_view digits = absl::StripPrefix(text, "-");
  int64_t number = 0;
  if (digits.empty() || digits.size() > kMostDigits ||
      !std::all_of(digits.begin(), digits.end(), absl::ascii_isdigit) || !absl::SimpleAtoi(digits, &number)) {
    return std::nullopt;
  }
  return digits.size() < text.size() ? -number : number;
}

absl::StatusOr<std::vector<NumberRange>> parse_number_ranges(const std::string& option,
                                                             const std::string& text) {
  std::vector<NumberRange> ranges;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const std::optional<WrittenRange> range = parse_one_range(part);
    if (!range) {
      return usage_error(absl::StrFormat(
          "%s is \"%s\"; give frame numbers of at most %d digits such as 12, 100-200, -10--5, "
          "100-200x2 (every second) or 100- (to the last frame), with commas between them",
          option, text, kMostDigits));
    }
    if (range->last < range->first) return backward(option, text, *range);
    ranges.push_back({range->first, range->last, static_cast<uint64_t>(range->step)});
  }
  return ranges;
}

absl::StatusOr<std::vector<int64_t>> parse_frame_numbers(const std::string& option, const std::string& text) {
  std::vector<int64_t> numbers;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const std::optional<int64_t> number = parse_frame_number(part);
    if (!number) {
      return usage_error(absl::StrFormat(
          "%s is \"%s\"; give frame numbers of at most %d digits with commas between them, such as 24,87",
          option, text, kMostDigits));
    }
    numbers.push_back(*number);
  }
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  return numbers;
}

absl::StatusOr<std::vector<int64_t>> numbers_in(const std::vector<NumberRange>& ranges, int64_t last) {
  std::vector<NumberRange> closed;
  uint64_t count = 0;
  for (NumberRange range : ranges) {
    if (range.last == kLargestFrameNumber) range.last = std::max(last, range.first);
    count += range.count();  // at most 2 * 10^12 a range, and a command line has far fewer than 10^6 of them
    closed.push_back(range);
  }
  if (count > kMostNumbers) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("--range %s chooses %d frame numbers; at most %d are "
                        "possible; render the sequence in parts",
                        to_text(ranges), count, kMostNumbers));
  }
  std::vector<int64_t> numbers;
  numbers.reserve(count);
  for (const NumberRange& range : closed) {
    const auto step = static_cast<int64_t>(range.step);
    for (int64_t number = range.first; number <= range.last; number += step) numbers.push_back(number);
  }
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  return numbers;
}

std::vector<NumberRange> ranges_of(const std::vector<int64_t>& numbers) {
  std::vector<NumberRange> ranges;
  for (const int64_t number : numbers) {
    if (!ranges.empty() && ranges.back().last + 1 == number) {
      ranges.back().last = number;
    } else {
      ranges.push_back({number, number, 1});
    }
  }
  return ranges;
}

uint64_t count_of(const std::vector<NumberRange>& ranges) {
  uint64_t count = 0;
  for (const NumberRange& range : ranges) count += range.count();
  return count;
}

std::string to_text(const std::vector<NumberRange>& ranges, const std::string& separator, size_t most) {
  std::vector<NumberRange> parts = with_steps(ranges);
  uint64_t more = 0;
  while (parts.size() > most) {
    more += parts.back().count();
    parts.pop_back();
  }
  const auto append = [](std::string* text, const NumberRange& range) { text->append(words_for(range)); };
  return absl::StrJoin(parts, separator, append) + (more > 0 ? absl::StrFormat(" and %d more", more) : "");
}

absl::StatusOr<FrameRate> parse_frame_rate(const std::string& option, const std::string& text) {
  std::optional<FrameRate> rate;
  const std::vector<absl::string_view> parts = absl::StrSplit(text, '/');
  uint64_t frames = 0, seconds = 0;
  double decimal = 0;
  if (parts.size() == 2 && absl::SimpleAtoi(parts[0], &frames) && absl::SimpleAtoi(parts[1], &seconds) &&
      frames > 0 && frames <= kMostOfFraction && seconds > 0 && seconds <= kMostOfFraction) {
    rate = reduced({frames, seconds});
  } else if (parts.size() == 1 && absl::SimpleAtod(text, &decimal) && decimal >= kFps.min &&
             decimal <= kFps.max) {
    rate = film_rate(decimal).value_or(
        reduced({static_cast<uint64_t>(std::llround(decimal * kDecimal)), kDecimal}));
  }
  if (rate && is_usable(*rate)) return *rate;
  return usage_error(absl::StrFormat(
      "%s is %s; it must be a number such as 24 or 23.976, or a fraction such as 24000/1001, %s", option,
      text, v1::format_range(kFps.min, kFps.max)));
}

bool is_usable(FrameRate rate) {
  if (rate.frames == 0 || rate.seconds == 0) return false;
  const double value = static_cast<double>(rate.frames) / static_cast<double>(rate.seconds);
  return value >= kFps.min && value <= kFps.max;
}

FrameRate reduced(FrameRate rate) {
  const uint64_t common = std::gcd(rate.frames, rate.seconds);
  return {rate.frames / common, rate.seconds / common};
}

std::string to_text(FrameRate rate) {
  const bool reads_as_film =
      film_rate(static_cast<double>(rate.frames) / static_cast<double>(rate.seconds)).has_value();
  if (kDecimal % rate.seconds != 0 || reads_as_film) {
    return absl::StrFormat("%d/%d", rate.frames, rate.seconds);
  }
  std::string text = absl::StrFormat("%d.%09d", rate.frames / rate.seconds,
                                     rate.frames % rate.seconds * (kDecimal / rate.seconds));
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

int64_t media_time_ns(uint64_t frames, FrameRate rate) {
  const absl::uint128 twice = absl::uint128(2) * frames * 1'000'000'000 * rate.seconds;
  const absl::uint128 ns = (twice + rate.frames) / (absl::uint128(2) * rate.frames);
  const auto most = static_cast<uint64_t>(v1::kMediaTimeNs.max);
  return static_cast<int64_t>(ns > most ? most + 1 : absl::Uint128Low64(ns));
}

}  // namespace candela
