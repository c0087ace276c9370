// Numbers in the names of a sequence's frames: ranges, rates, media times and patterns.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/numeric/int128.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/base/failure.h"
#include "client/run/sequence.h"
#include "proto/candela/v1/limits.h"
#include "tests/support/status.h"

namespace candela {
namespace {

constexpr FrameRate kFilm{24000, 1001};

TEST(FrameNumbers, ARangeIsParsedAsItIsWritten) {
  for (const auto& [text, ranges] : std::vector<std::pair<std::string, std::vector<NumberRange>>>{
           {"7", {{7, 7, 1}}},
           {"0", {{0, 0, 1}}},
           {"100-200", {{100, 200, 1}}},
           {"100-200x2", {{100, 200, 2}}},
           {"100-", {{100, kLargestFrameNumber, 1}}},
           {"100-x5", {{100, kLargestFrameNumber, 5}}},
           {"-5", {{-5, -5, 1}}},
           {"-10--5", {{-10, -5, 1}}},
           {"-2-2x2", {{-2, 2, 2}}},
           {"-5-", {{-5, kLargestFrameNumber, 1}}},
           {"-5-x3", {{-5, kLargestFrameNumber, 3}}},
           {"-999999999999", {{-kLargestFrameNumber, -kLargestFrameNumber, 1}}},
           {"-3--2,-1,4", {{-3, -2, 1}, {-1, -1, 1}, {4, 4, 1}}},
           {"1-10,20-30x3,40", {{1, 10, 1}, {20, 30, 3}, {40, 40, 1}}}}) {
    ASSERT_OK_AND_ASSIGN(const auto parsed, parse_number_ranges("--range", text));
    EXPECT_EQ(parsed, ranges) << text;
    EXPECT_EQ(to_text(parsed), text);
  }
}

TEST(FrameNumbers, AMalformedRangeIsAUsageErrorThatNamesTheOptionAndTheWayOut) {
  for (const char* text :
       {"",     "a",  "-",   "--", "--5", "5--", "-5--",  "5---4",         "1-9x0",          "1-9x", "1-9x-2",
        "1,,2", "1,", "1.5", "x2", "+3",  " 3",  "1-9:2", "1234567890123", "-1234567890123", "-a"}) {
    const absl::Status status = parse_number_ranges("--range", text).status();
    EXPECT_TRUE(is_usage_error(status)) << text;
    EXPECT_REFUSED(kInvalidArgument, absl::StrCat("--range is \"", text, "\""), status);
    EXPECT_REFUSED(kInvalidArgument, "100-200x2", status);
  }
  for (const char* text : {"", "1-2", "1,--2", "1,-", "-1234567890123"}) {
    EXPECT_TRUE(is_usage_error(parse_frame_numbers("--cut-at", text).status())) << text;
  }
  EXPECT_EQ(*parse_frame_numbers("--cut-at", "87,24,24,-3,-0"), (std::vector<int64_t>{-3, 0, 24, 87}));
}

TEST(FrameNumbers, ARangeThatRunsBackwardsIsToldTheForwardOne) {
  for (const auto& [text, forward] :
       std::vector<std::pair<std::string, std::string>>{{"5-4", "4-5"},
                                                        {"200-100x2", "100-200x2"},
                                                        {"200-100x-1", "100-200"},
                                                        {"-5--10", "-10--5"},
                                                        {"2--2", "-2-2"},
                                                        {"1-3,9-7", "7-9"}}) {
    const absl::Status status = parse_number_ranges("--range", text).status();
    EXPECT_TRUE(is_usage_error(status)) << text;
    EXPECT_EQ(status.message(), "--range is \"" + text +
                                    "\", which runs backwards; frames are rendered in the order of their "
                                    "numbers, so give " +
                                    forward);
  }
}

TEST(FrameNumbers, RangesChooseEachNumberOnceAndNotTooMany) {
  EXPECT_EQ(*numbers_in({{3, 9, 3}, {1, 4, 1}}, 0), (std::vector<int64_t>{1, 2, 3, 4, 6, 9}));
  EXPECT_EQ(*numbers_in({{-2, 2, 2}, {-3, -2, 1}}, 0), (std::vector<int64_t>{-3, -2, 0, 2}));
  EXPECT_EQ(*numbers_in({{3, kLargestFrameNumber, 2}}, 8), (std::vector<int64_t>{3, 5, 7}));
  EXPECT_EQ(*numbers_in({{-3, kLargestFrameNumber, 1}}, -2), (std::vector<int64_t>{-3, -2}));
  EXPECT_EQ(numbers_in({{1, int64_t{kMostNumbers}, 1}}, 0)->size(), kMostNumbers);
  EXPECT_REFUSED(kResourceExhausted, "", numbers_in({{0, int64_t{kMostNumbers}, 1}}, 0));
  const std::vector<NumberRange> huge(1000, {-kLargestFrameNumber, kLargestFrameNumber - 1, 1});
  EXPECT_REFUSED(kResourceExhausted, "", numbers_in(huge, 0));
}

TEST(FrameNumbers, NumbersAreSaidAsRangesAndSteps) {
  EXPECT_EQ(to_text(ranges_of({4, 10, 11, 12})), "4,10-12");
  EXPECT_EQ(to_text(ranges_of({4, 10}), ", "), "4, 10");
  EXPECT_EQ(to_text(ranges_of({2, 4, 6, 8, 20, 21})), "2-8x2,20-21");
  EXPECT_EQ(to_text(ranges_of({1, 2, 4, 6, 8})), "1-2,4-8x2");
  EXPECT_EQ(to_text(ranges_of({-10, -9, -8, -1, 0, 1, 5})), "-10--8,-1-1,5");
  EXPECT_EQ(to_text(ranges_of({-4, -2, 0, 2})), "-4-2x2");
  EXPECT_EQ(to_text(std::vector<NumberRange>()), "");
  EXPECT_EQ(to_text({{1, 1, 1}, {5, 9, 1}, {20, 21, 1}}, ", ", 1), "1 and 7 more");
  EXPECT_EQ(count_of({{1, 9, 2}, {20, 21, 1}}), 7u);
}

TEST(FrameNumbers, ARateIsExactlyWhatWasWritten) {
  for (const auto& [text, rate] : std::vector<std::pair<std::string, FrameRate>>{{"24", {24, 1}},
                                                                                 {"24000/1001", kFilm},
                                                                                 {"48/2", {24, 1}},
                                                                                 {"23.976", {2997, 125}},
                                                                                 {"0.001", {1, 1000}},
                                                                                 {"100000", {100000, 1}}}) {
    ASSERT_OK_AND_ASSIGN(const auto parsed, parse_frame_rate("--fps", text));
    EXPECT_EQ(parsed, rate) << text;
    EXPECT_EQ(to_text(parsed), text == "48/2" ? "24" : text);
  }
  for (const char* text : {"", "0", "-24", "nan", "inf", "24/0", "0/1", "24/", "/2", "1/2/3", "24000:1001",
                           "100001", "1/1001", "0.0009", "99999999999999/99999999999999"}) {
    EXPECT_TRUE(is_usage_error(parse_frame_rate("--fps", text).status())) << text;
  }
}

// A whole number of nanoseconds is right if it is within half of one of the exact time.
TEST(FrameNumbers, MediaTimesOfAMillionFilmFramesAreExactToHalfANanosecond) {
  for (uint64_t frame = 0; frame <= 1'000'000; ++frame) {
    const auto ns = static_cast<absl::int128>(media_time_ns(frame, kFilm));
    const absl::int128 off = ns * 24000 - absl::int128(frame) * 1001 * 1'000'000'000;
    ASSERT_LE(off * 2, 24000) << frame;
    ASSERT_GE(off * 2, -24000) << frame;
  }
  EXPECT_EQ(media_time_ns(24000, kFilm), 1001'000'000'000);
  EXPECT_EQ(media_time_ns(1, {24, 1}), 41'666'667);
  EXPECT_EQ(media_time_ns(3, {24, 1}), 125'000'000);
  EXPECT_EQ(media_time_ns(1, {400'000'000, 1}), 3) << "2.5 ns";
  EXPECT_EQ(media_time_ns(kLargestFrameNumber, {1, 1000}), v1::kMediaTimeNs.max + 1);
}

TEST(NamePattern, TheNumberIsFoundInAnySpelling) {
  struct Case {
    std::string text, before, after;
    int digits;
  };
  for (const Case& c : std::vector<Case>{{"a/f.%04d.exr", "a/f.", ".exr", 4},
                                         {"a/f%d.exr", "a/f", ".exr", 0},
                                         {"f.####.exr", "f.", ".exr", 4},
                                         {"f.#.exr", "f.", ".exr", 1},
                                         {"f.@@@.exr", "f.", ".exr", 3},
                                         {"f@.exr", "f", ".exr", 1},
                                         {"a%/f#2@x.%03d.exr", "a%/f#2@x.", ".exr", 3}}) {
    const auto pattern = parse_name_pattern(c.text);
    ASSERT_TRUE(pattern.ok() && *pattern) << c.text;
    EXPECT_EQ((*pattern)->before, c.before);
    EXPECT_EQ((*pattern)->after, c.after);
    EXPECT_EQ((*pattern)->digits, c.digits);
  }
  for (const char* text : {"f.exr", "a#/b@/c%d/f.exr", ""})
    EXPECT_EQ(*parse_name_pattern(text), std::nullopt) << text;
  for (const char* text : {"%x", "%", "%04d-%d", "%d%", "%%", "#-#", "@_@", "%13d", "#############"}) {
    EXPECT_TRUE(is_usage_error(parse_name_pattern(text).status())) << text;
  }
  EXPECT_EQ((NamePattern{"f.", ".exr", 4}.path(12)), "f.0012.exr");
  EXPECT_EQ((NamePattern{"f.", ".exr", 4}.path(12345)), "f.12345.exr");
  EXPECT_EQ((NamePattern{"f.", ".exr", 4}.path(-5)), "f.-005.exr") << "as printf writes it";
  EXPECT_EQ((NamePattern{"f.", ".exr", 4}.path(-12345)), "f.-12345.exr");
  EXPECT_EQ((NamePattern{"f.", ".exr", 1}.path(-5)), "f.-5.exr");
  EXPECT_EQ((NamePattern{"f.", ".exr", 4, true}.path(-5)), "f.-0005.exr");
  EXPECT_EQ((NamePattern{"f.", ".exr", 4}.text()), "f.%04d.exr");
  EXPECT_EQ((NamePattern{"f.", ".exr", 1}.text()), "f.%d.exr");
}

TEST(NamePattern, AMinusIsASignOnlyWhereANumberBegins) {
  const auto number = [](const std::string& before, const std::string& digits) {
    return number_between(before + digits + ".exr", before.size(), 4);
  };
  for (const char* before : {"f.", "f_", "", "in/", "in/f.", "a.b_"}) {
    EXPECT_EQ(number(before, "-005"), -5) << before;
    EXPECT_EQ(number(before, "-0005"), -5) << before;
    EXPECT_EQ(number(before, "-5"), -5) << before;
    EXPECT_EQ(number(before, "-000"), 0) << before;
    EXPECT_EQ(number(before, "005"), 5) << before;
    EXPECT_EQ(number(before, "--5"), std::nullopt) << before;
    EXPECT_EQ(number(before, "-"), std::nullopt) << before;
    EXPECT_EQ(number(before, "-1234567890123"), std::nullopt) << before;
    EXPECT_EQ(number(before, "-123456789012"), -123456789012) << before;
    EXPECT_TRUE((NamePattern{before, ".exr", 4}.keeps_sign())) << before;
  }
  for (const char* before : {"f", "shot-", "in/f", "2", "f "}) {
    EXPECT_EQ(number(before, "-005"), std::nullopt) << before;
    EXPECT_EQ(number(before, "005"), 5) << before;
    EXPECT_FALSE((NamePattern{before, ".exr", 4}.keeps_sign())) << before;
  }
}

TEST(NaturalOrder, NumbersBelow0ComeBeforeTheOthers) {
  const std::vector<std::string> ordered{"-2.exr",     "-1.exr",   "0.exr",      "1.exr",    "a-1.exr",
                                         "a-2.exr",    "a-10.exr", "f.-10.exr",  "f.-9.exr", "f.-009_2.exr",
                                         "f.-1_x.exr", "f.0.exr",  "f.2.exr",    "f.10.exr", "f.a.exr",
                                         "f_-3.exr",   "f_-2.exr", "f_0_-1.exr", "f_0_0.exr"};
  for (size_t i = 0; i < ordered.size(); ++i) {
    for (size_t j = 0; j < ordered.size(); ++j) {
      EXPECT_EQ(natural_less(ordered[i], ordered[j]), i < j) << ordered[i] << " " << ordered[j];
    }
  }
}

TEST(ChosenRate, TheUsersRateWinsThenTheFiles) {
  EXPECT_EQ(choose_rate(FrameRate{25, 1}, kFilm).rate, (FrameRate{25, 1}));
  EXPECT_EQ(to_text(choose_rate(std::nullopt, kFilm)), "24000/1001 fps, from the file");
  EXPECT_EQ(to_text(choose_rate(std::nullopt, FrameRate{24024, 1001})), "24 fps, from the file");
  EXPECT_EQ(choose_rate(std::nullopt, std::nullopt).rate, (FrameRate{24, 1}));
}

TEST(OutputNames, ANumberIsWrittenInAnySpelling) {
  for (const auto& [output, path] :
       std::vector<std::pair<std::string, std::string>>{{"out/%04d.png", "out/0012.png"},
                                                        {"out/####.png", "out/0012.png"},
                                                        {"out/@@@.png", "out/012.png"},
                                                        {"out/#.png", "out/12.png"},
                                                        {"out/f%d.png", "out/f12.png"}}) {
    ASSERT_OK_AND_ASSIGN(const auto names, OutputNames::parse(output, ".png"));
    EXPECT_FALSE(names.is_folder());
    EXPECT_EQ(names.path(12, "in/a.exr"), path);
    EXPECT_EQ(names.path(-12, ""),
              absl::StrReplaceAll(path, {{"0012", "-012"}, {"012", "-12"}, {"12", "-12"}}));
    EXPECT_EQ(names.extension(), ".png");
  }
  for (const char* folder : {"out", "shot#3", "renders@home"}) {
    ASSERT_OK_AND_ASSIGN(const auto names, OutputNames::parse(folder, ".png"));
    EXPECT_TRUE(names.is_folder());
    EXPECT_EQ(names.path(12, "in/frame.0007.exr"), std::string(folder) + "/frame.0007.png");
    EXPECT_EQ(names.path(12, ""), std::string(folder) + "/0012.png");
    EXPECT_EQ(names.path(-12, ""), std::string(folder) + "/-012.png");
    EXPECT_TRUE(names.keeps_sign());
  }
  EXPECT_TRUE(is_usage_error(OutputNames::parse("out/one.png", ".png").status()));
  EXPECT_TRUE(is_usage_error(OutputNames::parse("out/#-#.png", ".png").status()));
}

}  // namespace
}  // namespace candela
