#include "isobrick/preprocess/sources/vti_header.h"

#include <expat.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// Hostile files: tags are short, few, and not deep.
constexpr std::size_t kMostTagCharacters = 64 << 10;
constexpr std::size_t kMostTags = 100'000;
constexpr std::size_t kMostDepth = 64;
constexpr std::size_t kPieceBytes = 64 << 10;

// The attributes of an element, as Expat gives them: name, value, name, value, ..., null.
class Attributes {
 public:
  explicit Attributes(const XML_Char** pairs) : pairs_(pairs) {}
  // "" if there is no such attribute.
  std::string operator[](std::string_view key) const {
    for (const XML_Char** pair = pairs_; *pair != nullptr; pair += 2)
      if (key == pair[0]) return pair[1];
    return "";
  }

 private:
  const XML_Char** pairs_;
};

// Where the current tag begins, below zero if nowhere, and its length, in bytes. Expat 2.9 has them
// in 64 bits on every machine, and warns of those before.
std::int64_t tagAt(XML_Parser parser) {
#if XML_MAJOR_VERSION > 2 || XML_MINOR_VERSION >= 9
  return XML_GetCurrentByteIndex64(parser);
#else
  return XML_GetCurrentByteIndex(parser);
#endif
}
std::uint64_t tagBytes(XML_Parser parser) {
#if XML_MAJOR_VERSION > 2 || XML_MINOR_VERSION >= 9
  return XML_GetCurrentByteCount64(parser);
#else
  return static_cast<std::uint64_t>(XML_GetCurrentByteCount(parser));
#endif
}

// Expat calls back from C, which no exception may cross: an exception in a handler is kept, ends
// the parsing, and is thrown afterwards.
class VtiReader {
 public:
  explicit VtiReader(const InputFile& file) : file_(file), parser_(XML_ParserCreate(nullptr)) {
    if (!parser_) throw std::bad_alloc();
    XML_SetUserData(parser_.get(), this);
    XML_SetElementHandler(parser_.get(), onStart, onEnd);
    XML_SetStartDoctypeDeclHandler(parser_.get(), onDoctype);
  }

  VtiHeader read() {
    std::string piece;
    for (std::uint64_t fed = 0; !is_done_; fed += piece.size()) {
      piece.resize(kPieceBytes);
      piece.resize(file_.readAt(fed, piece.data(), kPieceBytes));
      const bool is_last = piece.empty();
      const XML_Status status =
          XML_Parse(parser_.get(), piece.data(), static_cast<int>(piece.size()), is_last);
      if (failure_) throw *failure_;
      if (status == XML_STATUS_ERROR && !is_done_) throw syntaxError(is_last);
      if (is_last && !is_done_) throw error(fed, "its XML is cut short");
      if (!is_done_ && fed + piece.size() > at() + kMostTagCharacters)
        throw error(at(), "its XML has a tag without an end");
    }
    if (is_appended_) findAppendedData();
    return std::move(header_);
  }

 private:
  struct Free {
    void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
  };

  static void onStart(void* self, const XML_Char* name, const XML_Char** attributes) {
    static_cast<VtiReader*>(self)->enter(name, Attributes(attributes));
  }
  static void onEnd(void* self, const XML_Char*) { static_cast<VtiReader*>(self)->leave(); }
  static void onDoctype(void* self, const XML_Char*, const XML_Char*, const XML_Char*, int) {
    static_cast<VtiReader*>(self)->fail("its XML has a declaration, which VTK never writes,");
  }

  void enter(std::string_view name, const Attributes& attributes) {
    if (is_done_ || failure_) return;
    if (++tags_ > kMostTags) return fail("its XML has too many tags");
    if (open_.size() == kMostDepth) return fail("its XML is too deep");
    take(name, attributes);
    open_.emplace_back(name);
  }

  void leave() {
    if (is_done_ || failure_) return;
    open_.pop_back();
    if (open_.empty()) stop();
  }

