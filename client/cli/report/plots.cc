#include "client/cli/report/plots.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/files/plot.h"

namespace candela {
namespace {

constexpr int kWidth = 820;
constexpr int kHeight = 430;
// Dark to light by size or stage; readable in grey, too.
constexpr const char* kColors[] = {"#1b4f8a", "#d9822b", "#4b9b8e", "#8a8a8a",
                                   "#7b3f7d", "#b5a642", "#c0504d"};
constexpr int kShapes[] = {7, 5, 9, 11, 13, 3};

constexpr char kStyle[] =
    "set border 3 lc rgb '#888888' lw 0.8\n"
    "set tics nomirror tc rgb '#333333'\n"
    "set grid lc rgb '#dddddd' lw 0.6 lt 1\n"
    "set key outside right top reverse Left tc rgb '#333333' samplen 1.5 spacing 1.2\n"
    "set tmargin 1\n";

const char* color(size_t i) { return kColors[i % std::size(kColors)]; }
int shape(size_t i) { return kShapes[i % std::size(kShapes)]; }

std::string size_words(const Json& row) {
  return absl::StrFormat("%dx%d", row["width"].get<int>(), row["height"].get<int>());
}

double median(const Json& row) { return row["device_ms"]["median"]; }

// In the order of their first row.
std::vector<std::string> tiers_of(const Json& times) {
  std::vector<std::string> tiers;
  for (const Json& row : times) {
    if (std::find(tiers.begin(), tiers.end(), row["tier"]) == tiers.end()) tiers.push_back(row["tier"]);
  }
  return tiers;
}

size_t index_of(const std::vector<std::string>& names, const std::string& name) {
  return static_cast<size_t>(std::find(names.begin(), names.end(), name) - names.begin());
}

// What one size's tiers come to; only those with a time and an error.
struct SizeGroup {
  std::string words;
  std::vector<std::string> tiers;
  std::vector<std::pair<double, double>> points;  // ms, codes
  std::vector<std::pair<double, double>> spread;  // p10, p90 of ms
};

std::vector<SizeGroup> group_by_size(const Json& times) {
  std::vector<SizeGroup> groups;
  for (const Json& row : times) {
    if (!row.contains("device_ms") || !row.contains("error")) continue;
    const std::string words = absl::StrFormat("%g MP, %s", row["megapixels"].get<double>(), size_words(row));
    if (groups.empty() || groups.back().words != words) groups.push_back({words, {}, {}, {}});
    const Json& codes = row["error"]["max_codes"];
    if (!codes.is_number()) continue;
    groups.back().tiers.push_back(row["tier"]);
    groups.back().points.emplace_back(median(row), std::max(kErrorFloorCodes, codes.get<double>()));
    groups.back().spread.emplace_back(row["device_ms"]["p10"], row["device_ms"]["p90"]);
  }
  return groups;
}

std::string front_block(const std::string& name, const SizeGroup& group) {
  std::string block = absl::StrFormat("$%s << EOD\n", name);
  for (const size_t i : pareto_front(group.points)) {
    absl::StrAppendFormat(&block, "%.9g %.9g\n", group.points[i].first, group.points[i].second);
  }
  return block + "EOD\n";
}

std::string tier_block(const std::string& name, const SizeGroup& group, const std::string& tier) {
  std::string block = absl::StrFormat("$%s << EOD\n", name);
  for (size_t i = 0; i < group.points.size(); ++i) {
    if (group.tiers[i] != tier) continue;
    absl::StrAppendFormat(&block, "%.9g %.9g %.9g %.9g\n", group.points[i].first, group.points[i].second,
                          group.spread[i].first, group.spread[i].second);
  }
  return block + "EOD\n";
}

// The largest size whose every timed tier has stages: of more tiers before fewer. Without those beyond scale.
std::vector<Json> rows_to_compare(const Json& times) {
  std::map<double, std::vector<Json>> by_size;
  for (const Json& row : times) {
    if (row.contains("stages")) by_size[row["megapixels"]].push_back(row);
  }
  std::vector<Json> best;
  for (const auto& [size, rows] : by_size) {
    if (rows.size() >= best.size()) best = rows;
  }
  double fastest = std::numeric_limits<double>::infinity();
  for (const Json& row : best) fastest = std::min(fastest, median(row));
  std::erase_if(best, [fastest](const Json& row) { return median(row) > kBeyondScale * fastest; });
  return best;
}

double stage_ms(const Json& row, const std::string& name) {
  for (const Json& stage : row["stages"]) {
    if (stage["name"] == name) return stage["ms"]["median"];
  }
  return 0;
}

}  // namespace

std::vector<size_t> pareto_front(const std::vector<std::pair<double, double>>& points) {
  std::vector<size_t> order(points.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return points[a] < points[b]; });
  std::vector<size_t> front;
  double least = std::numeric_limits<double>::infinity();
  for (const size_t i : order) {
    if (points[i].second >= least) continue;
    least = points[i].second;
    front.push_back(i);
  }
  return front;
}

