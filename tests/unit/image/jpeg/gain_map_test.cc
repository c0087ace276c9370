// The bytes of gain-map JPEG files, read back by a parser of their own.
#include "server/encode/gain_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/status.h"
#include "tests/unit/image/jpeg/jpeg_files.h"

namespace candela {
namespace {

uint32_t number(const std::string& bytes, size_t at, size_t size) {
  uint32_t v = 0;
  for (size_t i = 0; i < size; ++i) v = v << 8 | static_cast<uint8_t>(bytes.at(at + i));
  return v;
}

// A segment's place in the file, and its bytes behind the length.
struct Part {
  int marker;
  size_t at;
  std::string body;
};

// Those up to the first scan, which is the last.
std::vector<Part> parts_of(const std::string& file, size_t at = 0) {
  EXPECT_EQ(number(file, at, 2), 0xffd8u);
  std::vector<Part> parts;
  for (at += 2; parts.empty() || parts.back().marker != 0xda;) {
    EXPECT_EQ(file.at(at), '\xff');
    const size_t length = number(file, at + 2, 2);
    parts.push_back({static_cast<uint8_t>(file.at(at + 1)), at, file.substr(at + 4, length - 2)});
    at += 2 + length;
  }
  return parts;
}

// The one part with this name, which ends with a zero. The result has no name.
Part named(const std::vector<Part>& parts, int marker, const std::string& name) {
  Part found{};
  int count = 0;
  for (const Part& part : parts) {
    if (part.marker != marker || part.body.substr(0, name.size() + 1) != name + '\0') continue;
    found = {marker, part.at, part.body.substr(name.size() + 1)};
    ++count;
  }
  EXPECT_EQ(count, 1) << name;
  return found;
}

constexpr char kXmp[] = "http://ns.adobe.com/xap/1.0/", kIso[] = "urn:iso:std:iso:ts:21496:-1";

struct Entry {
  uint32_t kind, size, offset;
};

// The entries of an MPF, by its own offsets.
std::vector<Entry> entries_of(const std::string& mpf) {
  EXPECT_EQ(mpf.substr(0, 4), std::string("MM\0\x2a", 4));
  const size_t index = number(mpf, 4, 4);
  std::map<uint32_t, std::pair<uint32_t, uint32_t>> tags;  // count and value
  for (uint32_t i = 0; i < number(mpf, index, 2); ++i) {
    const size_t at = index + 2 + 12 * i;
    tags[number(mpf, at, 2)] = {number(mpf, at + 4, 4), number(mpf, at + 8, 4)};
  }
  EXPECT_EQ(tags[0xb000].second, 0x30313030u);  // "0100"
  EXPECT_EQ(tags[0xb001].second * 16, tags[0xb002].first);
  std::vector<Entry> entries;
  for (uint32_t i = 0; i < tags[0xb001].second; ++i) {
    const size_t at = tags[0xb002].second + 16 * i;
    entries.push_back({number(mpf, at, 4), number(mpf, at + 4, 4), number(mpf, at + 8, 4)});
  }
  return entries;
}

double fraction(const std::string& bytes, size_t at) {
  return static_cast<int32_t>(number(bytes, at, 4)) / static_cast<double>(number(bytes, at + 4, 4));
}

// The text between `before` and `after`.
std::string between(const std::string& text, const std::string& before, const std::string& after) {
  const size_t at = text.find(before);
  if (at == std::string::npos) return "no " + before;
  return text.substr(at + before.size(), text.find(after, at + before.size()) - at - before.size());
}

int grey(uint32_t x, uint32_t y, int) { return static_cast<int>((x * 7 + y * 3) % 256); }

TEST(GainMap, TheBaseStaysByteForByte) {
  const std::string base = jpeg_of(40, 24, grey), map = map_of(40, 24, true, grey);
  const std::string file = joined(base, map, stops_of(2));
  const std::vector<Part> before = parts_of(base), after = parts_of(file);
  // APP0 stays the first, three segments follow it, and all that was behind it stays behind them.
  ASSERT_EQ(after.size(), before.size() + 3);
  EXPECT_EQ(file.substr(0, before[1].at), base.substr(0, before[1].at));
  EXPECT_EQ(file.substr(after[4].at, base.size() - before[1].at), base.substr(before[1].at));
  const std::vector<Part> of_map = parts_of(map);
  const size_t map_at = after[4].at + base.size() - before[1].at;
  const std::vector<Part> in_file = parts_of(file, map_at);
  EXPECT_EQ(file.substr(in_file[3].at), map.substr(of_map[1].at));
}

TEST(GainMap, MpfAndTheDirectoryFindTheMap) {
  const std::string base = jpeg_of(40, 24, grey), map = map_of(20, 12, true, grey);
  const std::string file = joined(base, map, stops_of(2));
  const std::vector<Part> parts = parts_of(file);
  const Part mpf = named(parts, 0xe2, "MPF");
  const std::vector<Entry> entries = entries_of(mpf.body);
  ASSERT_EQ(entries.size(), 2u);
  EXPECT_EQ(entries[0].kind, 0x030000u);
  EXPECT_EQ(entries[0].offset, 0u);
  EXPECT_EQ(entries[1].kind, 0u);
  const size_t map_at = mpf.at + 8 + entries[1].offset;  // marker, length and name before the mark
  EXPECT_EQ(file.substr(mpf.at + 8, 2), "MM");
  EXPECT_EQ(map_at, entries[0].size);
  EXPECT_EQ(map_at + entries[1].size, file.size());
  EXPECT_EQ(number(file, map_at - 2, 4), 0xffd9ffd8u);

  const std::string xmp = named(parts, 0xe1, kXmp).body;
  EXPECT_EQ(between(xmp, "hdrgm:Version=\"", "\""), "1.0");
  EXPECT_EQ(between(xmp, "Item:Length=\"", "\""), std::to_string(entries[1].size));
  EXPECT_LT(xmp.find("Item:Semantic=\"Primary\""), xmp.find("Item:Semantic=\"GainMap\""));
  EXPECT_EQ(named(parts, 0xe2, kIso).body, std::string(4, '\0'));
}

TEST(GainMap, OneChannelHasScalars) {
  GainMapMetadata metadata = stops_of(2.3);
  metadata.min_log2[0] = -0.7;
  metadata.offset_sdr[0] = 1.0 / 64;
  metadata.offset_hdr[0] = 1e-7;
  const std::string base = jpeg_of(8, 8, grey);
  const std::string file = joined(base, map_of(8, 8, true, grey), metadata);
  const std::vector<Part> parts = parts_of(file, entries_of(named(parts_of(file), 0xe2, "MPF").body)[0].size);
  const std::string iso = named(parts, 0xe2, kIso).body;
  ASSERT_EQ(iso.size(), 4 + 1 + 16 + 40u);
  EXPECT_EQ(iso.substr(0, 4), std::string(4, '\0'));
  EXPECT_EQ(iso[4], '\x40');
  const std::vector<double> expected = {0, 2.3, -0.7, 2.3, 1, 1.0 / 64, 1e-7};
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(fraction(iso, 5 + 8 * i), expected[i], 1e-9 * std::abs(expected[i])) << i;
  }
  EXPECT_EQ(number(iso, 5 + 8 * 5 + 4, 4), 64u);
  const std::string xmp = named(parts, 0xe1, kXmp).body;
  for (const auto& [name, value] : {std::pair("Version", "1.0"),
                                    {"GainMapMin", "-0.7"},
                                    {"GainMapMax", "2.3"},
                                    {"Gamma", "1"},
                                    {"OffsetSDR", "0.015625"},
                                    {"OffsetHDR", "0.0000001"},
                                    {"HDRCapacityMin", "0"},
                                    {"HDRCapacityMax", "2.3"},
                                    {"BaseRenditionIsHDR", "False"}}) {
    EXPECT_EQ(between(xmp, std::string("hdrgm:") + name + "=\"", "\""), value);
  }
}

TEST(GainMap, ThreeChannelsHaveSequences) {
  const GainMapMetadata metadata = {.min_log2 = {-1, -2, -3},
                                    .max_log2 = {1, 2, 3},
                                    .gamma = {1, 0.5, 2},
                                    .offset_sdr = {0.25, 0.5, 0.75},
                                    .offset_hdr = {0.125, 0.375, 0.625},
                                    .headroom_base_log2 = 0.5,
                                    .headroom_hdr_log2 = 2.5,
                                    .one_channel = false};
  const std::string file = joined(jpeg_of(8, 8, grey), map_of(8, 8, false, grey), metadata);
  const std::vector<Part> parts = parts_of(file, entries_of(named(parts_of(file), 0xe2, "MPF").body)[0].size);
  const std::string iso = named(parts, 0xe2, kIso).body;
  ASSERT_EQ(iso.size(), 4 + 1 + 16 + 3 * 40u);
  EXPECT_EQ(iso[4], '\xc0');
  EXPECT_EQ(fraction(iso, 5), 0.5);
  EXPECT_EQ(fraction(iso, 13), 2.5);
  for (size_t c = 0; c < 3; ++c) {
    const double expected[] = {metadata.min_log2[c], metadata.max_log2[c], metadata.gamma[c],
                               metadata.offset_sdr[c], metadata.offset_hdr[c]};
    for (size_t i = 0; i < 5; ++i)
      EXPECT_EQ(fraction(iso, 21 + 40 * c + 8 * i), expected[i]) << c << ' ' << i;
  }
  const std::string xmp = named(parts, 0xe1, kXmp).body;
  EXPECT_EQ(between(xmp, "<hdrgm:GainMapMin>", "</hdrgm:GainMapMin>"),
            "<rdf:Seq><rdf:li>-1</rdf:li><rdf:li>-2</rdf:li><rdf:li>-3</rdf:li></rdf:Seq>");
  EXPECT_EQ(between(xmp, "<hdrgm:OffsetHDR>", "</hdrgm:OffsetHDR>"),
            "<rdf:Seq><rdf:li>0.125</rdf:li><rdf:li>0.375</rdf:li><rdf:li>0.625</rdf:li></rdf:Seq>");
  EXPECT_EQ(between(xmp, "hdrgm:HDRCapacityMax=\"", "\""), "2.5");
}

TEST(GainMap, TheSameInputsGiveTheSameBytes) {
  const auto once = [] { return joined(jpeg_of(16, 16, grey), map_of(16, 16, false, grey), stops_of(1)); };
  EXPECT_EQ(once(), once());
}

TEST(GainMap, RefusesWhatIsNoPictureOrNoMap) {
  const std::string base = jpeg_of(8, 8, grey), map = map_of(8, 8, true, grey);
  EXPECT_REFUSED(kInvalidArgument, "the base: no JPEG picture begins there",
                 join_gain_map("x", map, stops_of(1)));
  EXPECT_REFUSED(kInvalidArgument, "the gain map is not one whole JPEG picture",
                 join_gain_map(base, map.substr(0, map.size() - 2), stops_of(1)));
  EXPECT_REFUSED(kInvalidArgument, "the base is not one whole JPEG picture",
                 join_gain_map(base + "x", map, stops_of(1)));
  EXPECT_REFUSED(kInvalidArgument, "the maximum of the gain map is -1; it must be within 0 .. 64",
                 join_gain_map(base, map, stops_of(-1)));
  GainMapMetadata metadata = stops_of(1);
  metadata.gamma[0] = std::nan("");
  EXPECT_REFUSED(kInvalidArgument, "the gamma of the gain map is nan", join_gain_map(base, map, metadata));
  EXPECT_REFUSED(kInternal, "a gain map of 4x4 pixels has 3 codes; it must have 16",
                 encode_gain_map(std::vector<uint8_t>(3), 4, 4, true));
}

}  // namespace
}  // namespace candela
