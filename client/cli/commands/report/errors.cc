#include "client/cli/commands/report/errors.h"

#include <half.h>
#include <lcms2.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/number_words.h"
#include "client/cli/commands/report/scenes.h"
#include "client/cli/commands/report/session.h"
#include "client/run/picture_error.h"
#include "client/run/picture_frame.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/encode/image_file.h"

namespace candela {
namespace {

Json errors_of(const v1::Verification& v) {
  return {{"max_error_codes", json_number(v.max_error_codes())},
          {"p999_error_codes", json_number(v.p999_error_codes())},
          {"mean_error_codes", json_number(v.mean_error_codes())},
          {"differing_components", json_number(v.differing_components())},
          {"meter_error_ev", json_number(v.meter_error_ev())},
          {"bloom_error", json_number(v.bloom_error())}};
}

bool all_finite(const RenderResult& result) {
  for (size_t i = 0; i < pixel_count(result); ++i) {
    for (size_t k = 0; k < 4; ++k) {
      if (!std::isfinite(component(result, i, k))) return false;
    }
  }
  return true;
}

// The sum of R, G and B over all pixels.
double summed_light(const RenderResult& result) {
  double sum = 0;
  for (size_t i = 0; i < pixel_count(result); ++i) {
    for (size_t k = 0; k < 3; ++k) sum += component(result, i, k);
  }
  return sum;
}

// Smallest, largest and mean code of R, G and B, in 8 bits.
Json picture_codes(const RenderResult& result) {
  int least = 255, most = 0;
  double sum = 0;
  for (size_t i = 0; i < pixel_count(result); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const auto code = static_cast<int>(std::lround(255 * component(result, i, k)));
      least = std::min(least, code);
      most = std::max(most, code);
      sum += code;
    }
  }
  return {{"min", least}, {"max", most}, {"mean", sum / (3.0 * static_cast<double>(pixel_count(result)))}};
}

Json row_of(const std::string& name, const std::string& expected, const Image& frame,
            const std::string& tier) {
  return {{"case", name},
          {"expected", expected},
          {"width", frame.width},
          {"height", frame.height},
          {"tier", tier}};
}

Json failed(Json row, const absl::Status& status) {
  row["error"] = std::string(status.message());
  return row;
}

// Renders a frame twice: verified as codes, and as floats to check that every value is finite. An HDR display
// has no floats.
Json verified_row(const ReportSession& session, Json row, v1::Settings settings, const Image& frame,
                  const std::optional<v1::ExposureState>& previous) {
  const absl::StatusOr<RenderResult> codes =
      session.render(settings, frame, {.verify = true, .error_map = false, .previous = previous});
  if (!codes.ok()) return failed(std::move(row), codes.status());
  if (codes->header.format() == v1::OUTPUT_FORMAT_RGBA8)
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  const absl::StatusOr<RenderResult> floats =
      session.render(settings, frame, {.verify = false, .error_map = false, .previous = previous});
  if (!floats.ok()) return failed(std::move(row), floats.status());
  const v1::ResultHeader& header = codes->header;
  row["finite"] = all_finite(*floats);
  row.update(errors_of(header.verify()));
  row["exposure"] = json_number(header.exposure());
  row["nan"] = header.statistics().nan_components();
  row["inf"] = header.statistics().infinite_components();
  row["negative"] = header.statistics().negative_components();
  row["picture"] = picture_codes(*codes);
  row["note"] = previous
                    ? absl::StrFormat("exposure from %s to %s, target %s", in_digits(previous->exposure(), 4),
                                      in_digits(header.exposure(), 4), in_digits(header.target(), 4))
                    : "";
  return row;
}

// The row with the time of the passes; a first frame warms up.
Json timed_row(const ReportSession& session, Json row, const v1::Settings& settings, const Image& frame) {
  constexpr int kFrames = 5;
  std::vector<double> ms;
  for (int i = 0; i <= kFrames && !row.contains("error"); ++i) {
    const absl::StatusOr<RenderResult> result = session.render(settings, frame);
    if (!result.ok()) return failed(std::move(row), result.status());
    if (i > 0) ms.push_back(device_ms(result->header.stages()));
  }
  if (!ms.empty()) row["device_ms"] = spread(ms);
  return row;
}

// The exposure is so low that the light stays below 1, where clipping would hide how it varies.
v1::Settings highlight_settings(const std::string& tier, bool weights) {
  v1::Settings settings = ReportSession::settings(tier);
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_exposure()->set_manual_ev(-11);
  settings.mutable_bloom()->set_firefly_weights(weights);
  return settings;
}

absl::StatusOr<double> light_of(const ReportSession& session, v1::Settings settings,
                                std::optional<int> eighths) {
  ASSIGN_OR_RETURN(const Image frame, moving_highlight(eighths));
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  ASSIGN_OR_RETURN(const RenderResult result, session.render(settings, frame));
  return summed_light(result);
}

// (max - min) / mean of the light above the ground, over a pixel's eighths.
absl::StatusOr<double> flicker(const ReportSession& session, const v1::Settings& settings) {
  const absl::StatusOr<double> ground = light_of(session, settings, std::nullopt);
  if (!ground.ok()) return ground;
  double least = INFINITY, most = -INFINITY, sum = 0;
  for (int eighths = 0; eighths < 8; ++eighths) {
    const absl::StatusOr<double> light = light_of(session, settings, eighths);
    if (!light.ok()) return light;
    least = std::min(least, *light - *ground);
    most = std::max(most, *light - *ground);
    sum += *light - *ground;
  }
  return (most - least) / (sum / 8);
}

absl::StatusOr<Json> highlight_row(const ReportSession& session, const std::string& tier, bool weights) {
  ASSIGN_OR_RETURN(const Image frame, moving_highlight(3));
  const v1::Settings settings = highlight_settings(tier, weights);
  const std::string expected =
      weights ? "its light varies, which is the price of the weights" : "its light varies by 0.3 % at most";
  const std::string name =
      weights ? "highlight moving by 1/8 pixel" : "highlight moving by 1/8 pixel, without firefly weights";
  Json row = verified_row(session, row_of(name, expected, frame, tier), settings, frame, std::nullopt);
  if (row.contains("error")) return row;
  const absl::StatusOr<double> varies = flicker(session, settings);
  if (!varies.ok()) return failed(std::move(row), varies.status());
  row["flicker"] = json_number(*varies);
  row["note"] = absl::StrFormat("its light varies by %s %% of the mean", in_digits(100 * *varies, 3));
  return row;
}

// A file name made of `stem` and a word of the server, which may hold any character.
std::string picture_name(const std::string& stem, std::string word) {
  std::replace_if(
      word.begin(), word.end(), [](char c) { return !absl::ascii_isalnum(c) && c != '-'; }, '_');
  return absl::StrCat(stem, "_", word, ".png");
}

absl::Status write_picture(const absl::StatusOr<Image>& picture, const std::string& path) {
  return picture.ok() ? write_image(path, *picture).status() : picture.status();
}

// The folder of an image's pictures and the beginning of their names.
struct PictureFiles {
  const std::string& folder;
  const size_t image;  // counted from 1
  const std::string stem = absl::StrCat("image_", image);
};

// The errors of one image at one tier. Writes the error map and, at the bounded tier, the picture.
absl::StatusOr<Json> map_row(const ReportSession& session, const RenderResult& result,
                             const std::string& tier, const PictureFiles& files) {
  const uint32_t width = result.header.width(), height = result.header.height();
  Json row = {{"tier", tier}};
  row.update(errors_of(result.header.verify()));
  row["file"] = error_map_name(files.image, tier);
  absl::Status written = write_picture(small_error_map(result.error_map, width, height),
                                       absl::StrCat(files.folder, "/", row["file"].get<std::string>()));
  if (tier == session.bounded_tier()) {
    written.Update(write_picture(small_picture(result.pixels(), width, height),
                                 absl::StrCat(files.folder, "/", files.stem, ".png")));
  }
  if (!written.ok()) return written;
  return row;
}

absl::StatusOr<Json> image_row(const ReportSession& session, const ReportImage& image,
                               const PictureFiles& files) {
  Json row = {{"name", image.name},
              {"width", image.image.width},
              {"height", image.image.height},
              {"note", image.note}};
  Json maps = Json::array();
  for (const std::string& tier : session.tiers()) {
    session.show(absl::StrFormat("error map: %s, %s", image.name, tier));
    const absl::StatusOr<RenderResult> result =
        session.render(ReportSession::settings(tier), image.image, {.verify = true, .error_map = true});
    if (!result.ok()) {
      maps.push_back(failed({{"tier", tier}}, result.status()));
      continue;
    }
    ASSIGN_OR_RETURN(Json map, map_row(session, *result, tier, files));
    maps.push_back(std::move(map));
    if (tier == session.bounded_tier()) row["file"] = files.stem + ".png";
  }
  row["maps"] = std::move(maps);
  return row;
}

}  // namespace

