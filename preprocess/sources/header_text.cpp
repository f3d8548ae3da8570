#include "isobrick/preprocess/sources/header_text.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/grid.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// Longer headers than this are not headers.
constexpr std::size_t kMostLines = 10'000;
constexpr std::size_t kMostLineCharacters = 100'000;

// A line without its end, or nothing at the end of the file (or of patience).
std::optional<std::string> readLine(std::istream& in) {
  std::string line;
  for (int c = in.get(); c != std::char_traits<char>::eof(); c = in.get()) {
    if (c == '\n') {
      if (!line.empty() && line.back() == '\r') line.pop_back();
      return line;
    }
    if (line.size() == kMostLineCharacters) return std::nullopt;
    line += static_cast<char>(c);
  }
  if (line.empty()) return std::nullopt;
  return line;
}

std::string trimmed(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::optional<std::uint64_t> positionOf(std::istream& in) {
  if (!in) return std::nullopt;
  const std::streamoff position = in.tellg();
  if (position < 0) return std::nullopt;
  return static_cast<std::uint64_t>(position);
}

bool isList(const std::string& data_file) { return data_file.starts_with("LIST"); }

std::vector<std::string> linesLeft(std::istream& in) {
  std::vector<std::string> lines;
  while (lines.size() < static_cast<std::size_t>(kMaxVoxelsPerAxis)) {
    const auto line = readLine(in);
    if (!line) break;
    if (!trimmed(*line).empty()) lines.push_back(trimmed(*line));
  }
  return lines;
}

// As large as the libraries', which is an int.
std::optional<std::int64_t> wholeNumber(const std::string& text) {
  return numberIn<std::int32_t>(text);
}

// Names from `first` to `last`, or until there are `most`.
std::vector<std::string> numberedNames(const NumberedName& pattern, std::int64_t first,
                                       std::int64_t last, std::int64_t step, std::size_t most) {
  std::vector<std::string> names;
  for (std::int64_t i = first; names.size() < most && (step > 0 ? i <= last : i >= last); i += step)
    names.push_back(pattern.of(i));
  return names;
}

// The libraries would make or try every one of the names.
bool isEndless(std::int64_t first, std::int64_t last, std::int64_t step) {
  return std::abs((last - first) / step) >= kMaxVoxelsPerAxis;
}

Error badPattern(const std::string& header_path, const std::string& pattern) {
  return unusable(
      header_path, "its data files '", pattern.substr(0, 100),
      "' are not a name with one number, as in 'slice%03d.raw 1 9 1'; correct its header");
}

// Files of an array if each has so many whole axes.
std::int64_t piecesOf(const std::vector<std::int64_t>& sizes, std::int64_t whole_axes) {
  std::int64_t pieces = 1;
  for (auto i = static_cast<std::size_t>(whole_axes); i < sizes.size(); ++i)
    pieces = std::min(kMaxVoxelsPerAxis * 2, pieces * std::min(sizes[i], kMaxVoxelsPerAxis));
  return pieces;
}

// Relative to the header; as many as there are to be.
std::vector<std::string> besideHeaderAll(const std::string& header_path,
                                         std::vector<std::string> names, std::int64_t pieces) {
  if (std::ssize(names) != pieces)
    throw unusable(header_path, "it names ", names.size(), " data files, and its sizes need ",
                   pieces, "; correct its header");
  for (std::string& name : names) name = besideHeader(header_path, name);
  return names;
}

}  // namespace

std::string HeaderText::value(const std::string& name) const {
  const auto found = fields.find(name);
  return found == fields.end() ? "" : found->second;
}

Error HeaderText::wrong(const std::string& path, const std::string& field, const std::string& text,
                        const std::string& what) {
  return unreadable(path, "its ", field, " ", quotedText(text, 60), " ", what,
                    "; correct its header, or get the whole file again");
}

std::uint64_t HeaderText::endIn(const std::string& path) const {
  if (!end) throw unreadable(path, "it ends within its header; get the whole file again");
  return *end;
}

std::string besideHeader(const std::string& header_path, const std::string& name) {
  return (std::filesystem::path(header_path).parent_path() / name).string();
}

std::optional<HeaderText> readNrrdHeader(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::string magic(7, '\0');
  if (!in.read(magic.data(), 7) || magic != "NRRD000" || !readLine(in)) return std::nullopt;
  HeaderText header;
  for (std::size_t lines = 0; lines < kMostLines; ++lines) {
    const auto line = readLine(in);
    if (!line) break;
    if (line->empty()) {
      header.end = positionOf(in);
      break;
    }
    const std::size_t colon = line->find(": ");
    if (line->front() == '#' || colon == std::string::npos) continue;
    std::string name = lowercase(line->substr(0, colon));
    std::erase(name, ' ');
    header.fields[name] = trimmed(line->substr(colon + 2));
    if (name == "datafile" && isList(header.fields[name])) {
      header.listed = linesLeft(in);
      break;
    }
  }
  return header;
}

