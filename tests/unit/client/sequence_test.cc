// Numbers in the names of a sequence's frames: ranges, rates, media times and patterns.
#include "client/run/sequence.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "absl/numeric/int128.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/base/failure.h"
#include "proto/candela/v1/limits.h"
#include "tests/support/files.h"
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
                                                                                 {"2997/125", {2997, 125}},
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

// As OpenEXR files' numbers are.
TEST(FrameNumbers, ADecimalNumberNearAFilmRateIsThatRate) {
  for (const auto& [text, frames] : std::vector<std::pair<std::string, uint64_t>>{{"23.976", 24000},
                                                                                  {"23.98", 24000},
                                                                                  {"23.97602398", 24000},
                                                                                  {"29.97", 30000},
                                                                                  {"47.952", 48000},
                                                                                  {"59.94", 60000},
                                                                                  {"119.88", 120000}}) {
    EXPECT_EQ(*parse_frame_rate("--fps", text), (FrameRate{frames, 1001})) << text;
  }
  EXPECT_EQ(*parse_frame_rate("--fps", "23.95"), (FrameRate{479, 20})) << "near none";
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

// The frames of a sequence: numbers in names, ranges, gaps, cuts and media times.

class SequenceTest : public ::testing::Test {
 protected:
  void make(const std::vector<std::string>& names) const {
    for (const std::string& name : names) {
      std::filesystem::create_directories(std::filesystem::path(folder_.path(name)).parent_path());
      write_file(folder_.path(name), "");
    }
  }

  // The inputs are names in the folder.
  absl::StatusOr<Sequence> find(const std::vector<std::string>& inputs, SequenceChoice choice = {}) const {
    for (const std::string& input : inputs) choice.inputs.push_back(folder_.path(input));
    return find_sequence(choice);
  }

  using Numbers = std::vector<int64_t>;
  static Numbers numbers(const absl::StatusOr<Sequence>& sequence) {
    Numbers numbers;
    if (!sequence.ok()) return numbers;
    for (const SequenceFrame& frame : sequence->frames) numbers.push_back(frame.number);
    return numbers;
  }

  const TemporaryFolder folder_;
};

TEST_F(SequenceTest, NumbersComeFromTheNamesByEveryInput) {
  make({"in/frame.0099.exr", "in/frame.0100.exr", "in/frame.0101.exr"});
  for (const std::vector<std::string>& inputs : std::vector<std::vector<std::string>>{
           {"in"},
           {"in/*.exr"},
           {"in/frame.%04d.exr"},
           {"in/frame.%d.exr"},
           {"in/frame.####.exr"},
           {"in/frame.#.exr"},
           {"in/frame.@@@@.exr"},
           {"in/frame.@.exr"},
           {"in/frame.0101.exr", "in/./frame.0099.exr", "in/frame.0100.exr"}}) {
    ASSERT_OK_AND_ASSIGN(const auto sequence, find(inputs));
    EXPECT_EQ(numbers(sequence), (Numbers{99, 100, 101})) << inputs.front();
    EXPECT_EQ(sequence.zero, 99);
    EXPECT_EQ(sequence.session_number(2), 2u);
    EXPECT_EQ(sequence.index_of(2), 2u);
    EXPECT_EQ(sequence.media_time_ns(101, {10, 1}), 200'000'000);
    EXPECT_EQ(sequence.names->path(7).substr(folder_.path("").size()).find("in/"), 0u);
    EXPECT_EQ(std::filesystem::path(sequence.names->path(7)).filename(), "frame.0007.exr");
    EXPECT_EQ(sequence.notes, std::vector<std::string>());
  }
  EXPECT_REFUSED(kNotFound, "", find({"in/frame.#####.exr"})) << "five digits";
}

TEST_F(SequenceTest, TheNumberIsTheLastOneWithTheSameTextAroundItInAllNames) {
  make({"a/s01_0003_v2.exr", "a/s01_0004_v2.EXR", "b/x2_7.exr", "c/9.exr", "c/10.exr", "d/take5_01.exr"});
  EXPECT_EQ(numbers(find({"a"})), (Numbers{3, 4}));
  EXPECT_EQ(numbers(find({"b"})), (Numbers{7}));
  EXPECT_EQ(numbers(find({"c"})), (Numbers{9, 10}));
  EXPECT_EQ(find({"c"})->names->digits, 1);
  EXPECT_EQ(numbers(find({"d"})), (Numbers{1}));
  EXPECT_EQ(numbers(find({"d/take%d_01.exr"})), (Numbers{5})) << "the pattern says which";
}

TEST_F(SequenceTest, FilesWithoutACommonNumberAreCountedAndANoteSaysSo) {
  make({"a/beauty.0003.exr", "a/depth.0003.exr", "b/1.exr", "c/2.exr", "d/x.1234567890123.exr",
        "d/x.1234567890124.exr", "e/still.exr"});
  for (const std::vector<std::string>& inputs :
       std::vector<std::vector<std::string>>{{"a"}, {"b", "c"}, {"d"}}) {
    ASSERT_OK_AND_ASSIGN(const auto sequence, find(inputs));
    EXPECT_EQ(numbers(sequence), (Numbers{0, 1}));
    ASSERT_EQ(sequence.notes.size(), 1u);
    EXPECT_TRUE(says(sequence.notes[0], "do not look like a sequence"));
    EXPECT_TRUE(says(sequence.notes[0], "candela render IN... OUTDIR/"));
  }
  EXPECT_EQ(find({"e"})->notes.size(), 0u) << "one file is no mistake";
}

TEST_F(SequenceTest, AFileWithAPatternsOwnNameIsJustThatFile) {
  make({"in/a#1.exr", "in/f.@@.exr", "in/f.%04d.exr", "in/f.07.exr"});
  for (const char* name : {"in/a#1.exr", "in/f.@@.exr", "in/f.%04d.exr"}) {
    ASSERT_OK_AND_ASSIGN(const auto sequence, find({name}));
    ASSERT_EQ(sequence.frames.size(), 1u);
    EXPECT_EQ(sequence.frames[0].path, folder_.path(name));
  }
  EXPECT_EQ(numbers(find({"in/f.##.exr"})), (Numbers{7}));
  EXPECT_EQ(find({"in/a#*.exr"})->frames.size(), 1u) << "* with # is a pattern of the shell's kind";
}

TEST_F(SequenceTest, TwoFilesWithOneNumberAreRefused) {
  make({"in/f1.exr", "in/f001.exr", "in/f002.exr", "signed/f.-1.exr", "signed/f.-01.exr", "zero/f.-0.exr",
        "zero/f.0.exr"});
  EXPECT_REFUSED(kInvalidArgument, "are both frame -1;", find({"signed"}));
  EXPECT_REFUSED(kInvalidArgument, "are both frame 0;", find({"zero"}));
  EXPECT_REFUSED(kInvalidArgument, "are both frame 1;", find({"in/f%d.exr"}));
  EXPECT_EQ(numbers(find({"in/f%03d.exr"})), (Numbers{1, 2})) << "a pattern tells them apart";
}

TEST_F(SequenceTest, AGapIsRefusedByItsNumbers) {
  make({"in/f.1.exr", "in/f.2.exr", "in/f.3.exr", "in/f.5.exr", "in/f.6.exr", "in/f.9.exr"});
  const absl::Status status = find({"in"}).status();
  EXPECT_EQ(status.message(), folder_.path("in/f.%d.exr") +
                                  ": frames 4, 7-8 are missing; --missing skip renders "
                                  "the others, --missing hold repeats the frame before");
  EXPECT_FALSE(is_usage_error(status)) << "the command is right, the files are not";
}

TEST_F(SequenceTest, AGapIsKeptAsTimeOrFilled) {
  make({"in/f.3.exr", "in/f.5.exr", "in/f.8.exr"});
  ASSERT_OK_AND_ASSIGN(const auto skipped, find({"in"}, {.missing = MissingFrames::kSkip}));
  EXPECT_EQ(numbers(skipped), (Numbers{3, 5, 8}));
  EXPECT_EQ(skipped.missing, (std::vector<NumberRange>{{4, 4, 1}, {6, 7, 1}}));
  EXPECT_EQ(skipped.media_time_ns(8, {1, 1}), 5'000'000'000);
  EXPECT_EQ(skipped.frames[2].place, 2u);
  ASSERT_EQ(skipped.notes.size(), 1u);
  EXPECT_TRUE(says(skipped.notes[0], "frames 4, 6-7 are missing"));

  ASSERT_OK_AND_ASSIGN(const auto held, find({"in"}, {.missing = MissingFrames::kHold}));
  EXPECT_EQ(numbers(held), (Numbers{3, 5, 8}));
  EXPECT_EQ(held.frames[0].holds, (Numbers{4}));
  EXPECT_EQ(held.frames[1].holds, (Numbers{6, 7}));
  EXPECT_EQ(held.frames[2].place, 5u);
  EXPECT_EQ(held.frames[2].holds, Numbers());
  EXPECT_EQ(held.session_number(2), skipped.session_number(2)) << "later frames are the same ones";
}

TEST_F(SequenceTest, ARangeChoosesAndKeepsTheTimeOfTheWhole) {
  make({"in/f.01.exr", "in/f.02.exr", "in/f.03.exr", "in/f.05.exr", "in/f.07.exr"});
  ASSERT_OK_AND_ASSIGN(const auto odd, find({"in"}, {.range = {{1, 7, 2}}}));
  EXPECT_EQ(numbers(odd), (Numbers{1, 3, 5, 7}));
  EXPECT_TRUE(odd.missing.empty()) << "steps are no gaps";
  ASSERT_OK_AND_ASSIGN(const auto part, find({"in"}, {.range = {{2, 3, 1}}}));
  EXPECT_EQ(numbers(part), (Numbers{2, 3}));
  EXPECT_EQ(part.zero, 1);
  EXPECT_EQ(part.session_number(0), 1u);
  EXPECT_EQ(part.media_time_ns(2, {1, 1}), 1'000'000'000);
  EXPECT_EQ(numbers(find({"in"}, {.range = {{5, kLargestFrameNumber, 2}}})), (Numbers{5, 7}));
  EXPECT_REFUSED(kNotFound, "frame 4 is missing", find({"in"}, {.range = {{3, 5, 1}}}));
  EXPECT_REFUSED(kNotFound, "frames 6, 8 are missing", find({"in"}, {.range = {{6, 8, 1}}}));
  EXPECT_REFUSED(kNotFound, "--range 30-40: there is no such frame; there are frames 1 to 7",
                 find({"in"}, {.range = {{30, 40, 1}}}));
}

TEST_F(SequenceTest, TheFirstChosenFrameCannotRepeatAnother) {
  make({"in/f.03.exr", "in/f.05.exr"});
  EXPECT_REFUSED(kNotFound, "frame 2 is missing, and no frame before it can be repeated; begin --range at 3",
                 find({"in"}, {.range = {{2, 5, 1}}, .missing = MissingFrames::kHold}));
  EXPECT_EQ(numbers(find({"in"}, {.range = {{2, 5, 1}}, .missing = MissingFrames::kSkip})), (Numbers{3, 5}));
  ASSERT_OK_AND_ASSIGN(const auto after,
                       find({"in"}, {.range = {{3, 7, 1}}, .missing = MissingFrames::kHold}));
  EXPECT_EQ(after.frames[1].holds, (Numbers{6, 7})) << "the last frame is held to the range's end";
}

TEST_F(SequenceTest, AHoldLooksBackOverTheRangesStart) {
  make({"in/f.03.exr", "in/f.05.exr", "in/f.08.exr"});
  const auto hold = MissingFrames::kHold;
  ASSERT_OK_AND_ASSIGN(const auto part, find({"in"}, {.range = {{4, 7, 1}}, .missing = hold}));
  EXPECT_EQ(numbers(part), (Numbers{5}));
  EXPECT_EQ(part.holds_before, (Numbers{4}));
  EXPECT_EQ(part.frames[0].place, 1u);
  EXPECT_EQ(part.frames[0].holds, (Numbers{6, 7}));
  EXPECT_EQ(part.files.size(), 3u) << "what may be repeated";
  for (const NumberRange range : {NumberRange{6, 7, 1}, NumberRange{9, 10, 1}}) {
    ASSERT_OK_AND_ASSIGN(const auto only, find({"in"}, {.range = {range}, .missing = hold}));
    EXPECT_EQ(numbers(only), Numbers());
    EXPECT_EQ(only.holds_before, (Numbers{range.first, range.last}));
    EXPECT_EQ(only.first(), range.first);
    EXPECT_EQ(only.last(), range.last);
  }
  for (const NumberRange range : {NumberRange{9, kLargestFrameNumber, 1}, NumberRange{1, 2, 1}}) {
    EXPECT_REFUSED(kNotFound, "there is no such frame", find({"in"}, {.range = {range}, .missing = hold}));
  }
  EXPECT_REFUSED(kInvalidArgument, "frame 4 comes before frame 5",
                 find({"in"}, {.range = {{4, 5, 1}}, .missing = hold, .zero = 5}));
}

TEST_F(SequenceTest, NegativeNumbersPlayInTheirOrderByEveryInput) {
  make({"in/f.-010.exr", "in/f.-009.exr", "in/f.-001.exr", "in/f.0000.exr", "in/f.0002.exr"});
  for (const char* input :
       {"in", "in/*.exr", "in/f.%04d.exr", "in/f.%d.exr", "in/f.####.exr", "in/f.@@@@.exr"}) {
    ASSERT_OK_AND_ASSIGN(const auto sequence, find({input}, {.missing = MissingFrames::kHold}));
    EXPECT_EQ(numbers(sequence), (Numbers{-10, -9, -1, 0, 2})) << input;
    EXPECT_EQ(sequence.missing, (std::vector<NumberRange>{{-8, -2, 1}, {1, 1, 1}}));
    EXPECT_EQ(sequence.frames[1].holds.front(), -8);
    EXPECT_EQ(sequence.zero, -10);
    EXPECT_EQ(sequence.session_number(2), 9u) << "the wire counts from 0";
    EXPECT_EQ(sequence.index_of(9), 2u);
    EXPECT_EQ(sequence.media_time_ns(2, {1, 1}), 12'000'000'000);
    EXPECT_EQ(std::filesystem::path(sequence.names->path(-7)).filename(), "f.-007.exr");
    EXPECT_EQ(std::filesystem::path(sequence.names->path(7)).filename(), "f.0007.exr");
  }
  EXPECT_EQ(numbers(find({"in"}, {.range = {{-10, -9, 1}}})), (Numbers{-10, -9}));
  EXPECT_EQ(numbers(find({"in"}, {.range = {{-1, kLargestFrameNumber, 1}}, .missing = MissingFrames::kSkip})),
            (Numbers{-1, 0, 2}));
  EXPECT_REFUSED(kNotFound, "--range -30--20: there is no such frame; there are frames -10 to 2",
                 find({"in"}, {.range = {{-30, -20, 1}}}));
}

TEST_F(SequenceTest, AnyWidthOfANegativeNumberIsReadAndOthersAreNamedLikeIt) {
  for (const auto& [names, named] :
       std::vector<std::pair<std::vector<std::string>, std::string>>{{{"-5", "-3"}, "-4"},
                                                                     {{"-05", "-03"}, "-04"},
                                                                     {{"-0005", "-0003"}, "-0004"},
                                                                     {{"-0005", "0003"}, "-0004"},
                                                                     {{"-005", "0003"}, "-004"},
                                                                     {{"-5", "3"}, "-4"},
                                                                     {{"-10", "3"}, "-4"},
                                                                     {{"-05", "-0003"}, "-04"}}) {
    for (const char* before : {"f.", "f_", ""}) {
      std::filesystem::remove_all(folder_.path("in"));
      make({"in/" + (before + names[0]) + ".exr", "in/" + (before + names[1]) + ".exr"});
      ASSERT_OK_AND_ASSIGN(const auto sequence, find({"in"}, {.missing = MissingFrames::kSkip}));
      EXPECT_EQ(sequence.first(), std::stoi(names[0]));
      EXPECT_EQ(sequence.last(), std::stoi(names[1]));
      EXPECT_EQ(std::filesystem::path(sequence.names->path(-4)).filename(), before + named + ".exr");
    }
  }
}

TEST_F(SequenceTest, ElsewhereAMinusSeparates) {
  make({"a/shot-1001.exr", "a/shot-1002.exr", "b/f.-03.exr", "b/f.-04.exr", "b/f.05.exr", "c/x--1.exr",
        "c/x--2.exr", "d/f.-0.exr", "d/f.1.exr", "e/2024-01-05.exr", "e/2024-01-06.exr"});
  EXPECT_EQ(numbers(find({"a"})), (Numbers{1001, 1002}));
  EXPECT_EQ(numbers(find({"a/shot-%04d.exr"})), (Numbers{1001, 1002}));
  EXPECT_REFUSED(kNotFound, "", find({"a/shot%04d.exr"}));
  EXPECT_EQ(numbers(find({"b/f.-%02d.exr"})), (Numbers{-4, -3})) << "the pattern's own minus is a sign, too";
  EXPECT_EQ(numbers(find({"b/f.-*.exr"})), (Numbers{-4, -3}));
  EXPECT_EQ(numbers(find({"c"})), (Numbers{1, 2}));
  EXPECT_EQ(numbers(find({"d"})), (Numbers{0, 1})) << "-0 is 0";
  EXPECT_EQ(numbers(find({"e"})), (Numbers{5, 6}));
}

TEST_F(SequenceTest, HiddenFilesAndNamesThatDoNotFitAreLeftOutAndCounted) {
  make({"in/f.-1.exr", "in/f.0.exr", "in/f.1.exr", "in/f-1.exr", "in/._f.-1.exr", "in/._f.0.exr",
        "in/.f.2.exr", "in/notes.txt", "one/f.1.exr", "one/f.2.exr", "one/chart.exr", "one/._f.1.exr"});
  ASSERT_OK_AND_ASSIGN(const auto sequence, find({"in"}));
  EXPECT_EQ(numbers(sequence), (Numbers{-1, 0, 1}));
  EXPECT_EQ(sequence.zero, -1);
  const std::string in = folder_.path("in/"), one = folder_.path("one/");
  EXPECT_EQ(sequence.notes, std::vector<std::string>{"left out: 3 hidden files (" + in +
                                                     "._f.-1.exr ...), and 1 file of another kind (" + in +
                                                     "notes.txt), and 1 file whose name does not fit " + in +
                                                     "f.%d.exr (" + in + "f-1.exr)"});
  ASSERT_OK_AND_ASSIGN(const auto other, find({"one"}));
  EXPECT_EQ(numbers(other), (Numbers{1, 2}));
  EXPECT_EQ(other.notes, std::vector<std::string>{"left out: 1 hidden file (" + one +
                                                  "._f.1.exr), and 1 file whose name does not fit " + one +
                                                  "f.%d.exr (" + one + "chart.exr)"});
  EXPECT_EQ(find({"one/*.exr"})->notes.size(), 1u)
      << "a pattern of the shell's kind hides hidden files itself";
  EXPECT_EQ(find({"one/f.%d.exr"})->notes.size(), 0u) << "what the user did not ask for is not left out";
  EXPECT_EQ(numbers(find({"in/.f.2.exr"})), (Numbers{2})) << "a file that is named is taken";
}

TEST_F(SequenceTest, OnlyHiddenFilesAreNoSequence) {
  make({"in/._f.1.exr", "in/._f.2.exr"});
  EXPECT_REFUSED(kNotFound, ".tif or .tiff file but 2 hidden files", find({"in"}));
}

TEST_F(SequenceTest, AFolderIsAllImagesOfTheFormatsThatAreRead) {
  make({"in/f.1.exr", "in/f.2.HDR", "in/f.3.pfm", "in/f.4.phm", "in/f.5.png", "in/f.6.avif", "in/f.7.jpg",
        "in/f.8.JPEG", "in/f.9.jfif", "in/f.10.TIF", "in/f.11.tiff", "in/f.12.txt", "in/f.13", "in/f.14.mp4",
        "in/sub.exr/f.13.exr"});
  ASSERT_OK_AND_ASSIGN(const FoundFiles found, find_frames({folder_.path("in")}));
  ASSERT_EQ(found.paths.size(), 11u);
  for (size_t i = 0; i < 11; ++i) EXPECT_TRUE(says(found.paths[i], absl::StrCat("f.", i + 1, ".")));
  EXPECT_EQ(words_of(found.left_out), "3 files of other kinds (" + folder_.path("in/f.12.txt") + " ...)");
}

TEST_F(SequenceTest, ASequenceIsOfOneFormatWhichOnlyChooses) {
  make({"in/f.1.exr", "in/f.2.exr", "in/f.1.png", "in/f.2.png", "jpeg/f.1.jpg", "jpeg/f.2.jpeg",
        "stray/f.1.exr", "stray/f.2.exr", "stray/thumbnail.jpg"});
  const std::string in = folder_.path("in/");
  for (const std::vector<std::string>& inputs :
       std::vector<std::vector<std::string>>{{"in"}, {"in/*"}, {"in/f.1.exr", "in/f.2.png"}}) {
    EXPECT_REFUSED(kInvalidArgument, "but a sequence is of one format; --only exr or --only png chooses",
                   find(inputs));
  }
  EXPECT_REFUSED(kInvalidArgument, in + "f.1.exr is OpenEXR and " + in + "f.1.png is PNG", find({"in"}));
  EXPECT_REFUSED(kInvalidArgument, "thumbnail.jpg is JPEG", find({"stray"}));
  EXPECT_EQ(numbers(find({"jpeg"})), (Numbers{1, 2})) << "two extensions of one format";
  for (const std::vector<std::string>& inputs :
       std::vector<std::vector<std::string>>{{"in"}, {"in/*"}, {"in/f.1.exr", "in/f.2.png", "in/f.2.exr"}}) {
    ASSERT_OK_AND_ASSIGN(const auto sequence, find(inputs, {.only = {".exr"}}));
    EXPECT_EQ(sequence.files.at(1), in + "f.1.exr");
    EXPECT_EQ(sequence.files.at(2), in + "f.2.exr");
    ASSERT_EQ(sequence.notes.size(), 1u);
    EXPECT_TRUE(says(sequence.notes[0], "of another kind") || says(sequence.notes[0], "of other kinds"));
  }
  EXPECT_REFUSED(kNotFound, "no .hdr file but 4 files of other kinds", find({"in"}, {.only = {".hdr"}}));
}

TEST_F(SequenceTest, NamesThatFitNoSequenceByHalfAreStills) {
  make({"two/a.1.exr", "two/a.2.exr", "two/b.1.exr", "two/b.2.exr", "few/a.1.exr", "few/a.2.exr", "few/b.exr",
        "few/c.exr", "few/d.exr", "half/a.1.exr", "half/a.2.exr", "half/b.exr", "half/c.exr", "long/f.1.exr",
        "long/f.2.exr", "long/f.1234567890123.exr"});
  EXPECT_EQ(numbers(find({"two"})), (Numbers{0, 1, 2, 3}));
  EXPECT_EQ(numbers(find({"few"})), (Numbers{0, 1, 2, 3, 4}));
  EXPECT_EQ(numbers(find({"half"})), (Numbers{1, 2}));
  EXPECT_EQ(numbers(find({"long"})), (Numbers{1, 2})) << "13 digits are no number of a frame";
}

TEST_F(SequenceTest, ASequenceOnTwosIsToldItsRange) {
  make({"in/f.1.exr", "in/f.3.exr", "in/f.5.exr", "in/f.7.exr"});
  EXPECT_REFUSED(kNotFound, "frames 2-6x2 are missing; --range 1-7x2 takes the frames in steps of 2, ",
                 find({"in"}));
}

TEST_F(SequenceTest, AHugeGapTakesNoMemory) {
  make({"in/f.1.exr", "in/f.999999999999.exr"});
  ASSERT_OK_AND_ASSIGN(const auto skipped, find({"in"}, {.missing = MissingFrames::kSkip}));
  EXPECT_EQ(count_of(skipped.missing), 999'999'999'997u);
  EXPECT_REFUSED(kResourceExhausted, "", find({"in"}, {.missing = MissingFrames::kHold}));
  EXPECT_REFUSED(kNotFound, "candela render IN... OUTDIR/", find({"in"}));
  EXPECT_OK(check_media_time(skipped, {1000, 1}));
  EXPECT_REFUSED(kInvalidArgument, "146 years", check_media_time(skipped, {24, 1}));
}

TEST_F(SequenceTest, CutsAreNumbersOfTheNames) {
  make({"in/f.10.exr", "in/f.11.exr", "in/f.13.exr", "in/f.14.exr"});
  const auto cuts = [](const absl::StatusOr<Sequence>& sequence) {
    Numbers numbers;
    for (const SequenceFrame& frame : sequence->frames) {
      if (frame.cut) numbers.push_back(frame.number);
    }
    return numbers;
  };
  const auto skip = MissingFrames::kSkip;
  EXPECT_EQ(cuts(find({"in"}, {.missing = skip, .cuts = {11, 14}})), (Numbers{11, 14}));
  EXPECT_EQ(cuts(find({"in"}, {.missing = skip, .cuts = {12}})), (Numbers{13}))
      << "the scene begins all the same";
  EXPECT_EQ(cuts(find({"in"}, {.range = {{13, 14, 1}}, .cuts = {11, 14}})), (Numbers{14}))
      << "a cut in another part of the sequence is none here";
  EXPECT_EQ(cuts(find({"in"}, {.range = {{10, 11, 1}}, .cuts = {13}})), Numbers());
  EXPECT_EQ(cuts(find({"in"}, {.range = {{12, 14, 1}}, .missing = skip, .cuts = {12}})), (Numbers{13}));
  EXPECT_REFUSED(kInvalidArgument, "--cut-at 87: there is no such frame; there are frames 10 to 14",
                 find({"in"}, {.missing = skip, .cuts = {87}}));
  EXPECT_EQ(cuts(find({"in"}, {.missing = skip, .cuts = {5, 14, 87}, .zero = 1})), (Numbers{14}))
      << "a part of the files of a session that is continued";
  EXPECT_EQ(cuts(find({"in"}, {.range = {{13, 14, 1}}, .cuts = {12}, .zero = 10})), Numbers());
  EXPECT_EQ(cuts(find({"in"}, {.range = {{13, 14, 1}}, .cuts = {11, 12}, .zero = 10, .after = 11})),
            (Numbers{13}))
      << "the part before ended before the missing frame that begins the scene";
  EXPECT_TRUE(find({"in"}, {.range = {{10, 12, 1}}, .missing = skip, .cuts = {12}})->cut_after)
      << "the next part begins with it";
  EXPECT_FALSE(find({"in"}, {.range = {{10, 11, 1}}, .missing = skip, .cuts = {12, 13}})->cut_after);
  EXPECT_REFUSED(kInvalidArgument, "--cut-at 5", find({"in"}, {.missing = skip, .cuts = {5}, .zero = 8}))
      << "no part of it has this frame";
}

TEST_F(SequenceTest, AContinuedSessionSaysWhereItsTimeBegan) {
  make({"in/f.50.exr", "in/f.51.exr"});
  ASSERT_OK_AND_ASSIGN(const auto sequence, find({"in"}, {.zero = 1}));
  EXPECT_EQ(sequence.session_number(0), 49u);
  EXPECT_EQ(sequence.index_of(50), 1u);
  EXPECT_REFUSED(kInvalidArgument, "", find({"in"}, {.zero = 51}));
}

}  // namespace
}  // namespace candela
