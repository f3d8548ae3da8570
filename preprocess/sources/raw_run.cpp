#include "preprocess/sources/raw_run.h"

#include <cctype>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <map>

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

std::string lowercase(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

std::optional<std::uint64_t> unsignedNumber(const std::string& text) {
  std::uint64_t number = 0;
  const char* const end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, number);
  if (result.ec != std::errc() || result.ptr != end) return std::nullopt;
  return number;
}

// A name in a header is relative to the header's folder.
std::string besideHeader(const std::string& header_path, const std::string& name) {
  return (std::filesystem::path(header_path).parent_path() / name).string();
}

std::optional<std::uint64_t> positionOf(std::istream& in) {
  if (!in) return std::nullopt;
  const std::streamoff position = in.tellg();
  if (position < 0) return std::nullopt;
  return static_cast<std::uint64_t>(position);
}

// "LIST" and "slice%03d.raw 1 9 1" are several files. No name at all is one that cannot be opened:
// ITK would ask for all memory.
bool isOneFile(const std::string& name) {
  return !name.starts_with("LIST") && name.find('%') == std::string::npos;
}

}  // namespace

std::optional<RawRun> findNrrdRun(const std::string& header_path) {
  std::ifstream in(header_path, std::ios::binary);
  const auto magic = readLine(in);
  if (!magic || !magic->starts_with("NRRD000")) return std::nullopt;
  std::map<std::string, std::string> fields;
  bool has_blank_line = false;
  for (std::size_t lines = 0; lines < kMostLines && !has_blank_line; ++lines) {
    const auto line = readLine(in);
    if (!line) break;
    has_blank_line = line->empty();
    const std::size_t colon = line->find(": ");
    if (has_blank_line || line->front() == '#' || colon == std::string::npos) continue;
    std::string name = lowercase(line->substr(0, colon));
    std::erase(name, ' ');  // "data file" and "datafile" are one
    fields[name] = trimmed(line->substr(colon + 2));
  }
  const auto header_end = positionOf(in);

  const std::string encoding = lowercase(fields["encoding"]);
  RawRun run;
  run.header_path = header_path;
  run.is_deflated = encoding == "gzip" || encoding == "gz";
  if ((encoding != "raw" && !run.is_deflated) || fields["dimension"] != "3" ||
      fields.contains("lineskip"))
    return std::nullopt;
  run.big_endian = lowercase(fields["endian"]) == "big";
  if (fields.contains("byteskip")) {
    const auto skip = unsignedNumber(fields["byteskip"]);
    if (!skip) return std::nullopt;  // -1: counted from the end
    // The format skips bytes after it has inflated them.
    (run.is_deflated ? run.content_offset_bytes : run.offset_bytes) = *skip;
  }
  if (fields.contains("datafile")) {
    const std::string& name = fields["datafile"];
    if (!isOneFile(name)) return std::nullopt;
    run.path = besideHeader(header_path, name);
  } else {
    if (!has_blank_line || !header_end || run.offset_bytes + run.content_offset_bytes != 0)
      return std::nullopt;
    run.path = header_path;
    run.offset_bytes = *header_end;
  }
  return run;
}

std::optional<RawRun> findMetaImageRun(const std::string& header_path) {
  std::ifstream in(header_path, std::ios::binary);
  std::map<std::string, std::string> fields;
  for (std::size_t lines = 0; lines < kMostLines; ++lines) {
    const auto line = readLine(in);
    if (!line) return std::nullopt;
    const std::size_t equals = line->find('=');
    if (equals == std::string::npos) continue;
    const std::string name = lowercase(trimmed(line->substr(0, equals)));
    fields[name] = trimmed(line->substr(equals + 1));
    if (name == "elementdatafile") break;  // the last line of a header
  }
  const auto isTrue = [&](const std::string& name) {
    const std::string& value = fields[name];
    return !value.empty() && (value[0] == 'T' || value[0] == 't' || value[0] == '1');
  };
  if (!isTrue("binarydata") || fields["ndims"] != "3") return std::nullopt;
  RawRun run;
  run.header_path = header_path;
  run.is_deflated = isTrue("compresseddata");
  run.big_endian = isTrue("elementbyteordermsb") || isTrue("binarydatabyteordermsb");
  // Two fields that say the same, or that contradict each other.
  if (fields["elementbyteordermsb"] != fields["binarydatabyteordermsb"] &&
      !fields["elementbyteordermsb"].empty() && !fields["binarydatabyteordermsb"].empty())
    return std::nullopt;
  if (fields.contains("headersize")) {
    const auto skip = unsignedNumber(fields["headersize"]);
    if (!skip) return std::nullopt;  // -1: counted from the end
    run.offset_bytes = *skip;
  }
  const std::string& name = fields["elementdatafile"];
  if (lowercase(name) == "local") {
    const auto header_end = positionOf(in);
    if (!header_end || run.offset_bytes != 0) return std::nullopt;
    run.path = header_path;
    run.offset_bytes = *header_end;
  } else {
    if (!isOneFile(name)) return std::nullopt;
    run.path = besideHeader(header_path, name);
  }
  return run;
}

}  // namespace isobrick
