// The little HTML that a report needs.
#pragma once

#include <string>
#include <vector>

#include "client/cli/report/session.h"

namespace candela {

std::string html_escaped(const std::string& text);

// Few digits, as a table wants them: 24.3, 1830, 0.000312, and 3.12e-05 where it is below 1e-4. What
// json_number made of an infinity comes as that word.
std::string short_number(const Json& number, int digits = 3);

std::string html_paragraph(const std::string& text);

// A cell of a table. `text` is taken as it is, so that it can hold markup: escape what is not.
struct Cell {
  std::string text;
  bool number = false;  // aligned to the right
  bool bad = false;     // stands out
  int columns = 1;
};
Cell text_cell(const std::string& text);  // escapes
Cell number_cell(const Json& number, int digits = 3);

class HtmlTable {
 public:
  // A column of numbers has its head on the right, too. Without heads there is no head row.
  explicit HtmlTable(std::vector<std::string> heads = {}) : heads_(std::move(heads)) {}

  void add(std::vector<Cell> cells) { rows_.push_back(std::move(cells)); }
  bool empty() const { return rows_.empty(); }
  std::string html() const;

 private:
  std::vector<std::string> heads_;
  std::vector<std::vector<Cell>> rows_;
};

}  // namespace candela
