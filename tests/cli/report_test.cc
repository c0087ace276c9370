// The reports of the commands: JSON, text, notes and server information.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <string>

#include "absl/strings/str_split.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Report : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(Report, JsonIsOneLineWithEveryKey) {
  const Outcome outcome = candela({"render", in_, out_, "--json", "-"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(outcome.out.find('\n'), outcome.out.size() - 1);
  const nlohmann::json frame = nlohmann::json::parse(outcome.out);
  EXPECT_EQ(frame.at("input"), in_);
  EXPECT_EQ(frame.at("output"), out_);
  EXPECT_EQ(frame.at("size").at("width"), 31);
  EXPECT_EQ(frame.at("primaries").at("name"), "Rec.709");
  EXPECT_EQ(frame.at("primaries").at("from"), "file");
  EXPECT_EQ(frame.at("curve"), "aces-hill");
  EXPECT_EQ(frame.at("size").at("height"), 17);
  EXPECT_TRUE(frame.at("device").is_string());
  EXPECT_EQ(frame.at("tier"), "standard");
  EXPECT_EQ(frame.at("bad_values"), nlohmann::json({{"nan", 0}, {"inf", 0}, {"negative", 0}}));
  EXPECT_GE(frame.at("plan").size(), 2u);
  EXPECT_TRUE(frame.at("notes").empty());
  const double exposure = frame.at("exposure"), target = frame.at("target");
  const double mean = frame.at("mean_log2_luminance");
  EXPECT_EQ(exposure, target);
  EXPECT_NEAR(target, 0.18 / std::exp2(mean), 1e-12 * target);
  EXPECT_LT(frame.at("min_luminance").get<double>(), std::exp2(mean));
  EXPECT_GT(frame.at("max_luminance").get<double>(), 20);
  for (const char* stage : {"start", "read", "queue", "ingest", "resolve", "other", "write"}) {
    EXPECT_GE(frame.at("stage_ms").at(stage).get<double>(), 0) << stage;
  }
  EXPECT_GT(frame.at("total_ms").get<double>(), frame.at("stage_ms").at("write").get<double>());
}

TEST_F(Report, AVerifiedFrameSaysHowFarItIsOff) {
  EXPECT_FALSE(candela_json({"render", in_, out_}).contains("verify"));
  for (const char* name : {"a.png", "b.jpg", "c.exr", "d.pfm"}) {
    const nlohmann::json frame = candela_json({"render", in_, folder_.path(name), "--verify"});
    for (const char* kind : {"verify", "verify_unrounded"}) {
      const nlohmann::json& verify = frame.at(kind);
      EXPECT_LE(verify.at("max_error_codes").get<double>(), 0.5) << name;
      EXPECT_LE(verify.at("p999_error_codes").get<double>(), 0.05) << name;
      EXPECT_LE(verify.at("mean_error_codes"), verify.at("p999_error_codes")) << name;
      EXPECT_GT(verify.at("mean_error_codes"), 0) << name;
      EXPECT_LT(verify.at("worst_pixel").at(0), 31) << name;
      EXPECT_LT(verify.at("worst_pixel").at(1), 17) << name;
      EXPECT_LE(verify.at("differing_components").get<double>(), 2e-3) << name;
      EXPECT_LE(verify.at("meter_error_ev").get<double>(), 2e-5) << name;
      EXPECT_LE(verify.at("bloom_error").get<double>(), 0x1p-9) << name;
    }
    EXPECT_GT(frame.at("stage_ms").at("verify"), 0) << name;
  }
  const Outcome text = candela({"render", in_, out_, "--verify"});
  EXPECT_TRUE(says(text.out, "error against the float64 reference: at most"));
}

TEST_F(Report, TheErrorMapIsAPngThatStatesItsScale) {
  const std::string map = folder_.path("map.png");
  const ListeningDaemon daemon;
  for (const std::vector<std::string>& options :
       std::vector<std::vector<std::string>>{{}, {"--server", daemon.address()}}) {
    std::vector<std::string> arguments = with({"render", in_, out_, "--error-map", map}, options);
    const nlohmann::json frame = candela_json(arguments);
    EXPECT_TRUE(frame.contains("verify"));
    EXPECT_EQ(frame.at("error_map").at("file"), map);
    EXPECT_EQ(frame.at("error_map").at("least_codes"), 1e-5);
    EXPECT_EQ(frame.at("error_map").at("most_codes"), 10);
    const std::string scale = frame.at("error_map").at("scale");
    EXPECT_TRUE(says(read_file(map), "tEXtDescription" + std::string(1, '\0') + scale));
    // The legend is below the map. A map that is narrower than the legend is padded.
    EXPECT_GE(png_facts(map).width, 31u);
    EXPECT_GT(png_facts(map).height, 17u);
    const Outcome text = candela({"render", in_, out_, "--error-map", map, "-v"});
    EXPECT_TRUE(says(text.out, scale));
  }
}

TEST_F(Report, ManualExposureIsTwoToTheEv) {
  EXPECT_EQ(candela_json({"render", in_, out_, "--exposure", "-3"}).at("exposure"), 0.125);
  EXPECT_EQ(candela_json({"render", in_, out_, "--exposure=40"}).at("exposure"), 0x1p40);
}

TEST_F(Report, JsonGoesToAFileOrADeviceAndTheTextToStdout) {
  const std::string path = folder_.path("frame.json");
  write_file(path, "{}");
  const Outcome outcome = candela({"render", in_, out_, "--json", path});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.out, "exposure"));
  EXPECT_EQ(nlohmann::json::parse(read_file(path)).at("output"), out_);
  EXPECT_EQ(candela({"render", in_, out_, "--json", "/dev/null"}).code, 0);
  EXPECT_EQ(folder_.list(), (std::vector<std::string>{"frame.json", "in.exr", "out.png"}));
}

