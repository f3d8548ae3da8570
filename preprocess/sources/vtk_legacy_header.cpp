#include "isobrick/preprocess/sources/vtk_legacy_header.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <string_view>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
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
      for (int axis = 0; axis < 3; ++axis)
        header_.whole_extent += "0 " + std::to_string(count() - 1) + " ";
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
    const auto type = std::find_if(std::begin(kLegacyTypes), std::end(kLegacyTypes),
                                   [&](const LegacyType& known) { return known.name == lower; });
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
    return Error("cannot read '" + file_.path() + "': " + reason + " at byte " +
                     std::to_string(words_.at()) + "; save it as .vti with ParaView",
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
