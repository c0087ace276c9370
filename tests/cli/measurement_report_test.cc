// `candela report`: a measured page, and its data.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <map>
#include <set>

#include "tests/cli/command.h"
#include "tests/support/files.h"

namespace candela {
namespace {

using nlohmann::json;

// Every null, and every text that says nothing.
void find_blanks(const json& value, const std::string& where, std::vector<std::string>& blanks) {
  if (value.is_null()) blanks.push_back(where);
  if (!value.is_structured()) return;
  for (const auto& [key, item] : value.items()) find_blanks(item, where + "/" + key, blanks);
}

TEST(MeasurementReport, WritesAWholePageAndItsData) {
  const TemporaryFolder folder;
  const std::string at = folder.path("report");
  const Outcome outcome = candela({"report", at, "--quick", "--megapixels", "0.02"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_NE(outcome.out.find(at + "/index.html"), std::string::npos);

  const json report = json::parse(read_file(at + "/report.json"));
  std::vector<std::string> blanks;
  find_blanks(report, "", blanks);
  EXPECT_EQ(blanks, std::vector<std::string>{});

  std::set<std::string> tiers;
  for (const json& tier : report.at("tiers")) tiers.insert(tier.at("name"));
  EXPECT_GE(tiers.size(), 1u);
  std::map<std::string, std::set<std::string>> cases;
  for (const json& row : report.at("hard_cases")) {
    cases[row.at("case")].insert(row.at("tier"));
    EXPECT_FALSE(row.contains("error")) << row;
    EXPECT_TRUE(row.at("finite").get<bool>()) << row;
    EXPECT_TRUE(row.at("max_error_codes").is_number()) << row;
    EXPECT_NE(row.at("expected"), "") << row;
  }
  EXPECT_GE(cases.size(), 20u);
  for (const auto& [name, seen] : cases) EXPECT_EQ(seen, tiers) << name;
  ASSERT_EQ(report.at("stage_errors").size(), 6u);
  for (const json& row : report.at("stage_errors")) EXPECT_TRUE(row.at("ok").get<bool>()) << row;
  for (const json& row : report.at("times")) {
    EXPECT_GT(row.at("device_ms").at("median"), 0) << row;
    EXPECT_LE(row.at("device_ms").at("p10"), row.at("device_ms").at("p90")) << row;
    EXPECT_TRUE(row.at("error").at("max_codes").is_number()) << row;
    for (const json& stage : row.at("stages")) {
      EXPECT_LE(stage.at("ms").at("p10"), stage.at("ms").at("p90")) << row;
    }
  }
  std::map<std::string, json> scenes;
  for (const json& row : report.at("scenes")) {
    ASSERT_FALSE(row.contains("error")) << row;
    EXPECT_GT(row.at("memcpy_ratio"), 0) << row;
    scenes[row.at("what")] = row.at("plan");
  }
  EXPECT_EQ(scenes.size(), 7u);
  // The lights are what their words say: some of the tiles, and none.
  EXPECT_NE(scenes.at("five small lights").dump().find("light in"), std::string::npos);
  EXPECT_NE(scenes.at("nothing bright").dump().find("no bloom: nothing passes"), std::string::npos);
  EXPECT_TRUE(report.at("aces").contains("rows") || report.at("aces").contains("missing"));

  const std::string page = read_file(at + "/index.html");
  for (const char* words :
       {"<svg", "data:image/png;base64,", "Pareto front", "candela report DIR --quick", "</html>"}) {
    EXPECT_NE(page.find(words), std::string::npos) << words;
  }
  for (const char* outside : {"src=\"http", "href=\"http", "href='http", "<script", "<link", "@import"}) {
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
  }
  for (const char* table : {"/times.csv", "/hard_cases.csv", "/aces.csv"}) {
    EXPECT_NE(read_file(at + table).find(','), std::string::npos) << table;
  }
}

TEST(MeasurementReport, WithoutGnuplotItSaysWhatToInstallAndWritesNothing) {
  const TemporaryFolder folder;
  const std::string path = std::getenv("PATH");
  setenv("PATH", folder.path("empty").c_str(), 1);
  const Outcome outcome = candela({"report", folder.path("report")});
  setenv("PATH", path.c_str(), 1);
  EXPECT_EQ(outcome.code, 1);
  EXPECT_NE(outcome.err.find("gnuplot-nox"), std::string::npos) << outcome.err;
  EXPECT_EQ(folder.list(), std::vector<std::string>{});
}

TEST(MeasurementReport, AGnuplotThatFailsGivesItsReason) {
  const TemporaryFolder folder;
  const std::string gnuplot = folder.path("gnuplot");
  write_file(gnuplot, "#!/bin/sh\necho 'no terminal\n  svg' >&2\nexit 3\n");
  std::filesystem::permissions(gnuplot, std::filesystem::perms::owner_all);
  const std::string path = std::getenv("PATH");
  setenv("PATH", folder.path("").c_str(), 1);
  const Outcome outcome = candela({"report", folder.path("report")});
  setenv("PATH", path.c_str(), 1);
  EXPECT_EQ(outcome.code, 1);
  EXPECT_NE(outcome.err.find("it ended with code 3: no terminal svg"), std::string::npos) << outcome.err;
  EXPECT_EQ(folder.list(), std::vector<std::string>{"gnuplot"});
}

TEST(MeasurementReport, SizesAreNumbersInTheirRange) {
  const Outcome outcome = candela({"report", "nowhere", "--megapixels", "1,x"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_NE(outcome.err.find("--megapixels"), std::string::npos) << outcome.err;
}

}  // namespace
}  // namespace candela
