#include "isobrick/preprocess/sources/header_text.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
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

std::vector<std::string> words(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> result;
  for (std::string word; in >> word;) result.push_back(word);
  return result;
}

// The texts between quotes.
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
      header_path,
      "its data files '" + pattern.substr(0, 100) +
          "' are not a name with one number, as in 'slice%03d.raw 1 9 1'; correct its header");
}

// The last of the volume's dimensions, multiplied with `more` of those before it.
std::size_t piecesOf(const std::string& dimensions, std::size_t more) {
  const std::vector<std::string> sizes = words(dimensions);
  std::int64_t pieces = 1;
  for (std::size_t i = 0; i <= more && i < sizes.size(); ++i)
    pieces = std::min(
        kMaxVoxelsPerAxis,
        pieces * std::clamp<std::int64_t>(wholeNumber(sizes[sizes.size() - 1 - i]).value_or(1), 1,
                                          kMaxVoxelsPerAxis));
  return static_cast<std::size_t>(pieces);
}

std::vector<std::string> headerAndNamed(const std::string& header_path,
                                        const std::vector<std::string>& names) {
  std::vector<std::string> files = {header_path};
  for (const std::string& name : names) files.push_back(besideHeader(header_path, name));
  return files;
}

}  // namespace

std::string HeaderText::value(const std::string& name) const {
  const auto found = fields.find(name);
  return found == fields.end() ? "" : found->second;
}

std::string besideHeader(const std::string& header_path, const std::string& name) {
  return (std::filesystem::path(header_path).parent_path() / name).string();
}

std::optional<HeaderText> readNrrdHeader(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  const auto magic = readLine(in);
  if (!magic || !magic->starts_with("NRRD000")) return std::nullopt;
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

std::vector<std::string> nrrdFiles(const std::string& header_path) {
  const auto header = readNrrdHeader(header_path);
  const std::string named = header ? header->value("datafile") : "";
  if (named.empty()) return {header_path};
  if (isList(named)) return headerAndNamed(header_path, header->listed);
  const std::vector<std::string> parts = words(named);
  // Teem requires all three numbers; without them it is one file with a strange name.
  if (named.find('%') == std::string::npos || parts.size() < 4)
    return headerAndNamed(header_path, {named});
  const auto pattern = parseNumberedName(parts[0]);
  const auto first = wholeNumber(parts[1]), last = wholeNumber(parts[2]),
             step = wholeNumber(parts[3]);
  if (!pattern || !first || !last || !step || *step == 0 || isEndless(*first, *last, *step))
    throw badPattern(header_path, named);
  return headerAndNamed(header_path, numberedNames(*pattern, *first, *last, *step,
                                                   static_cast<std::size_t>(kMaxVoxelsPerAxis)));
}

std::vector<std::string> metaImageFiles(const std::string& header_path) {
  const auto header = readMetaImageHeader(header_path);
  const std::string named = header ? header->value("elementdatafile") : "";
  if (named.empty() || lowercase(named) == "local") return {header_path};
  const std::vector<std::string> parts = words(named);
  const std::string sizes = header->value("dimsize");
  if (isList(named)) {
    // "LIST 2": pieces of two dimensions, which is the rule for a volume.
    const auto dimensions = static_cast<std::int64_t>(words(sizes).size());
    const std::int64_t whole =
        parts.size() > 1 ? wholeNumber(parts[1]).value_or(dimensions - 1) : dimensions - 1;
    std::vector<std::string> names = header->listed;
    const std::size_t most = piecesOf(sizes, static_cast<std::size_t>(std::clamp<std::int64_t>(
                                                 dimensions - whole - 1, 0, dimensions)));
    if (names.size() > most) names.resize(most);
    return headerAndNamed(header_path, names);
  }
  if (named.find('%') == std::string::npos) return headerAndNamed(header_path, {named});
  const auto pattern = parseNumberedName(parts[0]);
  const auto number = [&](std::size_t i, std::int64_t otherwise) {
    return i < parts.size() ? wholeNumber(parts[i]) : std::optional<std::int64_t>(otherwise);
  };
  const std::size_t slices = piecesOf(sizes, 0);
  const auto first = number(1, 1);
  const auto last = number(2, first.value_or(1) + static_cast<std::int64_t>(slices) - 1);
  const auto step = number(3, parts.size() == 3 && first && last
                                  ? (*last - *first) / static_cast<std::int64_t>(slices)
                                  : 1);
  if (!pattern || !first || !last || !step || *step <= 0 || isEndless(*first, *last, *step))
    throw badPattern(header_path, named);
  return headerAndNamed(header_path, numberedNames(*pattern, *first, *last, *step, slices));
}

std::array<std::string, 3> nrrdUnits(const std::string& header_path) {
  const auto header = readNrrdHeader(header_path);
  if (!header) return {};
  const auto axesOf = [](std::vector<std::string> units) -> std::array<std::string, 3> {
    // An axis of several values a voxel has no length.
    if (units.size() > 3)
      std::erase_if(units, [](const std::string& unit) {
        return unit.empty() || unit == "none" || unit == "???";
      });
    if (units.size() != 3) return {};
    return {units[0], units[1], units[2]};
  };
  if (header->fields.contains("spaceunits"))
    return axesOf(quotedTexts(header->value("spaceunits")));
  const std::string space = lowercase(header->value("space"));
  for (const char* known : {"left-posterior-superior", "right-anterior-superior",
                            "left-anterior-superior", "scanner-xyz", "lps", "ras", "las"})
    if (space == known) return {"mm", "mm", "mm"};
  return axesOf(quotedTexts(header->value("units")));
}

std::string metaImageUnit(const std::string& header_path) {
  const auto header = readMetaImageHeader(header_path);
  if (!header || !header->fields.contains("distanceunits")) return "mm";
  const std::string unit = header->value("distanceunits");
  return unit == "?" ? "" : unit;
}

}  // namespace isobrick
