#include "client/cli/commands/report/file_kinds.h"

#include <chrono>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "client/cli/commands/report/samples.h"
#include "client/run/frame_files.h"
#include "client/run/picture_error.h"
#include "server/base/status_macros.h"
#include "server/encode/image_file.h"

namespace candela {
namespace {

constexpr int kTimes = 3;
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
  options = write_options_for(std::move(options), result.header);
  return Rendered{picture_of(std::move(result), false, 1), std::move(options)};
}

absl::StatusOr<Json> row_of(const ReportSession& session, const ReportImage& image, const FileKind& kind,
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
  for (int i = 0; i < kTimes; ++i) {
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
    absl::StatusOr<Json> row = row_of(session, image, kind, folder);
    if (!row.ok()) row = Json{{"kind", kind.name}, {"error", std::string(row.status().message())}};
    rows.push_back(*std::move(row));
  }
  return rows;
}

}  // namespace candela