std::string error_map_name(size_t image, const std::string& tier) {
  return picture_name(absl::StrCat("image_", image, "_errors"), tier);
}

absl::StatusOr<Json> measure_hard_cases(const ReportSession& session) {
  ASSIGN_OR_RETURN(const std::vector<HardCase> cases, hard_cases());
  Json rows = Json::array();
  for (const HardCase& hard : cases) {
    session.show("hard case: " + hard.name);
    for (const std::string& tier : session.tiers()) {
      rows.push_back(verified_row(session, row_of(hard.name, hard.expected, hard.frame, tier),
                                  ReportSession::settings(tier), hard.frame, hard.previous));
    }
  }
  for (const bool weights : {true, false}) {
    session.show("hard case: moving highlight");
    for (const std::string& tier : session.tiers()) {
      ASSIGN_OR_RETURN(Json row, highlight_row(session, tier, weights));
      rows.push_back(std::move(row));
    }
  }
  return rows;
}

absl::StatusOr<Json> measure_images(const ReportSession& session, const std::vector<ReportImage>& images,
                                    const std::string& folder) {
  Json rows = Json::array();
  for (const ReportImage& image : images) {
    ASSIGN_OR_RETURN(Json row, image_row(session, image, {folder, rows.size() + 1}));
    rows.push_back(std::move(row));
  }
  return rows;
}

