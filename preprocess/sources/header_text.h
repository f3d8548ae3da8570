// Headers of NRRD and MetaImage files as text: their fields, and the files that they name. The
// libraries of these formats open every data file to read a header, pass its patterns on to printf
// and hold the whole volume, so they are not used. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

struct HeaderText {
  // By their names in lower case; names of NRRD without blanks: "data file" and "datafile" are one.
  std::map<std::string, std::string> fields;
  std::vector<std::string> listed;   // the lines behind a data file that is called LIST
  std::optional<std::uint64_t> end;  // the byte behind the header, if it has an end

  // The field's value, or "".
  std::string value(const std::string& name) const;
  // "cannot read 'PATH': its FIELD 'TEXT' WHAT; ..."
  static Error wrong(const std::string& path, const std::string& field, const std::string& text,
                     const std::string& what);
  // Throws Error if the header has no end.
  std::uint64_t endIn(const std::string& path) const;
};

// Nothing if the file is no such header, or is too long for one. Never throw for its content.
std::optional<HeaderText> readNrrdHeader(const std::string& path);
std::optional<HeaderText> readMetaImageHeader(const std::string& path);

// The files that a header names for its voxels, LIST and patterns ("slice%03d.raw 1 9 1") included,
// in the order of their numbers; the header itself if they are in it. Throw Error if there are not
// as many as an array of these `sizes` needs, and for patterns that are not one whole number in a
// name.
std::vector<std::string> nrrdDataFiles(const std::string& header_path, const HeaderText& header,
                                       const std::vector<std::int64_t>& sizes);
std::vector<std::string> metaImageDataFiles(const std::string& header_path,
                                            const HeaderText& header,
                                            const std::vector<std::int64_t>& sizes);

// Between blanks.
std::vector<std::string> wordsOf(const std::string& text);
// The texts between quotes.
std::vector<std::string> quotedTexts(const std::string& text);
// The numbers of a field, or nothing if a word is none. 'nan' is one.
std::optional<std::vector<double>> numbersOf(const std::string& text);
std::optional<std::vector<std::int64_t>> wholeNumbersOf(const std::string& text);
// The only number of a field.
std::optional<std::int64_t> wholeNumberOf(const std::string& text);

// A name in a header is relative to the header's folder.
std::string besideHeader(const std::string& header_path, const std::string& name);

}  // namespace isobrick
