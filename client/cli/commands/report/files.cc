#include "client/cli/commands/report/files.h"

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "client/image/write/atomic_file.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// A column's name, and the JSON pointer to its value in a row.
struct Column {
  const char* name;
  const char* pointer;
};

constexpr Column kTimes[] = {{"megapixels", "/megapixels"},
                             {"width", "/width"},
                             {"height", "/height"},
                             {"tier", "/tier"},
                             {"frames", "/frames"},
                             {"device_p10_ms", "/device_ms/p10"},
                             {"device_median_ms", "/device_ms/median"},
                             {"device_p90_ms", "/device_ms/p90"},
                             {"call_median_ms", "/call_ms/median"},
                             {"memcpy_median_ms", "/memcpy_ms/median"},
                             {"memcpy_ratio", "/memcpy_ratio"},
                             {"max_error_codes", "/error/max_codes"},
                             {"p999_error_codes", "/error/p999_codes"},
                             {"mean_error_codes", "/error/mean_codes"},
                             {"skipped", "/skipped"},
                             {"error_skipped", "/error_skipped"}};

constexpr Column kHardCases[] = {{"case", "/case"},
                                 {"expected", "/expected"},
                                 {"width", "/width"},
                                 {"height", "/height"},
                                 {"tier", "/tier"},
                                 {"finite", "/finite"},
                                 {"max_error_codes", "/max_error_codes"},
                                 {"p999_error_codes", "/p999_error_codes"},
                                 {"differing_components", "/differing_components"},
                                 {"meter_error_ev", "/meter_error_ev"},
                                 {"bloom_error", "/bloom_error"},
                                 {"exposure", "/exposure"},
                                 {"nan", "/nan"},
                                 {"inf", "/inf"},
                                 {"negative", "/negative"},
                                 {"picture_min_code", "/picture/min"},
                                 {"picture_max_code", "/picture/max"},
                                 {"picture_mean_code", "/picture/mean"},
                                 {"flicker", "/flicker"},
                                 {"error", "/error"}};

constexpr Column kAces[] = {{"set", "/set"},
                            {"curve", "/curve"},
                            {"tier", "/tier"},
                            {"pixels", "/pixels"},
                            {"max_codes", "/codes/max"},
                            {"p95_codes", "/codes/p95"},
                            {"mean_codes", "/codes/mean"},
                            {"max_delta_e", "/delta_e/max"},
                            {"p95_delta_e", "/delta_e/p95"},
                            {"mean_delta_e", "/delta_e/mean"},
                            {"error", "/error"}};

constexpr Column kFiles[] = {{"kind", "/kind"},
                             {"width", "/width"},
                             {"height", "/height"},
                             {"bytes", "/bytes"},
                             {"write_median_ms", "/write_ms/median"},
                             {"read_median_ms", "/read_ms/median"},
                             {"max_codes", "/max_codes"},
                             {"p999_codes", "/p999_codes"},
                             {"mean_codes", "/mean_codes"},
                             {"error", "/error"}};

constexpr Column kBakes[] = {{"panorama", "/panorama"},
                             {"size", "/size"},
                             {"tier", "/tier"},
                             {"bakes", "/bakes"},
                             {"device_p10_ms", "/device_ms/p10"},
                             {"device_median_ms", "/device_ms/median"},
                             {"device_p90_ms", "/device_ms/p90"},
                             {"call_median_ms", "/call_ms/median"},
                             {"max_error", "/max_error"},
                             {"skipped", "/skipped"},
                             {"error_skipped", "/error_skipped"}};

// "-" if the row has no such value.
std::string csv_value(const Json& row, const Column& column) {
  const Json::json_pointer pointer(column.pointer);
  if (!row.contains(pointer)) return "-";
  const Json& value = row.at(pointer);
  if (!value.is_string()) return value.dump();
  return absl::StrCat("\"", absl::StrReplaceAll(value.get<std::string>(), {{"\"", "\"\""}}), "\"");
}

template <size_t N>
std::string csv(const Column (&columns)[N], const Json& rows) {
  std::vector<std::string> cells;
  for (const Column& column : columns) cells.push_back(column.name);
  std::string text = absl::StrJoin(cells, ",") + "\n";
  for (const Json& row : rows) {
    cells.clear();
    for (const Column& column : columns) cells.push_back(csv_value(row, column));
    text += absl::StrJoin(cells, ",") + "\n";
  }
  return text;
}

absl::Status write_file(const std::string& path, const std::string& text) {
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path));
  file.write(text.data(), text.size());
  return file.commit();
}

// A path need not be UTF-8.
std::string json_text(const Json& report, int indent) {
  return report.dump(indent, ' ', false, Json::error_handler_t::replace);
}

// The page with the report in it. JSON needs '<' in strings only, where an escape says the same. Without any
// '<' the text cannot end the element that it stands in.
std::string page_of(const Json& report) {
  constexpr char kPlaceholder[] = "id=\"report\">null<";
  const std::string text = absl::StrReplaceAll(json_text(report, -1), {{"<", "\\u003c"}});
  return absl::StrReplaceAll(kPageTemplate, {{kPlaceholder, absl::StrCat("id=\"report\">", text, "<")}});
}

}  // namespace

absl::Status write_report(const Json& report, const std::string& folder) {
  const Json& aces = report["aces"];
  absl::Status status;
  status.Update(write_file(folder + "/report.json", json_text(report, 1) + "\n"));
  status.Update(write_file(folder + "/times.csv", csv(kTimes, report["times"])));
  status.Update(write_file(folder + "/hard_cases.csv", csv(kHardCases, report["hard_cases"])));
  status.Update(
      write_file(folder + "/aces.csv", csv(kAces, aces.contains("rows") ? aces["rows"] : Json::array())));
  status.Update(write_file(folder + "/files.csv", csv(kFiles, report["files"])));
  status.Update(write_file(folder + "/bakes.csv", csv(kBakes, report["bakes"])));
  status.Update(write_file(folder + "/index.html", page_of(report)));
  return status;
}

}  // namespace candela