absl::StatusOr<Json> measure_curves(const ReportSession& session) {
  ASSIGN_OR_RETURN(const Image frame, sample_frame(320, 180));
  ASSIGN_OR_RETURN(const Image timed, sample_frame(1280, 720));
  Json rows = Json::array();
  for (const int value : session.info().curves()) {
    // The error of a table is not the error of a stage: docs/pipeline.md gives that of aces-1 by table size,
    // and a client's table is the client's choice. BT2390 is for HDR displays.
    if (value == v1::TONE_CURVE_ACES_1 || value == v1::TONE_CURVE_TABLE || value == v1::TONE_CURVE_BT2390)
      continue;
    const std::string word = v1::word_of(static_cast<v1::ToneCurve>(value));
    session.show("curve: " + word);
    v1::Settings settings = ReportSession::settings(session.bounded_tier());
    settings.set_curve(static_cast<v1::ToneCurve>(value));
    Json row = row_of("sample scene, " + word, "the curve's own", frame, settings.tier());
    row = verified_row(session, std::move(row), settings, frame, std::nullopt);
    rows.push_back(timed_row(session, std::move(row), settings, timed));
  }
  for (const v1::ToneCurve curve : {v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_BT2390, v1::TONE_CURVE_ACES_2}) {
    for (const v1::Transfer transfer : {v1::TRANSFER_PQ, v1::TRANSFER_HLG}) {
      const std::string words = absl::StrCat(v1::word_of(curve), " in ", v1::word_of(transfer));
      session.show("curve: " + words);
      v1::Settings settings = ReportSession::settings(session.bounded_tier());
      settings.set_curve(curve);
      settings.set_transfer(transfer);
      Json row = row_of("sample scene, " + words, "the curve's own", frame, settings.tier());
      row["display"] = v1::word_of(transfer);
      row = verified_row(session, std::move(row), settings, frame, std::nullopt);
      rows.push_back(timed_row(session, std::move(row), settings, timed));
    }
  }
  return rows;
}

