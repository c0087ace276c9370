// `candela report`: the data, the page and the tables.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

// Collects the paths of all nulls.
void find_blanks(const nlohmann::json& value, const std::string& where, std::vector<std::string>& blanks) {
  if (value.is_null()) blanks.push_back(where);
  if (!value.is_structured()) return;
  for (const auto& [key, item] : value.items()) find_blanks(item, where + "/" + key, blanks);
}

void expect_png(const std::string& folder, const std::string& name) {
  EXPECT_EQ(read_file(folder + "/" + name).substr(1, 3), "PNG") << name;
}

// The page holds the whole report, escaped so that it cannot end
// its element, and the scripts. It loads nothing else.
void expect_page_holds(const std::string& page, const nlohmann::json& report) {
  const std::string begin_tag = "<script type=\"application/json\" id=\"report\">";
  const size_t begin = page.find(begin_tag);
  ASSERT_NE(begin, std::string::npos);
  const size_t text = begin + begin_tag.size(), end = page.find('<', text);
  EXPECT_EQ(page.compare(end, 9, "</script>"), 0);
  EXPECT_EQ(nlohmann::json::parse(page.substr(text, end - text)), report);
  EXPECT_TRUE(says(page, "drawPage();"));
  EXPECT_TRUE(says(page, "</html>"));
  for (const char* outside : {"src=\"", "href=\"", "<link", "@import", "url("}) {
    EXPECT_FALSE(says(page, outside));
  }
}

// Every tier has baked the panorama, and its errors are those that docs/environments.md section 7 allows.
void expect_bakes(const nlohmann::json& bakes, const std::set<std::string>& tiers) {
  std::map<std::string, double> bounds = {{"draft", 0.08}, {"standard", 0.02}, {"reference", 0.003}};
  std::set<std::string> seen;
  EXPECT_EQ(bakes.size(), 3u) << bakes;
  for (const nlohmann::json& row : bakes) {
    ASSERT_TRUE(row.contains("max_error")) << row;
    EXPECT_EQ(row.at("panorama"), "pano.exr");
    EXPECT_EQ(row.at("levels").size(), 2u) << row;
    for (const nlohmann::json& level : row.at("levels"))
      EXPECT_LE(level.at("error"), row.at("max_error")) << row;
    EXPECT_GT(row.at("max_error"), 0) << row;
    EXPECT_LE(row.at("max_error"), bounds.at(row.at("tier"))) << row;
    EXPECT_GT(row.at("device_ms").at("median"), 0) << row;
    EXPECT_GE(row.at("call_ms").at("median"), row.at("device_ms").at("median")) << row;
    EXPECT_EQ(row.at("stages")[0].at("name"), "bake") << row;
    seen.insert(row.at("tier"));
  }
  EXPECT_EQ(seen, tiers);
}

void expect_panorama(const nlohmann::json& environments, const std::string& folder) {
  ASSERT_EQ(environments.size(), 1u);
  EXPECT_EQ(environments[0].at("name"), "pano.exr");
  EXPECT_EQ(environments[0].at("width"), 128);
  EXPECT_EQ(environments[0].at("height"), 64);
  EXPECT_GT(environments[0].at("put_ms"), 0);
  for (const char* picture : {"levels", "lookdev"}) expect_png(folder, environments[0].at(picture));
}

