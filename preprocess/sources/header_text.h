// Headers of NRRD and MetaImage files as text: their fields, and the files that they name. The
// libraries of these formats open every data file to read a header, pass its patterns on to printf
// and hold the whole volume, so they are not used. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace isobrick {

struct HeaderText {
  // By their names in lower case; names of NRRD without blanks: "data file" and "datafile" are one.
  std::map<std::string, std::string> fields;
  std::vector<std::string> listed;   // the lines behind a data file that is called LIST
  std::optional<std::uint64_t> end;  // the byte behind the header, if it has an end

  // The field's value, or "".
  std::string value(const std::string& name) const;
};

// Nothing if the file is no such header, or is too long for one. Never throw for its content.
std::optional<HeaderText> readNrrdHeader(const std::string& path);
std::optional<HeaderText> readMetaImageHeader(const std::string& path);

// The files that a header names for its voxels, LIST and patterns ("slice%03d.raw 1 9 1") included,
// in the order of their numbers; the header itself if they are in it. `pieces` says how many there
// are to be for a number of whole axes in each. Throw Error for another count, and for patterns
// that are not one whole number in a name.
using PiecesOf = std::function<std::int64_t(std::int64_t whole_axes)>;
std::vector<std::string> nrrdDataFiles(const std::string& header_path, const HeaderText& header,
                                       std::int64_t axes, const PiecesOf& pieces);
std::vector<std::string> metaImageDataFiles(const std::string& header_path,
                                            const HeaderText& header, std::int64_t axes,
                                            const PiecesOf& pieces);

// Between blanks.
std::vector<std::string> wordsOf(const std::string& text);
// The texts between quotes.
std::vector<std::string> quotedTexts(const std::string& text);
// The numbers of a field, or nothing if a word is none. 'nan' is one.
std::optional<std::vector<double>> numbersOf(const std::string& text);
std::optional<std::vector<std::int64_t>> wholeNumbersOf(const std::string& text);

// A name in a header is relative to the header's folder.
std::string besideHeader(const std::string& header_path, const std::string& name);

}  // namespace isobrick