namespace {

constexpr char kReference[] = "aces-1";
constexpr const char* kFits[] = {"aces-narkowicz", "aces-hill"};
constexpr double kFullScale = 65535;

using Codes = std::array<uint16_t, 4>;

Codes pixel(const RenderResult& result, size_t i) {
  Codes codes;
  std::memcpy(codes.data(), result.data.get() + i * sizeof codes, sizeof codes);
  return codes;
}

// IEC 61966-2-1.
double srgb_to_linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

// The linear light of every 16-bit code.
const std::vector<double>& light_of_codes() {
  static const std::vector<double> table = [] {
    std::vector<double> light(65536);
    for (size_t i = 0; i < light.size(); ++i) light[i] = srgb_to_linear(static_cast<double>(i) / kFullScale);
    return light;
  }();
  return table;
}

cmsCIELab lab_of(const Codes& codes) {
  const std::vector<double>& light = light_of_codes();
  const double r = light[codes[0]], g = light[codes[1]], b = light[codes[2]];
  // The sRGB primaries. Their sum is the white point.
  const cmsCIEXYZ xyz = {0.4123908 * r + 0.3575843 * g + 0.1804808 * b,
                         0.2126390 * r + 0.7151687 * g + 0.0721923 * b,
                         0.0193308 * r + 0.1191948 * g + 0.9505322 * b};
  static constexpr cmsCIEXYZ kWhite = {0.9504559, 1.0, 1.0890578};
  cmsCIELab lab;
  cmsXYZ2Lab(&kWhite, &lab, &xyz);
  return lab;
}

double codes_apart(const Codes& a, const Codes& b) {
  int most = 0;
  for (size_t k = 0; k < 3; ++k) most = std::max(most, std::abs(int{a[k]} - int{b[k]}));
  return most * 255 / kFullScale;
}

// The order of `values` changes.
Json summary(std::vector<double>& values) {
  const auto p95 = values.begin() + static_cast<ptrdiff_t>(0.95 * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), p95, values.end());
  return {{"max", *std::max_element(values.begin(), values.end())},
          {"p95", *p95},
          {"mean", std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size())}};
}

void add_distances(const RenderResult& whole, const RenderResult& approximation, Json& row) {
  const size_t pixels = whole.bytes / sizeof(Codes);
  std::vector<double> codes(pixels), delta_e(pixels);
  for (size_t i = 0; i < pixels; ++i) {
    const Codes a = pixel(whole, i), b = pixel(approximation, i);
    codes[i] = codes_apart(a, b);
    const cmsCIELab lab_a = lab_of(a), lab_b = lab_of(b);
    delta_e[i] = codes[i] == 0 ? 0 : cmsCIE2000DeltaE(&lab_a, &lab_b, 1, 1, 1);
  }
  row["pixels"] = pixels;
  row["codes"] = summary(codes);
  row["delta_e"] = summary(delta_e);
}

// Renders one set of colours with every curve and tier.
class ColorSet {
 public:
  ColorSet(const ReportSession& session, std::string name, const Image& frame, bool metered)
      : session_(session), name_(std::move(name)), frame_(frame), metered_(metered) {}

  void add_rows(v1::ToneCurve whole_curve, Json& rows) const {
    const std::string best = session_.most_accurate_tier();
    const absl::StatusOr<RenderResult> whole = render(whole_curve, best);
    const auto add = [&](const std::string& word, v1::ToneCurve curve, const std::string& tier) {
      Json row = {{"curve", word}, {"tier", tier}, {"set", name_}};
      const absl::StatusOr<RenderResult> approximation = whole.ok() ? render(curve, tier) : whole.status();
      if (approximation.ok()) {
        add_distances(*whole, *approximation, row);
      } else {
        row["error"] = std::string(approximation.status().message());
      }
      rows.push_back(std::move(row));
    };
    for (const char* word : kFits) {
      if (const std::optional<v1::ToneCurve> curve = session_.curve(word)) add(word, *curve, best);
    }
    for (const std::string& tier : session_.tiers()) {
      if (tier != best) add(kReference, whole_curve, tier);
    }
  }

 private:
  absl::StatusOr<RenderResult> render(v1::ToneCurve curve, const std::string& tier) const {
    v1::Settings settings = ReportSession::settings(tier);
    settings.set_curve(curve);
    settings.mutable_bloom()->set_intensity(0);
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    if (!metered_) settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
    return session_.render(settings, frame_);
  }

  const ReportSession& session_;
  const std::string name_;
  const Image& frame_;
  const bool metered_;
};

}  // namespace