absl::StatusOr<std::string> plot_time_against_error(const Json& times) {
  const std::vector<SizeGroup> groups = group_by_size(times);
  const std::vector<std::string> tiers = tiers_of(times);
  std::string data;
  std::vector<std::string> plots;
  for (size_t g = 0; g < groups.size(); ++g) {
    if (groups[g].points.empty()) continue;
    const std::string front = absl::StrFormat("front%d", g);
    data += front_block(front, groups[g]);
    plots.push_back(absl::StrFormat("$%s using 1:2 with steps lw 1.6 lc rgb '%s' title %s", front, color(g),
                                    quoted_for_plot(groups[g].words)));
    for (const std::string& tier : groups[g].tiers) {
      const size_t t = index_of(tiers, tier);
      const std::string block = absl::StrFormat("points%d_%d", g, t);
      data += tier_block(block, groups[g], tier);
      plots.push_back(
          absl::StrFormat("$%s using 1:2:3:4 with xerrorbars pt %d ps 1.1 lw 1.2 lc rgb '%s' notitle", block,
                          shape(t), color(g)));
    }
  }
  if (plots.empty()) return "";
  for (size_t t = 0; t < tiers.size(); ++t) {
    plots.push_back(absl::StrFormat("NaN with points pt %d ps 1.1 lc rgb '#333333' title %s", shape(t),
                                    quoted_for_plot("tier " + tiers[t])));
  }
  const std::string axes = absl::StrFormat(
      "set logscale xy\nset format x '%%g'\nset format y '%%g'\n"
      "set xlabel 'device time of a frame, ms (median; bars p10 to p90)'\n"
      "set ylabel 'largest error, codes'\nset yrange [%g:]\nset offsets graph 0.08, graph 0.08, graph 0.1, "
      "0\nset arrow from graph 0, first 0.5 to graph 1, first 0.5 nohead dt 2 lc rgb '#b00020'\n"
      "set label '0.5 code' at graph 0.98, first 0.5 right offset 0, 0.6 tc rgb '#b00020'\n",
      kErrorFloorCodes / 2);
  return plot_svg("error", kWidth, kHeight, kStyle + axes + data + "plot " + absl::StrJoin(plots, ", "));
}

absl::StatusOr<std::string> plot_stages(const Json& times) {
  const std::vector<Json> rows = rows_to_compare(times);
  if (rows.empty()) return "";
  std::vector<std::string> names;
  for (const Json& row : rows) {
    for (const Json& stage : row["stages"]) {
      if (std::find(names.begin(), names.end(), stage["name"]) == names.end()) names.push_back(stage["name"]);
    }
  }
  std::string data = "$stages << EOD\n";
  for (const Json& row : rows) {
    data += absl::StrFormat("\"%s\"", row["tier"].get<std::string>());
    for (const std::string& name : names) absl::StrAppendFormat(&data, " %.9g", stage_ms(row, name));
    data += "\n";
  }
  data += "EOD\n";
  std::vector<std::string> plots;
  for (size_t i = 0; i < names.size(); ++i) {
    plots.push_back(absl::StrFormat("$stages using %d%s lc rgb '%s' title %s", i + 2,
                                    i == 0 ? ":xtic(1)" : "", color(i), quoted_for_plot(names[i])));
  }
  const std::string axes = absl::StrFormat(
      "set style data histograms\nset style histogram rowstacked\nset style fill solid 0.9 noborder\n"
      "set boxwidth 0.5\nset yrange [0:]\nset grid noxtics\nset key invert\nset ylabel 'device time, ms "
      "(medians), %s'\n",
      size_words(rows.front()));
  return plot_svg("stages", kWidth, kHeight, kStyle + axes + data + "plot " + absl::StrJoin(plots, ", "));
}

absl::StatusOr<std::string> plot_scaling(const Json& times) {
  const std::vector<std::string> tiers = tiers_of(times);
  std::string data;
  std::vector<std::string> plots;
  for (size_t t = 0; t < tiers.size(); ++t) {
    std::string points;
    for (const Json& row : times) {
      if (row["tier"] != tiers[t] || !row.contains("device_ms")) continue;
      const double megapixels = row["width"].get<double>() * row["height"].get<double>() * 1e-6;
      const auto each = [&](const char* key) { return row["device_ms"][key].get<double>() / megapixels; };
      absl::StrAppendFormat(&points, "%.9g %.9g %.9g %.9g\n", megapixels, each("median"), each("p10"),
                            each("p90"));
    }
    if (points.empty()) continue;
    absl::StrAppendFormat(&data, "$tier%d << EOD\n%sEOD\n", t, points);
    plots.push_back(
        absl::StrFormat("$tier%d using 1:2:3:4 with yerrorlines pt %d ps 0.9 lw 1.4 lc rgb '%s' title %s", t,
                        shape(t), color(t), quoted_for_plot(tiers[t])));
  }
  if (plots.empty()) return "";
  const std::string axes =
      "set logscale xy\nset format x '%g'\nset format y '%g'\nset xlabel 'megapixels'\n"
      "set ylabel 'device time, ms a megapixel (median; bars p10 to p90)'\n"
      "set offsets graph 0.05, graph 0.05, graph 0.1, graph 0.1\n";
  return plot_svg("scaling", kWidth, kHeight, kStyle + axes + data + "plot " + absl::StrJoin(plots, ", "));
}

}  // namespace candela