std::optional<HeaderText> readMetaImageHeader(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  HeaderText header;
  for (std::size_t lines = 0; lines < kMostLines; ++lines) {
    const auto line = readLine(in);
    if (!line) return std::nullopt;
    const std::size_t equals = line->find('=');
    if (equals == std::string::npos) continue;
    const std::string name = lowercase(trimmed(line->substr(0, equals)));
    header.fields[name] = trimmed(line->substr(equals + 1));
    if (name != "elementdatafile") continue;  // the last line of a header
    header.end = positionOf(in);
    if (isList(header.fields[name])) header.listed = linesLeft(in);
    return header;
  }
  return std::nullopt;
}

std::vector<std::string> nrrdDataFiles(const std::string& header_path, const HeaderText& header,
                                       const std::vector<std::int64_t>& sizes) {
  const std::int64_t axes = std::ssize(sizes);
  const std::string named = header.value("datafile");
  if (named.empty()) return {header_path};
  const std::vector<std::string> parts = wordsOf(named);
  // The number of axes behind it says how much of the array is in each file.
  const auto piecesBy = [&](std::size_t part) {
    const std::int64_t whole =
        part < parts.size() ? wholeNumber(parts[part]).value_or(0) : axes - 1;
    if (whole < 1 || whole > axes) throw badPattern(header_path, named);
    return piecesOf(sizes, whole);
  };
  if (isList(named)) return besideHeaderAll(header_path, header.listed, piecesBy(1));
  // All three numbers are required; without them it is one file with a strange name.
  if (named.find('%') == std::string::npos || parts.size() < 4)
    return {besideHeader(header_path, named)};
  const auto pattern = parseNumberedName(parts[0]);
  const auto first = wholeNumber(parts[1]), last = wholeNumber(parts[2]),
             step = wholeNumber(parts[3]);
  if (!pattern || !first || !last || !step || *step == 0 || isEndless(*first, *last, *step))
    throw badPattern(header_path, named);
  return besideHeaderAll(
      header_path,
      numberedNames(*pattern, *first, *last, *step, static_cast<std::size_t>(kMaxVoxelsPerAxis)),
      piecesBy(4));
}

std::vector<std::string> metaImageDataFiles(const std::string& header_path,
                                            const HeaderText& header,
                                            const std::vector<std::int64_t>& sizes) {
  const std::int64_t axes = std::ssize(sizes);
  const std::string named = header.value("elementdatafile");
  if (lowercase(named) == "local") return {header_path};
  const std::vector<std::string> parts = wordsOf(named);
  if (parts.empty())
    throw unusable(header_path, "its ElementDataFile names no file; correct its header");
  if (isList(named)) {
    // "LIST 2": pieces of two axes, which is the rule for a volume.
    const std::int64_t whole =
        parts.size() > 1 ? wholeNumber(parts[1]).value_or(axes - 1) : axes - 1;
    const std::int64_t count = piecesOf(sizes, std::clamp<std::int64_t>(whole, 1, axes));
    std::vector<std::string> names = header.listed;
    if (std::ssize(names) > count) names.resize(static_cast<std::size_t>(count));
    return besideHeaderAll(header_path, std::move(names), count);
  }
  if (named.find('%') == std::string::npos) return {besideHeader(header_path, named)};
  const auto pattern = parseNumberedName(parts[0]);
  const auto number = [&](std::size_t i, std::int64_t otherwise) {
    return i < parts.size() ? wholeNumber(parts[i]) : std::optional<std::int64_t>(otherwise);
  };
  const std::int64_t slices =
      std::clamp<std::int64_t>(piecesOf(sizes, axes - 1), 1, kMaxVoxelsPerAxis);
  const auto first = number(1, 1);
  const auto last = number(2, first.value_or(1) + slices - 1);
  const auto step = number(3, parts.size() == 3 && first && last ? (*last - *first) / slices : 1);
  if (!pattern || !first || !last || !step || *step <= 0 || isEndless(*first, *last, *step))
    throw badPattern(header_path, named);
  return besideHeaderAll(
      header_path, numberedNames(*pattern, *first, *last, *step, static_cast<std::size_t>(slices)),
      slices);
}

std::vector<std::string> wordsOf(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> result;
  for (std::string word; in >> word;) result.push_back(word);
  return result;
}

std::vector<std::string> quotedTexts(const std::string& text) {
  std::vector<std::string> result;
  for (std::size_t first = text.find('"'); first != std::string::npos;) {
    const std::size_t end = text.find('"', first + 1);
    if (end == std::string::npos) break;
    result.push_back(text.substr(first + 1, end - first - 1));
    first = text.find('"', end + 1);
  }
  return result;
}

std::optional<std::vector<double>> numbersOf(const std::string& text) {
  std::vector<double> numbers;
  for (const std::string& word : wordsOf(text)) {
    const auto number = numberIn<double>(word.starts_with('+') ? word.substr(1) : word);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::optional<std::vector<std::int64_t>> wholeNumbersOf(const std::string& text) {
  std::vector<std::int64_t> numbers;
  for (const std::string& word : wordsOf(text)) {
    const auto number = numberIn<std::int64_t>(word);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::optional<std::int64_t> wholeNumberOf(const std::string& text) {
  const auto numbers = wholeNumbersOf(text);
  return numbers && numbers->size() == 1 ? std::optional(numbers->front()) : std::nullopt;
}

}  // namespace isobrick