  // Keeps the attributes of interest; an element is recognised by the elements that it lies in.
  void take(std::string_view name, const Attributes& attributes) {
    if (isIn({})) {
      if (name != "VTKFile") return fail("it is no VTK file: its XML has no VTKFile");
      header_.file_type = attributes["type"];
      if (header_.file_type.empty()) return fail("its VTKFile has no type");
      header_.byte_order = attributes["byte_order"];
      header_.header_type = attributes["header_type"];
      header_.compressor = attributes["compressor"];
    } else if (isIn({"VTKFile"}) && (name == "ImageData" || name == "PImageData")) {
      header_.whole_extent = attributes["WholeExtent"];
      header_.origin = attributes["Origin"];
      header_.spacing = attributes["Spacing"];
      header_.direction = attributes["Direction"];
    } else if (isIn({"VTKFile", "ImageData"}) && name == "Piece") {
      header_.pieces.emplace_back().extent = attributes["Extent"];
    } else if (isIn({"VTKFile", "PImageData"}) && name == "Piece") {
      header_.pieces.push_back({attributes["Extent"], attributes["Source"], {}, {}});
    } else if (isIn({"VTKFile", "ImageData", "Piece"}) && name == "PointData") {
      header_.pieces.back().points.scalars = attributes["Scalars"];
    } else if (isIn({"VTKFile", "ImageData", "Piece"}) && name == "CellData") {
      header_.pieces.back().cells.scalars = attributes["Scalars"];
    } else if (isIn({"VTKFile", "ImageData", "Piece", "PointData"}) && name == "DataArray") {
      takeArray(attributes, header_.pieces.back().points);
    } else if (isIn({"VTKFile", "ImageData", "Piece", "CellData"}) && name == "DataArray") {
      takeArray(attributes, header_.pieces.back().cells);
    } else if (isIn({"VTKFile"}) && name == "AppendedData") {
      header_.appended_encoding = attributes["encoding"];
      if (header_.appended_encoding.empty())
        return fail("its AppendedData has no encoding or no data");
      // The bytes that follow are no XML.
      is_appended_ = true;
      header_.appended_at = tagEnd();
      stop();
    }
  }

  void takeArray(const Attributes& attributes, VtiPiece::Data& data) {
    VtiArray array;
    array.name = attributes["Name"];
    array.type = attributes["type"];
    array.format = attributes["format"];
    array.components = number(attributes, "NumberOfComponents", 1);
    array.offset = number(attributes, "offset", 0);
    array.text_at = tagEnd();
    data.arrays.push_back(std::move(array));
  }

  std::uint64_t number(const Attributes& attributes, const std::string& key,
                       std::uint64_t otherwise) {
    const std::string digits = attributes[key];
    if (digits.empty()) return otherwise;
    const auto value = numberIn<std::uint64_t>(digits);
    if (!value) fail("its " + key + " '" + digits.substr(0, 40) + "' is no number,");
    return value.value_or(0);
  }

  // Blanks may come before the '_' that the data begin behind.
  void findAppendedData() {
    static constexpr char kNoMark[] = "its appended data do not begin with '_'";
    std::array<char, 4096> piece;
    for (;;) {
      const std::size_t got = file_.readAt(header_.appended_at, piece.data(), piece.size());
      for (std::size_t i = 0; i < got; ++i, ++header_.appended_at) {
        if (std::string_view(" \t\r\n").find(piece[i]) != std::string_view::npos) continue;
        if (piece[i] != '_') throw error(header_.appended_at, kNoMark);
        ++header_.appended_at;
        return;
      }
      if (got == 0) throw error(header_.appended_at, kNoMark);
    }
  }

  bool isIn(std::initializer_list<std::string_view> path) const {
    return std::equal(open_.begin(), open_.end(), path.begin(), path.end());
  }

  // The bytes of the file at which the current tag begins and ends.
  std::uint64_t at() const {
    return static_cast<std::uint64_t>(std::max<std::int64_t>(0, tagAt(parser_.get())));
  }
  std::uint64_t tagEnd() const { return at() + tagBytes(parser_.get()); }

  void stop() {
    is_done_ = true;
    XML_StopParser(parser_.get(), XML_FALSE);
  }
  void fail(const std::string& reason) {
    if (!failure_) failure_ = error(at(), reason);
    XML_StopParser(parser_.get(), XML_FALSE);
  }
  Error syntaxError(bool is_last) const {
    const XML_Error code = XML_GetErrorCode(parser_.get());
    if (code == XML_ERROR_TAG_MISMATCH)
      return error(at(), "its XML ends an element that is not open");
    if (is_last) return error(at(), "its XML is cut short");
    return error(at(), std::string("its XML has a damaged tag (") + XML_ErrorString(code) + ")");
  }
  Error error(std::uint64_t at, const std::string& reason) const {
    return Error(concat("cannot read '", file_.path(), "': ", reason, " at byte ", at,
                        "; save it again with ParaView, or convert it to .nrrd or .mhd"),
                 {.path = file_.path(), .offset = at});
  }

  const InputFile& file_;
  std::unique_ptr<XML_ParserStruct, Free> parser_;
  std::vector<std::string> open_;  // the elements around the next tag
  std::size_t tags_ = 0;
  bool is_done_ = false;
  bool is_appended_ = false;
  std::optional<Error> failure_;
  VtiHeader header_;
};

}  // namespace

std::string inQuotes(const std::string& text) { return quotedText(text, 60); }