TEST_F(Report, JsonToTheFileOfStdoutIsAppendedToItLikeADash) {
  const std::string log = folder_.path("log");
  for (const std::string& path : {std::string("/dev/stdout"), log}) {
    write_file(log, "kept\n");
    const Outcome outcome = candela_in_shell("exec >>'" + log + "'", {"meter", in_, "--json", path});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    const std::string text = read_file(log);
    ASSERT_EQ(text.find("kept\n{"), 0u) << text;
    EXPECT_TRUE(nlohmann::json::parse(text.substr(5), nullptr, false).is_object())
        << "text beside JSON: " << text;
  }
  EXPECT_EQ(folder_.list(), (std::vector<std::string>{"in.exr", "log"}));
}

TEST_F(Report, JsonToTheFileOfStderrIsRefused) {
  const std::string log = folder_.path("log");
  write_file(log, "kept\n");
  const Outcome outcome = candela_in_shell("exec 2>>'" + log + "'", {"meter", in_, "--json", "/dev/stderr"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_EQ(read_file(log),
            "kept\ncandela: error: --json /dev/stderr: stderr is written to this file; write the JSON to "
            "another file\n");
  // A device or a pipe takes both.
  EXPECT_EQ(candela_in_shell("exec 2>/dev/null", {"meter", in_, "--json", "/dev/null"}).code, 0);
  EXPECT_EQ(candela_in_shell("exec >&-", {"meter", in_, "--json", "/dev/null"}).code, 0);
  const Outcome pipe = candela({"meter", in_, "-q", "--json", "/dev/stderr"});
  EXPECT_EQ(pipe.code, 0);
  EXPECT_TRUE(nlohmann::json::parse(pipe.err, nullptr, false).is_object()) << pipe.err;
}

TEST_F(Report, TheTextIsOneLineAndVerboseSaysTheRest) {
  const Outcome line = candela({"render", in_, out_});
  ASSERT_EQ(line.code, 0) << line.err;
  EXPECT_EQ(line.out.find(in_ + " -> " + out_ + ": 31x17; Rec.709, from the file; exposure "), 0u)
      << line.out;
  EXPECT_TRUE(says(line.out, " EV); aces-hill; "));
  EXPECT_EQ(std::count(line.out.begin(), line.out.end(), '\n'), 1) << line.out;
  const Outcome all = candela({"render", in_, out_, "--verbose"});
  for (const char* words :
       {"\n  device ", "\n  primaries  Rec.709, from the file\n", "\n  plan ", "\n  time "}) {
    EXPECT_TRUE(says(all.out, words));
  }
}

TEST_F(Report, EveryResultSaysWhichPrimariesWereUsedAndWhoSaidSo) {
  const std::string pfm = folder_.path("in.pfm"), exr = folder_.path("ap1.exr");
  ASSERT_EQ(candela({"sample", pfm, "--size", "32x16", "-q"}).code, 0);
  ASSERT_OK_AND_ASSIGN(Image image, read_image(in_));
  image.chromaticities = {0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f};
  ASSERT_OK(write_image(exr, image));
  struct Case {
    std::vector<std::string> input;
    std::string words, from;
  };
  for (const auto& [input, words, from] :
       std::vector<Case>{{{pfm}, "Rec.709, assumed", "assumed"},
                         {{exr}, "AP1, from the file", "file"},
                         {{exr, "--primaries", "rec2020"}, "Rec.2020, from --primaries", "option"},
                         {{pfm, "--primaries", "0.7,0.3,0.2,0.7,0.1,0.1,0.3127,0.329"},
                          "primaries red 0.7 0.3, green 0.2 0.7, blue "
                          "0.1 0.1, white 0.3127 0.329, from --primaries",
                          "option"}}) {
    std::vector<std::string> render{"render"}, meter{"meter"}, stream{"stream"};
    render.insert(render.end(), input.begin(), input.end());
    render.insert(render.begin() + 2, out_);
    stream.insert(stream.end(), input.begin(), input.end());
    stream.insert(stream.begin() + 2, folder_.path("frames"));
    meter.insert(meter.end(), input.begin(), input.end());
    for (const std::vector<std::string>& command : {render, meter, stream}) {
      const Outcome text = candela(command);
      EXPECT_TRUE(says(text.out, words)) << text.err;
      std::vector<std::string> with_json = command;
      with_json.insert(with_json.end(), {"--json", "-"});
      const std::string lines = candela(with_json).out;
      const nlohmann::json first = nlohmann::json::parse(lines.substr(0, lines.find('\n')), nullptr, false);
      ASSERT_TRUE(first.is_object()) << lines;
      EXPECT_EQ(first.at("primaries").at("from"), from);
      EXPECT_EQ(first.at("primaries").at("xy").size(), 8u);
      EXPECT_EQ(first.at("primaries").at("name").is_null(), words.starts_with("primaries"));
    }
  }
}

TEST_F(Report, InfoDescribesFiles) {
  const Outcome text = candela({"info", in_});
  ASSERT_EQ(text.code, 0) << text.err;
  for (const char* words :
       {": OpenEXR\n", "  renders    R G B\n", "  size       31x17 at 0,0\n", "compression ZIP",
        "  primaries  Rec.709; colorInteropID lin_rec709_scene\n", "  channels   B G R half\n"}) {
    EXPECT_TRUE(says(text.out, words));
  }
  const nlohmann::json file = candela_json({"info", in_});
  EXPECT_EQ(file.at("file"), in_);
  EXPECT_EQ(file.at("shown"), "R G B");
  EXPECT_EQ(file.at("error"), nullptr);
  EXPECT_EQ(file.at("parts").at(0).at("channels").at(0),
            nlohmann::json({{"name", "B"}, {"type", "half"}, {"x_sampling", 1}, {"y_sampling", 1}}));
  const Outcome several = candela({"info", folder_.path("missing.exr"), in_, in_});
  EXPECT_EQ(several.code, 3);
  EXPECT_EQ(several.out, text.out) << "each file once";
  EXPECT_TRUE(says(several.err, "missing.exr: cannot read"));
  EXPECT_TRUE(says(several.err, "1 of 2 files cannot be described"));
}

TEST_F(Report, QuietSaysNothing) {
  const Outcome outcome = candela({"render", in_, out_, "--quiet", "--transfer", "srgb"});
  EXPECT_EQ(outcome.code, 0);
  EXPECT_EQ(outcome.out + outcome.err, "");
}

TEST_F(Report, NotesGoToStderrAndIntoTheJson) {
  write_small_exr(in_, true);
  const Outcome outcome = candela({"render", in_, folder_.path("out.jpg"), "--json", "-"});
  ASSERT_EQ(outcome.code, 0);
  EXPECT_EQ(outcome.err.find("note: alpha dropped"), 0u) << outcome.err;
  EXPECT_GE(nlohmann::json::parse(outcome.out).at("notes").size(), 1u);
  const Outcome transfer = candela({"render", in_, folder_.path("out.exr"), "--transfer", "gamma22"});
  EXPECT_TRUE(says(transfer.err, "note: --transfer changes nothing"));
}

TEST_F(Report, APathThatIsNotUtf8StillMakesJson) {
  const std::string odd = folder_.path("\xff.png");
  EXPECT_TRUE(candela_json({"render", in_, odd}).is_object());
}

TEST_F(Report, InfoSaysWhatTheServerIs) {
  const Outcome text = candela({"info"});
  ASSERT_EQ(text.code, 0) << text.err;
  const nlohmann::json info = candela_json({"info"});
  for (const char* key : {"address", "version", "device", "formats", "output_formats", "curves", "transfers",
                          "tiers", "limits", "pool", "uptime_seconds", "frames_rendered", "settings"}) {
    EXPECT_TRUE(info.contains(key)) << key;
  }
  EXPECT_TRUE(says(text.out, info.at("device").at("name").get<std::string>()));
  EXPECT_EQ(candela_json({"render", in_, out_}).at("device"), info.at("device").at("name"));
}

// Every tier has its error bounds, and the text rounds no bound down.
TEST_F(Report, InfoHasEachTiersErrors) {
  const nlohmann::json info = candela_json({"info"});
  const std::vector<std::string> lines = absl::StrSplit(candela({"info"}).out, '\n');
  std::vector<std::string> names;
  for (const nlohmann::json& tier : info.at("tiers")) {
    names.push_back(tier.at("name"));
    SCOPED_TRACE(names.back());
    auto line = std::ranges::find_if(lines, [&](const std::string& text) {
      return text.starts_with("  tier       " + names.back() + ": ");
    });
    ASSERT_TRUE(line != lines.end() && ++line != lines.end());
    const double plain = tier.at("max_error_codes"), blooms = tier.at("max_error_codes_with_bloom");
    EXPECT_LE(plain, blooms);
    double said = -1, said_with_bloom = 255;
    const int numbers =
        std::sscanf(line->c_str(), " within %lf codes, with bloom within %lf codes", &said, &said_with_bloom);
    EXPECT_EQ(numbers, blooms < 255 ? 2 : 1) << *line;
    EXPECT_EQ(line->find("with bloom without a bound") != std::string::npos, blooms >= 255) << *line;
    EXPECT_GE(said, plain);
    EXPECT_LE(said, 1.0101 * plain);
    EXPECT_GE(said_with_bloom, blooms);
    EXPECT_LE(said_with_bloom, 1.0101 * blooms);
  }
  EXPECT_EQ(names, (std::vector<std::string>{"draft", "standard", "reference"}));
  EXPECT_TRUE(std::ranges::any_of(lines, [](const std::string& text) {
    return text.find("an exposure of at most 1 and no negative components") != std::string::npos;
  }));
}

TEST_F(Report, InfoListsTheSettings) {
  std::map<std::string, nlohmann::json> settings;
  const nlohmann::json info = candela_json({"info"});
  for (const nlohmann::json& setting : info.at("settings")) settings[setting.at("path")] = setting;
  const nlohmann::json intensity = {{"path", "bloom.intensity"},
                                    {"kind", "number"},
                                    {"flag", "bloom-intensity"},
                                    {"group", "Bloom"},
                                    {"help", "Strength of the bloom; 0 turns it off"},
                                    {"unit", "factor"},
                                    {"default", 0.05},
                                    {"min", 0},
                                    {"max", 10},
                                    {"except", {{{"choice", "kind"}, {"word", "conserve"}, {"max", 1}}}}};
  EXPECT_EQ(settings["bloom.intensity"], intensity);
  EXPECT_EQ(settings["curve"].at("default"), "aces-hill");
  EXPECT_EQ(settings["transfer"].at("choices")[2].at("word"), "linear");
  EXPECT_EQ(settings["bloom.levels"].at("kind"), "whole-number");
  EXPECT_EQ(settings["bloom.firefly_weights"].at("default"), true);
  EXPECT_EQ(settings["dither"].at("default"), false);
  EXPECT_EQ(settings["max_error_codes"].at("default"), nullptr);
  EXPECT_TRUE(says(candela({"info", "--help"}).out, "candela info --json"));
}

TEST_F(Report, HelpAndVersion) {
  EXPECT_EQ(candela({"--version"}).out.find("candela "), 0u);
  EXPECT_EQ(candela({}).out, candela({"--help"}).out);
  EXPECT_TRUE(says(candela({}).out, "candela sample scene.exr"));
  const std::string help = candela({"render", "--help"}).out;
  for (const char* words :
       {"Exposure:", "Bloom:", "Tone:", "Verification:", "Output:", "Server:", "-40 .. 40",
        "0 .. 2^30 (default 1; gaussian: default 8)", "linear, reinhard, aces-narkowicz, aces-hill",
        "1 .. 16 (default 5)", "2^-40 .. 2^40 (default 64)"}) {
    EXPECT_TRUE(says(help, words));
  }
}

// `candela report`: the data, the page and the tables.

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
