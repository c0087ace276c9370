#include "client/cli/report/summary.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/cli/report/html.h"
#include "client/cli/report/plots.h"

namespace candela {
namespace {

// The rows with a time and an error of the largest size that has most of them.
std::vector<Json> rows_to_sum_up(const Json& times) {
  std::vector<Json> best, rows;
  const auto take = [&best, &rows] {
    if (rows.size() >= best.size()) best = rows;
    rows.clear();
  };
  for (const Json& row : times) {
    if (!rows.empty() && rows.front()["megapixels"] != row["megapixels"]) take();
    if (row.contains("error") && row["error"]["max_codes"].is_number()) rows.push_back(row);
  }
  take();
  return best;
}

std::string summary_of(const Json& report, const std::string& tier) {
  for (const Json& known : report["tiers"]) {
    if (known["name"] == tier) return known["summary"];
  }
  return "";
}

std::string advice(size_t i, const std::vector<size_t>& front) {
  if (std::find(front.begin(), front.end(), i) == front.end())
    return "beaten: another is faster and no less accurate";
  if (front.size() == 1) return "the fastest and the most accurate";
  if (i == front.front()) return "where time counts most";
  return i == front.back() ? "where the error must be least" : "between the two";
}

std::string tier_table(const Json& report) {
  const std::vector<Json> rows = rows_to_sum_up(report["times"]);
  std::vector<std::pair<double, double>> points;
  for (const Json& row : rows) points.emplace_back(row["device_ms"]["median"], row["error"]["max_codes"]);
  const std::vector<size_t> front = pareto_front(points);
  HtmlTable table({"tier", "take it", "ms a frame", "of a memcpy", "largest error, codes", "what it trades"});
  for (size_t i = 0; i < rows.size(); ++i) {
    const Json& row = rows[i];
    table.add({{.text = "<b>" + html_escaped(row["tier"]) + "</b>"},
               text_cell(advice(i, front)),
               number_cell(row["device_ms"]["median"]),
               {.text = short_number(row["memcpy_ratio"]) + "x", .number = true},
               number_cell(row["error"]["max_codes"]),
               text_cell(summary_of(report, row["tier"]))});
  }
  if (rows.empty()) return html_paragraph("No tier was both timed and verified.");
  return html_paragraph(absl::StrFormat("At %dx%d, half floats in, 8-bit sRGB out, with bloom:",
                                        rows[0]["width"].get<int>(), rows[0]["height"].get<int>())) +
         table.html();
}

std::string verdicts(const Json& report) {
  int beyond = 0, failed = 0, infinite = 0;
  for (const Json& row : report["stage_errors"]) beyond += row["ok"].get<bool>() ? 0 : 1;
  for (const Json& row : report["hard_cases"]) {
    if (row.contains("error")) {
      ++failed;
    } else if (!row["finite"].get<bool>()) {
      ++infinite;
    }
  }
  const auto count = [](int n, const char* none, const char* some) {
    return n == 0 ? std::string(none) : absl::StrFormat("<span class=\"bad\">%d %s</span>", n, some);
  };
  return absl::StrFormat("<p>%s; %s; %s.</p>\n",
                         count(beyond, "Every stage is within its bound", "stages are beyond their bounds"),
                         count(failed, "every hard case rendered", "hard cases failed"),
                         count(infinite, "every result is finite", "results hold NaN or infinities"));
}

}  // namespace

std::string summary_section(const Json& report) {
  return absl::StrFormat(
             "<h1>Candela on %s</h1>\n<p class=\"quiet\">candela %s, %s, measured in %.0f s%s</p>\n",
             html_escaped(report["machine"]["device"]), html_escaped(report["machine"]["candela"]),
             html_escaped(report["date"]), report["seconds"].get<double>(),
             report["quick"].get<bool>() ? " with --quick" : "") +
         tier_table(report) + verdicts(report);
}

}  // namespace candela
