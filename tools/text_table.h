// Aligned columns of text.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

// A row of cells, a line each in text(). Widths count code points, as terminals show most scripts.
class TextTable {
 public:
  // `right_aligned` has an R for every column of numbers and an L for every other one: "LLR".
  explicit TextTable(std::string_view alignments) : alignments_(alignments) {}

  // As many cells as there are columns.
  void add(std::vector<std::string> cells) { rows_.push_back(std::move(cells)); }

  std::string text() const {
    std::vector<std::size_t> widths(alignments_.size(), 0);
    for (const auto& row : rows_)
      for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], width(row[i]));
    std::string all;
    for (const auto& row : rows_) {
      std::string line;
      for (std::size_t i = 0; i < row.size(); ++i) {
        const std::string gap(widths[i] - width(row[i]), ' ');
        line += (i > 0 ? "  " : "") + (alignments_[i] == 'R' ? gap + row[i] : row[i] + gap);
      }
      line.erase(line.find_last_not_of(' ') + 1);
      all += line + "\n";
    }
    return all;
  }

 private:
  static std::size_t width(std::string_view text) {
    std::size_t points = 0;
    for (const char c : text) points += (static_cast<unsigned char>(c) & 0xc0u) != 0x80u;
    return points;
  }

  std::string alignments_;
  std::vector<std::vector<std::string>> rows_;
};

}  // namespace isobrick