VtiHeader readVtiHeader(const InputFile& file) { return VtiReader(file).read(); }

namespace {

// A type of the format, as VTI calls it, and its bytes; bits are packed.
struct LegacyType {
  std::string_view name, xml_name;
  std::size_t bits;
};
constexpr LegacyType kLegacyTypes[] = {{"bit", "Bit", 1},
                                       {"unsigned_char", "UInt8", 8},
                                       {"char", "Int8", 8},
                                       {"signed_char", "Int8", 8},
                                       {"unsigned_short", "UInt16", 16},
                                       {"short", "Int16", 16},
                                       {"unsigned_int", "UInt32", 32},
                                       {"int", "Int32", 32},
                                       {"vtkidtype", "Int32", 32},
                                       {"unsigned_long", "UInt64", 64},
                                       {"long", "Int64", 64},
                                       {"vtktypeuint64", "UInt64", 64},
                                       {"vtktypeint64", "Int64", 64},
                                       {"float", "Float32", 32},
                                       {"double", "Float64", 64}};

// Words and lines of a file, by position.
class WordReader {
 public:
  explicit WordReader(const InputFile& file) : file_(file) {}

  std::uint64_t at() const { return begin_ + next_; }
  void seek(std::uint64_t at) {
    begin_ = at;
    next_ = 0;
    buffer_.clear();
  }

  // -1 at the end.
  int get() {
    if (next_ == buffer_.size()) {
      begin_ += buffer_.size();
      next_ = 0;
      buffer_.resize(kBufferBytes);
      buffer_.resize(file_.readAt(begin_, buffer_.data(), buffer_.size()));
      if (buffer_.empty()) return -1;
    }
    return static_cast<unsigned char>(buffer_[next_++]);
  }

  // The next word; empty at the end. It may be on another line.
  std::string word() {
    int c = get();
    while (c >= 0 && c <= ' ') c = get();
    std::string text;
    for (; c > ' '; c = get())
      if (text.size() < kMostCharacters) text += static_cast<char>(c);
    ended_line_ = c == '\n' || c < 0;
    return text;
  }
  // The rest of the line of the last word.
  std::string line() {
    std::string text;
    if (ended_line_) return text;
    for (int c = get(); c >= 0 && c != '\n'; c = get())
      if (c != '\r' && text.size() < kMostCharacters) text += static_cast<char>(c);
    ended_line_ = true;
    return text;
  }
  void skipLine() {
    ended_line_ = false;
    line();
  }
  // Up to an empty line.
  void skipParagraph() {
    line();
    for (;;) {
      ended_line_ = false;
      if (line().empty()) return;
    }
  }

 private:
  static constexpr std::size_t kBufferBytes = std::size_t{64} << 10;
  static constexpr std::size_t kMostCharacters = 4096;
  const InputFile& file_;
  std::string buffer_;
  std::uint64_t begin_ = 0;  // of the buffer, in the file
  std::size_t next_ = 0;
  bool ended_line_ = false;
};

std::string decodedName(const std::string& name) {
  std::string text;
  for (std::size_t i = 0; i < name.size(); ++i) {
    unsigned char c = 0;
    const char* const end = name.data() + std::min(i + 3, name.size());
    if (name[i] == '%' &&
        std::from_chars(name.data() + i + 1, end, c, 16).ptr == name.data() + i + 3) {
      text += static_cast<char>(c);
      i += 2;
    } else {
      text += name[i];
    }
  }
  return text;
}

class LegacyReader {
 public:
  explicit LegacyReader(const InputFile& file) : file_(file), words_(file) {}

  VtiHeader read() {
    words_.skipLine();  // "# vtk DataFile Version 4.2"
    words_.skipLine();  // a title
    const std::string how = lowercase(words_.word());
    if (how != "ascii" && how != "binary")
      throw error("its third line is neither ASCII nor BINARY");
    is_text_ = how == "ascii";
    header_.byte_order = "BigEndian";
    header_.pieces.emplace_back();
    for (std::string word = lowercase(words_.word()); !word.empty() && take(word);)
      word = lowercase(words_.word());
    if (header_.whole_extent.empty()) throw error("it has no DATASET STRUCTURED_POINTS");
    header_.pieces[0].extent = header_.whole_extent;
    return std::move(header_);
  }

