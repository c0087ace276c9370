#include "client/cli/report/page.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/files/error_map.h"
#include "client/cli/report/html.h"
#include "client/cli/report/plots.h"
#include "client/cli/report/summary.h"

namespace candela {
namespace {

constexpr char kStyle[] = R"(
body{font:15px/1.5 system-ui,sans-serif;color:#222;max-width:1060px;margin:2em auto;padding:0 1.2em}
h1{font-size:1.7em;margin:0 0 .2em} h2{font-size:1.25em;margin:2.2em 0 .3em;border-top:1px solid #ddd;padding-top:.9em}
h3{font-size:1.02em;margin:1.4em 0 .3em}
p{max-width:52em;margin:.4em 0 .8em} code,pre{font:13px/1.5 ui-monospace,monospace;background:#f5f5f3}
pre{padding:.7em 1em;white-space:pre-wrap} .wide{overflow-x:auto}
table{border-collapse:collapse;font-size:13.5px;margin:.5em 0 1em;font-variant-numeric:tabular-nums}
th{text-align:left;font-weight:600;border-bottom:1px solid #888;padding:.25em .8em .25em 0;vertical-align:bottom}
td{border-bottom:1px solid #e8e8e8;padding:.22em .8em .22em 0;vertical-align:top}
.n{text-align:right} .bad{color:#b00020;font-weight:600} .quiet{color:#666}
svg{max-width:100%;height:auto;display:block;margin:.4em 0} img{max-width:100%;height:auto;display:block}
.row{display:flex;flex-wrap:wrap;gap:16px} figure{margin:0 0 1em;width:480px;max-width:100%} figcaption{font-size:13px;color:#444}
)";

std::string heading(const std::string& text) { return absl::StrFormat("<h2>%s</h2>\n", html_escaped(text)); }

std::string size_words(const Json& row) {
  return absl::StrFormat("%dx%d", row["width"].get<int>(), row["height"].get<int>());
}

// "median (p10 .. p90)", as markup; the median alone of a single frame.
std::string spread_words(const Json& spread) {
  const std::string median = "<b>" + short_number(spread["median"]) + "</b>";
  if (spread["p10"] == spread["p90"]) return median;
  return absl::StrFormat("%s <span class=\"quiet\">(%s .. %s)</span>", median, short_number(spread["p10"]),
                         short_number(spread["p90"]));
}

Cell spread_cell(const Json& spread) { return {.text = spread_words(spread), .number = true}; }

// A message over the rest of a row.
Cell message_cell(const Json& message, int columns, bool bad) {
  return {.text = html_escaped(message.get<std::string>()), .bad = bad, .columns = columns};
}

std::string machine_section(const Json& report) {
  const Json& machine = report["machine"];
  HtmlTable table;
  for (const auto& [name, value] : machine.items())
    table.add({text_cell(name), text_cell(value.get<std::string>())});
  return heading("The machine") + table.html() + "<h3>To repeat it</h3>\n" +
         absl::StrFormat(
             "<pre>%s\n%s</pre>\n", html_escaped(report["command"].get<std::string>()),
             "candela render IN.exr OUT.png --tier TIER --verify --error-map MAP.png   # one image") +
         html_paragraph(
             "report.json beside this page holds every number on it; times.csv, hard_cases.csv and aces.csv "
             "hold the tables.");
}

std::string times_table(const Json& times) {
  HtmlTable table({"size", "tier", "device, ms (p10 .. p90)", "memcpy, ms", "of a memcpy", "whole call, ms",
                   "frames", "max error", "p99.9", "mean"});
  for (const Json& row : times) {
    std::vector<Cell> cells{text_cell(size_words(row)), text_cell(row["tier"])};
    if (row.contains("skipped")) {
      cells.push_back(message_cell(row["skipped"], 8, false));
      table.add(std::move(cells));
      continue;
    }
    cells.push_back(spread_cell(row["device_ms"]));
    cells.push_back(number_cell(row["memcpy_ms"]["median"]));
    cells.push_back({.text = short_number(row["memcpy_ratio"]) + "x", .number = true});
    cells.push_back(number_cell(row["call_ms"]["median"]));
    cells.push_back(number_cell(row["frames"]));
    if (row.contains("error")) {
      for (const char* key : {"max_codes", "p999_codes", "mean_codes"})
        cells.push_back(number_cell(row["error"][key]));
    } else {
      cells.push_back(message_cell(row["error_skipped"], 3, false));
    }
    table.add(std::move(cells));
  }
  return table.html();
}

absl::StatusOr<std::string> times_section(const Json& report) {
  const Json& times = report["times"];
  const absl::StatusOr<std::string> plot = plot_time_against_error(times);
  if (!plot.ok()) return plot;
  const absl::StatusOr<std::string> scaling = plot_scaling(times);
  if (!scaling.ok()) return scaling;
  return heading("Time against error: left is faster, lower is nearer to the truth") +
         html_paragraph(absl::StrFormat(
             "Each point is a tier at a size; a line is the Pareto front of its size, the least error for "
             "the time, and a point above its line is beaten. Error is the largest of any pixel, in codes of "
             "1/255, before quantising, against the float64 reference, on the sample scene with all settings "
             "at their defaults; above 0.5 an 8-bit picture may differ by more than one code. Errors "
             "under %g codes, 0 among them, are drawn at %g.",
             kErrorFloorCodes, kErrorFloorCodes)) +
         *plot + times_table(times) +
         html_paragraph(
             "Device time is the sum of the stages, without the queue: median, and tenth and ninetieth "
             "percentile in parentheses. The memcpy is of the frame as it comes in (8 bytes a pixel), once "
             "beside every frame that is timed: what touching its memory costs on this machine at that "
             "moment. The whole call is what a client in front of the server waits. Errors are in codes.") +
         "<h3>Time a megapixel: a level line is work in proportion to the pixels</h3>\n" + *scaling;
}

std::string stage_times_table(const Json& times) {
  HtmlTable table({"size", "tier", "stages, ms: median (p10 .. p90)"});
  for (const Json& row : times) {
    if (!row.contains("stages")) continue;
    std::vector<std::string> words;
    for (const Json& stage : row["stages"]) {
      words.push_back(html_escaped(stage["name"]) + " " + spread_words(stage["ms"]));
    }
    table.add(
        {text_cell(size_words(row)), text_cell(row["tier"]), {.text = absl::StrJoin(words, " &nbsp; ")}});
  }
  return table.html();
}

absl::StatusOr<std::string> stages_section(const Json& report) {
  const absl::StatusOr<std::string> plot = plot_stages(report["times"]);
  if (!plot.ok()) return plot;
  return heading("Where the time goes: stage by stage") +
         html_paragraph(absl::StrFormat("The largest size that most tiers were timed at is drawn, without "
                                        "tiers that take over %g times as long as the fastest; all are in "
                                        "the table.",
                                        kBeyondScale)) +
         *plot + stage_times_table(report["times"]);
}

std::string bounds_section(const Json& report) {
  HtmlTable table({"stage", "unit", "bound", "measured", "worst on", "verdict"});
  for (const Json& row : report["stage_errors"]) {
    const bool ok = row["ok"];
    table.add({text_cell(row["stage"]),
               text_cell(row["unit"]),
               number_cell(row["bound"]),
               number_cell(row["measured"]),
               text_cell(row["where"]),
               {.text = ok ? "within" : "BEYOND", .bad = !ok}});
  }
  return heading("Every stage's error against its bound") +
         html_paragraph(
             absl::StrFormat("The bounds that docs/pipeline.md promises, and the worst of all hard cases, "
                             "curves and images on this page, at "
                             "tier %s. Differing components are counted on frames of at least 1000 of them.",
                             report["bounded_tier"].get<std::string>())) +
         table.html();
}

std::string picture_words(const Json& picture) {
  return absl::StrFormat("%d .. %d, mean %s", picture["min"].get<int>(), picture["max"].get<int>(),
                         short_number(picture["mean"]));
}

Cell error_cell(const Json& row) {
  if (row.contains("error")) return message_cell(row["error"], 1, true);
  if (!row["finite"].get<bool>()) return {.text = "NOT FINITE", .bad = true};
  return number_cell(row["max_error_codes"]);
}

// One case's rows, a tier each.
std::vector<Cell> hard_case_cells(const Json& report, const std::vector<const Json*>& rows) {
  const Json* shown = rows.front();
  for (const Json* row : rows) {
    if ((*row)["tier"] == report["bounded_tier"]) shown = row;
  }
  std::vector<Cell> cells{text_cell((*shown)["case"]), text_cell(size_words(*shown)),
                          text_cell((*shown)["expected"])};
  if (shown->contains("error")) {
    cells.push_back(message_cell((*shown)["error"], 3, true));
  } else {
    const std::string note = (*shown)["note"];
    cells.push_back(text_cell(picture_words((*shown)["picture"]) + (note.empty() ? "" : "; " + note)));
    cells.push_back(number_cell((*shown)["exposure"], 4));
    cells.push_back({.text = absl::StrFormat("%s / %s / %s", (*shown)["nan"].dump(), (*shown)["inf"].dump(),
                                             (*shown)["negative"].dump()),
                     .number = true});
  }
  for (const Json* row : rows) cells.push_back(error_cell(*row));
  return cells;
}

std::string hard_cases_section(const Json& report) {
  std::vector<std::string> heads{
      "case", "size", "stated result", "picture, 8-bit codes", "exposure", "NaN / Inf / negative in"};
  for (const Json& tier : report["tiers"]) heads.push_back(tier["name"].get<std::string>() + ", codes");
  HtmlTable table(heads);
  std::vector<const Json*> rows;
  for (const Json& row : report["hard_cases"]) {
    rows.push_back(&row);
    if (rows.size() < report["tiers"].size()) continue;
    table.add(hard_case_cells(report, rows));
    rows.clear();
  }
  return heading("Hard cases: frames on which image pipelines fail") +
         html_paragraph(absl::StrFormat(
             "The last columns are each tier's largest error against the float64 reference, which follows "
             "the stated result; a number there means that every value of the picture as floats is finite, "
             "too. Picture and exposure are of tier %s. Counts are of components of the frame that came in.",
             report["bounded_tier"].get<std::string>())) +
         table.html();
}

std::string aces_section(const Json& report) {
  const Json& aces = report["aces"];
  std::string html = heading("How far the ACES approximations are from the whole transform");
  if (aces.contains("missing"))
    return html + html_paragraph("Not measured: " + aces["missing"].get<std::string>() + ".");
  html += html_paragraph(absl::StrFormat(
      "Against curve %s at tier %s, the whole transform by OpenColorIO without a table, from 16-bit "
      "pictures. The rows of %s itself are the tables of cheaper tiers; docs/pipeline.md, section 5, has "
      "their errors by table size. Codes: the largest difference of R, G and B in 1/255 of the display "
      "range. dE: CIEDE2000 by Little CMS under D65; about 1 is just visible side by side. Charts at "
      "exposure 1, images as metered, all without bloom.",
      aces["reference"].get<std::string>(), aces["tier"].get<std::string>(),
      aces["reference"].get<std::string>()));
  HtmlTable table({"colours", "curve", "tier", "codes: max", "p95", "mean", "dE: max", "p95", "mean"});
  for (const Json& row : aces["rows"]) {
    std::vector<Cell> cells{text_cell(row["set"]), text_cell(row["curve"]), text_cell(row["tier"])};
    if (row.contains("error")) {
      cells.push_back(message_cell(row["error"], 6, true));
    } else {
      for (const char* kind : {"codes", "delta_e"}) {
        for (const char* key : {"max", "p95", "mean"}) cells.push_back(number_cell(row[kind][key]));
      }
    }
    table.add(std::move(cells));
  }
  return html + table.html();
}

std::string figure(const std::string& png, const std::string& caption) {
  return absl::StrFormat(
      "<figure><img alt=\"\" src=\"data:image/png;base64,%s\"><figcaption>%s</figcaption></figure>\n", png,
      html_escaped(caption));
}

std::string image_figures(const Json& image) {
  std::string html = absl::StrFormat("<h3>%s, %s%s</h3>\n<div class=\"row\">\n",
                                     html_escaped(image["name"].get<std::string>()), size_words(image),
                                     html_escaped(image["note"].get<std::string>()));
  if (image.contains("picture")) html += figure(image["picture"], "as rendered");
  for (const Json& map : image["maps"]) {
    const std::string tier = map["tier"];
    if (map.contains("error")) {
      html += html_paragraph(tier + ": " + map["error"].get<std::string>());
      continue;
    }
    html += figure(
        map["png"],
        absl::StrFormat("%s: at most %s codes, p99.9 %s, mean %s; %s %% of components differ once quantised",
                        tier, short_number(map["max_error_codes"]), short_number(map["p999_error_codes"]),
                        short_number(map["mean_error_codes"]),
                        short_number(100 * map["differing_components"].get<double>())));
  }
  return html + "</div>\n";
}

std::string images_section(const Json& report) {
  std::string html =
      heading("Error maps: where a picture is off") +
      html_paragraph(absl::StrFormat(
          "Colours are %s. The same scale for every map; where a map is smaller than its image, each pixel "
          "is the worst of those it stands for.",
          error_scale_words()));
  for (const Json& image : report["images"]) html += image_figures(image);
  return html;
}

std::string scenes_section(const Json& report) {
  HtmlTable table(
      {"scene", "size", "device, ms (p10 .. p90)", "memcpy, ms", "of a memcpy", "the server's plan"});
  for (const Json& row : report["scenes"]) {
    if (row.contains("error")) {
      table.add({text_cell(row["what"]), message_cell(row["error"], 5, true)});
      continue;
    }
    std::vector<std::string> plan;
    for (const Json& line : row["plan"]) plan.push_back(html_escaped(line));
    table.add({text_cell(row["what"]),
               text_cell(size_words(row)),
               spread_cell(row["device_ms"]),
               number_cell(row["memcpy_ms"]["median"]),
               {.text = short_number(row["memcpy_ratio"]) + "x", .number = true},
               {.text = absl::StrJoin(plan, "<br>")}});
  }
  return heading("What a scene does not need is not done") +
         html_paragraph(
             "One thing changed at a time against the first row; \"nothing bright\" and \"five small "
             "lights\" are the same picture cut to a quarter of the bloom's threshold. The memcpy is of the "
             "frame as it comes in, beside every frame that is timed; the plan is the server's own.") +
         table.html();
}

}  // namespace

absl::StatusOr<std::string> report_page(const Json& report) {
  const absl::StatusOr<std::string> times = times_section(report);
  if (!times.ok()) return times;
  const absl::StatusOr<std::string> stages = stages_section(report);
  if (!stages.ok()) return stages;
  return absl::StrCat(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n<title>Candela report</title>\n",
      "<meta name=\"viewport\" content=\"width=device-width\">\n<style>", kStyle, "</style></head><body>\n",
      summary_section(report), machine_section(report), *times, *stages, bounds_section(report),
      hard_cases_section(report), aces_section(report), images_section(report), scenes_section(report),
      "</body></html>\n");
}

}  // namespace candela
