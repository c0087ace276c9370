#include "client/cli/commands/report/errors.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/number_words.h"
#include "client/cli/commands/report/pictures.h"
#include "client/cli/commands/report/samples.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

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

}  // namespace candela
