#include "client/cli/report/html.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

namespace candela {

std::string html_escaped(const std::string& text) {
  return absl::StrReplaceAll(text, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}});
}

std::string short_number(const Json& number, int digits) {
  if (!number.is_number()) return number.is_string() ? number.get<std::string>() : number.dump();
  const double value = number;
  if (value == 0) return "0";
  const int magnitude = static_cast<int>(std::floor(std::log10(std::abs(value))));
  if (magnitude < -4 || magnitude > 6) return absl::StrFormat("%.*e", digits - 1, value);
  return absl::StrFormat("%.*f", std::max(0, digits - 1 - magnitude), value);
}

std::string html_paragraph(const std::string& text) {
  return absl::StrFormat("<p>%s</p>\n", html_escaped(text));
}

Cell text_cell(const std::string& text) { return {.text = html_escaped(text)}; }

Cell number_cell(const Json& number, int digits) {
  const std::string text = number.is_number_integer() ? number.dump() : short_number(number, digits);
  return {.text = html_escaped(text), .number = true, .bad = number.is_string()};
}

std::string HtmlTable::html() const {
  std::string html = "<div class=\"wide\"><table>";
  if (!heads_.empty()) html += "<thead><tr>";
  for (size_t i = 0; i < heads_.size(); ++i) {
    const bool number = std::any_of(rows_.begin(), rows_.end(),
                                    [i](const auto& row) { return i < row.size() && row[i].number; });
    absl::StrAppendFormat(&html, "<th%s>%s</th>", number ? " class=\"n\"" : "", html_escaped(heads_[i]));
  }
  if (!heads_.empty()) html += "</tr></thead>";
  html += "\n<tbody>\n";
  for (const std::vector<Cell>& row : rows_) {
    html += "<tr>";
    for (const Cell& cell : row) {
      const std::string kind = absl::StrFormat("%s%s", cell.number ? "n" : "", cell.bad ? " bad" : "");
      absl::StrAppendFormat(
          &html, "<td%s%s>%s</td>", kind.empty() ? "" : absl::StrFormat(" class=\"%s\"", kind),
          cell.columns > 1 ? absl::StrFormat(" colspan=\"%d\"", cell.columns) : "", cell.text);
    }
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

}  // namespace candela
