#include "isobrick/preprocess/sources/vti_header.h"

#include <expat.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"

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
    return Error("cannot read '" + file_.path() + "': " + reason + " at byte " +
                     std::to_string(at) +
                     "; save it again with ParaView, or convert it to .nrrd or .mhd",
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

Error cannotUseVti(const std::string& path, const std::string& reason) {
  return unusable(path, reason + "; save it again with ParaView, or convert it to .nrrd or .mhd");
}

VtiHeader readVtiHeader(const InputFile& file) { return VtiReader(file).read(); }

}  // namespace isobrick