absl::StatusOr<Json> compare_aces(const ReportSession& session, const std::vector<ReportImage>& images) {
  Json comparison = {{"tier", session.most_accurate_tier()}, {"reference", kReference}};
  const std::optional<v1::ToneCurve> reference = session.curve(kReference);
  if (!reference) {
    comparison["missing"] = absl::StrFormat(
        "this server does not have curve %s, the whole ACES 1 transform, to compare the approximations with",
        kReference);
    return comparison;
  }
  session.show("ACES: charts");
  ASSIGN_OR_RETURN(const std::vector<Chart> charts, color_charts());
  Json rows = Json::array();
  for (const Chart& chart : charts)
    ColorSet(session, chart.name, chart.frame, false).add_rows(*reference, rows);
  for (const ReportImage& image : images) {
    session.show("ACES: " + image.name);
    ColorSet(session, image.name, image.image, true).add_rows(*reference, rows);
  }
  comparison["rows"] = std::move(rows);
  return comparison;
}

namespace {

// The largest error of a stage so far.
struct Worst {
  const char* key;
  const char* stage;
  const char* unit;
  double bound;
  double measured = 0;
  std::string where = "nowhere";

  void look_at(const std::string& name, const Json& row) {
    const double error = row[key].is_number() ? row[key].get<double>() : INFINITY;
    if (error < measured || (error == measured && where != "nowhere")) return;
    measured = error;
    where = name;
  }

  Json json() const {
    return {{"stage", stage}, {"unit", unit},           {"bound", bound}, {"measured", json_number(measured)},
            {"where", where}, {"ok", measured <= bound}};
  }
};

// Smaller frames do not count for the share of differing components: one component is a third of a 1x1 frame.
constexpr double kCountedComponents = 1000;

}  // namespace

absl::StatusOr<Json> measure_ingest(const ReportSession& session) {
  session.show("ingest: every half");
  ASSIGN_OR_RETURN(const Image frame, every_half());
  v1::Settings settings = ReportSession::settings(session.bounded_tier());
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_bloom()->set_intensity(0);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  ASSIGN_OR_RETURN(const RenderResult result, session.render(settings, frame));
  Worst worst = {"codes", "ingest: every half, NaN and Inf among them", "codes", 0};
  for (size_t half = 0; half < pixel_count(result); ++half) {
    const float in = imath_half_to_float(static_cast<uint16_t>(half));
    const float light = std::isnan(in) ? 0 : std::clamp(in, 0.0f, 1.0f);
    for (size_t k = 0; k < 3; ++k) {
      const double codes = 255 * std::abs(double{component(result, half, k)} - double{light});
      if (codes != 0) worst.look_at(absl::StrFormat("half 0x%04x", half), {{"codes", json_number(codes)}});
    }
  }
  if (worst.measured == 0) worst.where = "all 65536 exact";
  return worst.json();
}

Json judge_stages(const ReportSession& session, const Measured& measured) {
  Worst stages[] = {{"meter_error_ev", "metering", "EV", 8e-6},
                    {"bloom_error", "bloom, relative to its largest value", "fraction", 0x1p-9},
                    {"max_error_codes", "whole frame, largest error", "codes", 0.5},
                    {"p999_error_codes", "whole frame, 99.9 % of the pixels", "codes", 0.05},
                    {"differing_components", "components differing once quantised", "fraction", 2e-3}};
  const auto look = [&](const std::string& name, const Json& row, double pixels) {
    if (row["tier"] != session.bounded_tier() || row.contains("error")) return;
    for (Worst& stage : stages) {
      // The share is of components of 8 bits; an HDR display has 16.
      const bool is_share = stage.key == stages[4].key;
      if (!is_share || (3 * pixels >= kCountedComponents && !row.contains("display")))
        stage.look_at(name, row);
    }
  };
  const auto pixels = [](const Json& row) {
    return row["width"].get<double>() * row["height"].get<double>();
  };
  for (const Json* rows : {&measured.hard_cases, &measured.curves}) {
    for (const Json& row : *rows) look(row["case"], row, pixels(row));
  }
  for (const Json& image : measured.images) {
    for (const Json& row : image["maps"]) look(image["name"], row, pixels(image));
  }
  Json judged = Json::array();
  for (const Worst& stage : stages) judged.push_back(stage.json());
  return judged;
}