TEST(MeasurementReport, WritesAWholePageAndItsData) {
  const TemporaryFolder folder;
  const std::string at = folder.path("report"), odd_name = folder.path("a<b>.exr");
  write_small_exr(odd_name);
  const std::string panorama = folder.path("pano.exr");
  ASSERT_EQ(candela({"sample", "--panorama", panorama, "--size", "128x64", "-q"}).code, 0);
  const Outcome outcome = candela({"report", at, "--quick", "--megapixels", "0.02", "--images", odd_name,
                                   "--panoramas", panorama, "--executor", "auto"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.out, at + "/index.html"));

  const nlohmann::json report = nlohmann::json::parse(read_file(at + "/report.json"));
  std::vector<std::string> blanks;
  find_blanks(report, "", blanks);
  EXPECT_EQ(blanks, std::vector<std::string>{});

  std::set<std::string> tiers;
  for (const nlohmann::json& tier : report.at("tiers")) tiers.insert(tier.at("name"));
  EXPECT_GE(tiers.size(), 1u);
  std::map<std::string, std::set<std::string>> cases;
  for (const nlohmann::json& row : report.at("hard_cases")) {
    cases[row.at("case")].insert(row.at("tier"));
    EXPECT_FALSE(row.contains("error")) << row;
    EXPECT_TRUE(row.at("finite").get<bool>()) << row;
    EXPECT_TRUE(row.at("max_error_codes").is_number()) << row;
    EXPECT_NE(row.at("expected"), "") << row;
  }
  EXPECT_GE(cases.size(), 20u);
  for (const auto& [name, seen] : cases) EXPECT_EQ(seen, tiers) << name;
  ASSERT_EQ(report.at("stage_errors").size(), 6u);
  for (const nlohmann::json& row : report.at("stage_errors")) EXPECT_TRUE(row.at("ok").get<bool>()) << row;
  for (const nlohmann::json& row : report.at("times")) {
    EXPECT_GT(row.at("device_ms").at("median"), 0) << row;
    EXPECT_LE(row.at("device_ms").at("p10"), row.at("device_ms").at("p90")) << row;
    EXPECT_TRUE(row.at("error").at("max_codes").is_number()) << row;
    for (const nlohmann::json& stage : row.at("stages")) {
      EXPECT_LE(stage.at("ms").at("p10"), stage.at("ms").at("p90")) << row;
    }
  }
  std::map<std::string, nlohmann::json> scenes;
  for (const nlohmann::json& row : report.at("scenes")) {
    ASSERT_FALSE(row.contains("error")) << row;
    EXPECT_GT(row.at("memcpy_ratio"), 0) << row;
    scenes[row.at("what")] = row.at("plan");
  }
  EXPECT_EQ(scenes.size(), 8u);
  // The scenes' light matches their descriptions: in some of the tiles, and in none.
  EXPECT_TRUE(says(scenes.at("five small lights").dump(), "light in"));
  EXPECT_TRUE(says(scenes.at("nothing bright").dump(), "no bloom: nothing passes"));
  std::map<std::string, nlohmann::json> files;
  for (const nlohmann::json& row : report.at("files")) {
    ASSERT_FALSE(row.contains("error")) << row;
    EXPECT_GT(row.at("bytes"), 0) << row;
    EXPECT_GT(row.at("write_ms").at("median"), 0) << row;
    files[row.at("kind")] = row;
  }
  EXPECT_EQ(files.size(), 8u);
  EXPECT_NEAR(files.at("PNG, 8 bits").at("max_codes"), 0.5, 0.01);
  EXPECT_LE(files.at("PNG, 16 bits").at("max_codes"), 1e-4);
  EXPECT_LE(files.at("PNG, 16 bits, PQ").at("max_codes"), 1e-4);
  EXPECT_GT(files.at("JPEG, quality 75").at("mean_codes"), files.at("JPEG, quality 92").at("mean_codes"));
  EXPECT_GT(files.at("JPEG, quality 92, with a gain map").at("bytes"),
            files.at("JPEG, quality 92").at("bytes"));
  for (const nlohmann::json& row : report.at("curves")) EXPECT_GT(row.at("device_ms").at("median"), 0) << row;
  EXPECT_TRUE(report.at("aces").contains("rows") || report.at("aces").contains("missing"));

  EXPECT_EQ(report.at("format"), "candela report");
  EXPECT_EQ(report.at("command"), "candela report DIR --quick --megapixels 0.02 --images '" + odd_name +
                                      "' --panoramas " + panorama + " --executor auto");
  EXPECT_EQ(report.at("version"), 1);
  for (const nlohmann::json& image : report.at("images")) {
    expect_png(at, image.at("file"));
    for (const nlohmann::json& map : image.at("maps")) expect_png(at, map.at("file"));
  }
  expect_bakes(report.at("bakes"), tiers);
  expect_panorama(report.at("environments"), at);
  expect_page_holds(read_file(at + "/index.html"), report);
  for (const char* table : {"/times.csv", "/hard_cases.csv", "/aces.csv", "/bakes.csv", "/files.csv"}) {
    EXPECT_NE(read_file(at + table).find(','), std::string::npos) << table;
  }
}

// The largest size of --megapixels is 21333x12000.
TEST(MeasurementReport, AFrameBeyondTheServersLimitsIsNotMade) {
  const TemporaryFolder folder;
  const std::string at = folder.path("report"), image = folder.path("in.exr"),
                    panorama = folder.path("pano.exr");
  write_small_exr(image);
  ASSERT_EQ(candela({"sample", "--panorama", panorama, "--size", "32x16", "-q"}).code, 0);
  const Outcome outcome = candela(
      {"report", at, "--quick", "--megapixels", "256", "--images", image, "--panoramas", panorama, "-q"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const nlohmann::json report = nlohmann::json::parse(read_file(at + "/report.json"));
  const nlohmann::json& scenes = report.at("scenes");
  ASSERT_EQ(scenes.size(), 1u) << scenes;
  EXPECT_EQ(scenes[0].at("error"), "21333x12000: exceeds this server's limit of 16384 pixels per side");
  for (const nlohmann::json& row : report.at("times")) EXPECT_TRUE(row.contains("skipped")) << row;
}

TEST(MeasurementReport, APanoramaThatCannotBeReadIsNamed) {
  const TemporaryFolder folder;
  const std::string missing = folder.path("missing.exr");
  const Outcome outcome = candela({"report", folder.path("report"), "--quick", "--panoramas", missing});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_TRUE(says(outcome.err, missing));
}

TEST(MeasurementReport, SizesAreNumbersInTheirRange) {
  const Outcome outcome = candela({"report", "nowhere", "--megapixels", "1,x"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(says(outcome.err, "--megapixels"));
}

}  // namespace
}  // namespace candela