 private:
  // False behind what is known.
  bool take(const std::string& word) {
    if (word == "dataset") {
      const std::string kind = words_.word();
      if (lowercase(kind) != "structured_points")
        throw error("it holds VTK's " + quotedText(kind, 40) + ", not STRUCTURED_POINTS");
      header_.file_type = "ImageData";
    } else if (word == "dimensions") {
      for (int axis = 0; axis < 3; ++axis) header_.whole_extent += concat("0 ", count() - 1, " ");
    } else if (word == "spacing" || word == "aspect_ratio") {
      header_.spacing = words_.line();
    } else if (word == "origin") {
      header_.origin = words_.line();
    } else if (word == "direction") {
      header_.direction = words_.line();
    } else if (word == "point_data" || word == "cell_data") {
      data_ = word == "point_data" ? &header_.pieces[0].points : &header_.pieces[0].cells;
      tuples_ = count();
    } else if (word == "scalars") {
      takeScalars();
    } else if (word == "vectors" || word == "normals") {
      const std::string name = words_.word();
      takeArray(name, 3, tuples_, words_.word());
    } else if (word == "lookup_table") {
      words_.word();
      skipValues(4 * count(), {"", "", 8});
    } else if (word == "field") {
      words_.word();
      for (std::int64_t arrays = count(); arrays > 0; --arrays) takeFieldArray();
    } else if (word == "metadata") {
      words_.skipParagraph();
    } else {
      return false;
    }
    return true;
  }

  // "SCALARS name type [components]" and "LOOKUP_TABLE name".
  void takeScalars() {
    const std::string name = words_.word(), type = words_.word();
    const auto components = numberIn<std::int64_t>(trimmed(words_.line()));
    if (lowercase(words_.word()) != "lookup_table") throw error("its SCALARS lack a LOOKUP_TABLE");
    words_.word();
    if (data_ != nullptr && data_->scalars.empty()) data_->scalars = decodedName(name);
    takeArray(name, components.value_or(1), tuples_, type);
  }

  void takeFieldArray() {
    std::string name = words_.word();
    if (lowercase(name) == "metadata") {
      words_.skipParagraph();
      name = words_.word();
    }
    const std::int64_t components = count(), tuples = count();
    takeArray(name, components, tuples, words_.word());
  }

  void takeArray(const std::string& name, std::int64_t components, std::int64_t tuples,
                 const std::string& type_name) {
    const std::string lower = lowercase(type_name);
    const auto type = std::ranges::find_if(
        kLegacyTypes, [&](const LegacyType& known) { return known.name == lower; });
    if (type == std::end(kLegacyTypes))
      throw error("its array " + quotedText(name, 40) + " is of the type " +
                  quotedText(type_name, 40) + ", which is unknown,");
    words_.line();
    VtiArray array;
    array.name = decodedName(name);
    array.type = type->xml_name;
    array.format = is_text_ ? "ascii" : "bare";
    array.components = static_cast<std::uint64_t>(components);
    array.text_at = words_.at();
    std::int64_t values = 0;
    if (components < 1 || __builtin_mul_overflow(components, tuples, &values))
      throw error("its array " + quotedText(name, 40) + " has no number of values");
    // Fields before the points are of the whole file.
    if (data_ != nullptr && tuples == tuples_) data_->arrays.push_back(std::move(array));
    skipValues(values, *type);
  }

  void skipValues(std::int64_t values, const LegacyType& type) {
    if (is_text_) {
      for (std::int64_t i = 0; i < values; ++i)
        if (words_.word().empty()) return;
      return;
    }
    words_.line();
    std::uint64_t bits = 0, end = 0;
    if (__builtin_mul_overflow(static_cast<std::uint64_t>(values), std::uint64_t{type.bits},
                               &bits) ||
        __builtin_add_overflow(words_.at(), bits / 8 + (bits % 8 != 0 ? 1 : 0), &end))
      throw error("an array is longer than any file");
    words_.seek(std::min(end, file_.size()));
  }

  std::int64_t count() {
    const std::string word = words_.word();
    const auto number = numberIn<std::int64_t>(word);
    if (!number || *number < 0)
      throw error("its " + quotedText(word, 40) + " is no number of values");
    return *number;
  }

  static std::string trimmed(const std::string& text) {
    const std::size_t first = text.find_first_not_of(' ');
    return first == std::string::npos ? ""
                                      : text.substr(first, text.find_last_not_of(' ') + 1 - first);
  }

  Error error(const std::string& reason) const {
    return Error(concat("cannot read '", file_.path(), "': ", reason, " at byte ", words_.at(),
                        "; save it as .vti with ParaView"),
                 {.path = file_.path(), .offset = words_.at()});
  }

  const InputFile& file_;
  WordReader words_;
  bool is_text_ = false;
  VtiPiece::Data* data_ = nullptr;  // of points or cells
  std::int64_t tuples_ = 0;         // of its arrays
  VtiHeader header_;
};

}  // namespace

VtiHeader readVtkLegacyHeader(const InputFile& file) { return LegacyReader(file).read(); }

}  // namespace isobrick
