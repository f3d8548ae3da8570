// Text for people, and the words of lines that other programs print.
#pragma once

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

// "512 bytes", "1.50 GiB"; the bytes themselves are for --json.
std::string byteSizeText(std::uint64_t bytes);
// "1,234,567"
std::string countText(std::uint64_t count);

// The greatest memory that the process held at any moment so far, in bytes.
std::uint64_t peakResidentBytes();

// Takes a word and the space behind it off the line; false if it begins with another one.
inline bool takeWord(std::string_view& line, std::string_view word) {
  if (line.substr(0, word.size()) != word || line.substr(word.size(), 1) != " ") return false;
  line.remove_prefix(word.size() + 1);
  return true;
}

// The same for a number.
template <typename T>
bool takeNumber(std::string_view& line, T& number) {
  const auto read = std::from_chars(line.data(), line.data() + line.size(), number);
  if (read.ec != std::errc()) return false;
  return takeWord(line, line.substr(0, static_cast<std::size_t>(read.ptr - line.data())));
}

// Line breaks and other control characters become spaces.
inline std::string oneLine(std::string_view text) {
  std::string line(text);
  for (char& c : line)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

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