namespace {

constexpr int kRepeats = 3;
constexpr double kGainMapNits = 1000;

struct FileKind {
  const char* name;
  const char* extension;
  v1::Transfer transfer = v1::TRANSFER_SRGB;
  bool wide = false;  // made from 16 bits
  int quality = 92;
  bool gain_map = false;
};

constexpr FileKind kKinds[] = {
    {.name = "PNG, 8 bits", .extension = ".png"},
    {.name = "PNG, 16 bits", .extension = ".png", .wide = true},
    {.name = "JPEG, quality 92", .extension = ".jpg"},
    {.name = "JPEG, quality 75", .extension = ".jpg", .quality = 75},
    {.name = "JPEG, quality 92, with a gain map", .extension = ".jpg", .gain_map = true},
    {.name = "AVIF, quality 92", .extension = ".avif", .wide = true},
    {.name = "PNG, 16 bits, PQ", .extension = ".png", .transfer = v1::TRANSFER_PQ, .wide = true},
    {.name = "AVIF, quality 92, PQ", .extension = ".avif", .transfer = v1::TRANSFER_PQ, .wide = true},
};

struct Rendered {
  Image picture;
  WriteOptions options;
};

absl::StatusOr<Rendered> render(const ReportSession& session, const ReportImage& image,
                                const FileKind& kind) {
  v1::Settings settings = ReportSession::settings(session.bounded_tier());
  settings.set_transfer(kind.transfer);
  settings.set_output_format(kind.wide ? v1::OUTPUT_FORMAT_RGBA16 : v1::OUTPUT_FORMAT_RGBA8);
  if (kind.gain_map) settings.set_gain_map_peak_nits(kGainMapNits);
  ASSIGN_OR_RETURN(RenderResult result, session.render(settings, image.image));
  WriteOptions options;
  options.transfer = encoded_transfer(settings);
  options.hdr = hdr_display(settings, 0, 0);
  options.jpeg_quality = kind.quality;
  options = write_options_for(std::move(options), result.header, {});
  return Rendered{picture_of(std::move(result), false, 1), std::move(options)};
}

absl::StatusOr<Json> file_row(const ReportSession& session, const ReportImage& image, const FileKind& kind,
                              const std::string& folder) {
  ASSIGN_OR_RETURN(const Rendered rendered, render(session, image, kind));
  FileKind whole = kind;  // with 16 bits, which the file is compared with
  whole.wide = true;
  whole.gain_map = false;
  ASSIGN_OR_RETURN(const Rendered truth, render(session, image, whole));
  const std::string path = absl::StrCat(folder, "/file_kind", kind.extension);
  const absl::Cleanup remove = [&path] {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  };
  std::vector<double> write, read;
  for (int i = 0; i < kRepeats; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    RETURN_IF_ERROR(write_image(path, rendered.picture, rendered.options).status());
    write.push_back(ms_since(begin));
    const auto written = std::chrono::steady_clock::now();
    RETURN_IF_ERROR(read_codes(path).status());
    read.push_back(ms_since(written));
  }
  ASSIGN_OR_RETURN(const Image codes, read_codes(path));
  ASSIGN_OR_RETURN(const FileError error, error_of_file(path, codes, truth.picture));
  return Json{{"kind", kind.name},
              {"width", truth.picture.width},
              {"height", truth.picture.height},
              {"write_ms", spread(write)},
              {"read_ms", spread(read)},
              {"bytes", std::filesystem::file_size(path)},
              {"max_codes", error.max_codes},
              {"p999_codes", error.p999_codes},
              {"mean_codes", error.mean_codes}};
}

}  // namespace

absl::StatusOr<Json> measure_files(const ReportSession& session, const ReportImage& image,
                                   const std::string& folder) {
  Json rows = Json::array();
  for (const FileKind& kind : kKinds) {
    session.show(absl::StrCat("file: ", kind.name));
    absl::StatusOr<Json> row = file_row(session, image, kind, folder);
    if (!row.ok()) row = Json{{"kind", kind.name}, {"error", std::string(row.status().message())}};
    rows.push_back(*std::move(row));
  }
  return rows;
}

}  // namespace candela
