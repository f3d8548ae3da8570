#include "preprocess/sources/vti_header.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "storage/error.h"

namespace isobrick {
namespace {

// Hostile files: tags are short, few, and not deep.
constexpr std::size_t kMostTagCharacters = 64 << 10;
constexpr std::size_t kMostTags = 100'000;
constexpr std::size_t kMostDepth = 64;

bool isBlank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }
bool isNameCharacter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
         c == '-' || c == '.' || c == ':';
}

Error badXml(const InputFile& file, std::uint64_t at, const std::string& reason) {
  return Error("cannot read '" + file.path() + "': " + reason + " at byte " + std::to_string(at) +
               "; save it again with ParaView, or convert it to .nrrd or .mhd");
}

// The characters of a file, one after the other.
class Characters {
 public:
  explicit Characters(const InputFile& file) : file_(file) {}
  const InputFile& file() const { return file_; }
  // The byte of the file that next() gives.
  std::uint64_t at() const { return base_ + next_; }

  std::optional<char> next() {
    if (next_ == buffer_.size() && !refill()) return std::nullopt;
    return buffer_[next_++];
  }
  // Goes to the next '<', over anything; false where there is none.
  bool seekTag() {
    for (;;) {
      const std::size_t found = buffer_.find('<', next_);
      next_ = std::min(found, buffer_.size());
      if (found != std::string::npos) return true;
      if (!refill()) return false;
    }
  }

 private:
  bool refill() {
    constexpr std::size_t kPieceBytes = 64 << 10;
    base_ += buffer_.size();
    buffer_.resize(kPieceBytes);
    buffer_.resize(file_.readAt(base_, buffer_.data(), kPieceBytes));
    next_ = 0;
    return !buffer_.empty();
  }

  const InputFile& file_;
  std::string buffer_;
  std::uint64_t base_ = 0;  // of buffer_ in the file
  std::size_t next_ = 0;
};

struct Tag {
  std::string name;
  std::map<std::string, std::string> attributes;
  bool is_end = false;    // </name>
  bool is_empty = false;  // <name/>
  std::uint64_t at = 0;   // of its '<'

  std::string attribute(const std::string& key) const {
    const auto found = attributes.find(key);
    return found == attributes.end() ? "" : found->second;
  }
};

// Takes the text of a tag, without its angle brackets, apart.
class TagParser {
 public:
  TagParser(const InputFile& file, std::string_view text, std::uint64_t at)
      : file_(file), text_(text), at_(at) {}

  Tag parse() {
    Tag tag;
    tag.at = at_;
    tag.is_end = take('/');
    tag.name = name();
    for (skipBlanks(); next_ < text_.size() && !tag.is_empty; skipBlanks()) {
      if (take('/'))
        tag.is_empty = true;
      else
        attribute(tag);
    }
    const bool is_whole = next_ == text_.size() && !(tag.is_end && tag.is_empty) &&
                          !(tag.is_end && !tag.attributes.empty());
    if (!is_whole) throw bad();
    return tag;
  }

 private:
  void attribute(Tag& tag) {
    std::string key = name();
    skipBlanks();
    if (!take('=')) throw bad();
    skipBlanks();
    if (next_ == text_.size() || (text_[next_] != '"' && text_[next_] != '\'')) throw bad();
    const char quote = text_[next_++];
    const std::size_t end = text_.find(quote, next_);
    if (end == std::string_view::npos) throw bad();
    std::string value = unescaped(text_.substr(next_, end - next_));
    next_ = end + 1;
    if (!tag.attributes.emplace(std::move(key), std::move(value)).second) throw bad();
  }

  std::string name() {
    const std::size_t first = next_;
    while (next_ < text_.size() && isNameCharacter(text_[next_])) ++next_;
    if (next_ == first) throw bad();
    return std::string(text_.substr(first, next_ - first));
  }

  std::string unescaped(std::string_view text) const {
    static constexpr std::pair<std::string_view, char> kEntities[] = {
        {"&lt;", '<'}, {"&gt;", '>'}, {"&amp;", '&'}, {"&quot;", '"'}, {"&apos;", '\''}};
    std::string result;
    while (!text.empty()) {
      const auto* const entity =
          std::find_if(std::begin(kEntities), std::end(kEntities),
                       [&](const auto& e) { return text.starts_with(e.first); });
      const bool is_entity = entity != std::end(kEntities);
      // Others, as numbers, stay what they are: they occur in names only.
      result += is_entity ? entity->second : text.front();
      text.remove_prefix(is_entity ? entity->first.size() : 1);
    }
    return result;
  }

  bool take(char c) {
    if (next_ == text_.size() || text_[next_] != c) return false;
    ++next_;
    return true;
  }
  void skipBlanks() {
    while (next_ < text_.size() && isBlank(text_[next_])) ++next_;
  }
  Error bad() const { return badXml(file_, at_, "its XML has a damaged tag"); }

  const InputFile& file_;
  std::string_view text_;
  std::uint64_t at_;
  std::size_t next_ = 0;
};

class VtiReader {
 public:
  explicit VtiReader(const InputFile& file) : characters_(file) {}

  VtiHeader read() {
    std::size_t tags = 0;
    while (const auto tag = nextTag()) {
      if (++tags > kMostTags) throw bad(tag->at, "its XML has too many tags");
      if (tag->is_end)
        leave(*tag);
      else
        enter(*tag);
      if (!header_.appended_encoding.empty()) return std::move(header_);
      if (open_.empty() && !header_.file_type.empty()) return std::move(header_);
    }
    throw bad(characters_.at(), "its XML is cut short");
  }

 private:
  // Nothing at the end of the file. Comments and processing instructions are passed over.
  std::optional<Tag> nextTag() {
    while (characters_.seekTag()) {
      const std::uint64_t at = characters_.at();
      characters_.next();
      const std::string text = tagText(at);
      if (text.starts_with("?") || text.starts_with("!--")) continue;
      if (text.starts_with("!"))
        throw bad(at, "its XML has a declaration, which VTK never writes,");
      return TagParser(characters_.file(), text, at).parse();
    }
    return std::nullopt;
  }

  // Up to the '>' that ends the tag, without it.
  std::string tagText(std::uint64_t at) {
    std::string text;
    char quote = 0;
    for (;;) {
      const auto c = characters_.next();
      if (!c) throw bad(at, "its XML is cut short in a tag");
      const bool is_comment = text.starts_with("!--");
      if (*c == '>' && (is_comment ? text.size() >= 5 && text.ends_with("--") : quote == 0))
        return text;
      if (!is_comment && quote == 0 && (*c == '"' || *c == '\''))
        quote = *c;
      else if (*c == quote)
        quote = 0;
      if (text.size() == kMostTagCharacters) throw bad(at, "its XML has a tag without an end");
      text += *c;
    }
  }

  void enter(const Tag& tag) {
    take(tag);
    if (tag.is_empty) return;
    if (open_.size() == kMostDepth) throw bad(tag.at, "its XML is too deep");
    open_.push_back(tag.name);
  }

  void leave(const Tag& tag) {
    if (open_.empty() || open_.back() != tag.name)
      throw bad(tag.at, "its XML ends an element that is not open");
    open_.pop_back();
  }

  // Keeps what is of interest; an element is known by those that it lies in.
  void take(const Tag& tag) {
    const std::string& name = tag.name;
    if (isIn({})) {
      if (name != "VTKFile") throw bad(tag.at, "it is no VTK file: its XML has no VTKFile");
      header_.file_type = tag.attribute("type");
      if (header_.file_type.empty()) throw bad(tag.at, "its VTKFile has no type");
      header_.byte_order = tag.attribute("byte_order");
      header_.header_type = tag.attribute("header_type");
      header_.compressor = tag.attribute("compressor");
    } else if (isIn({"VTKFile"}) && name == "ImageData") {
      header_.whole_extent = tag.attribute("WholeExtent");
      header_.origin = tag.attribute("Origin");
      header_.spacing = tag.attribute("Spacing");
      header_.direction = tag.attribute("Direction");
    } else if (isIn({"VTKFile", "ImageData"}) && name == "Piece") {
      header_.piece_extents.push_back(tag.attribute("Extent"));
    } else if (isIn({"VTKFile", "ImageData", "Piece"}) && name == "PointData") {
      header_.scalars = tag.attribute("Scalars");
    } else if (isIn({"VTKFile", "ImageData", "Piece", "PointData"}) && name == "DataArray") {
      takeArray(tag);
    } else if (isIn({"VTKFile", "ImageData", "Piece", "CellData"}) && name == "DataArray") {
      header_.has_cell_arrays = true;
    } else if (isIn({"VTKFile"}) && name == "AppendedData") {
      takeAppended(tag);
    }
  }

  void takeArray(const Tag& tag) {
    VtiArray array;
    array.name = tag.attribute("Name");
    array.type = tag.attribute("type");
    array.format = tag.attribute("format");
    array.components = number(tag, "NumberOfComponents", 1);
    array.offset = number(tag, "offset", 0);
    array.text_at = characters_.at();
    header_.point_arrays.push_back(std::move(array));
  }

  std::uint64_t number(const Tag& tag, const std::string& key, std::uint64_t otherwise) const {
    const std::string text = tag.attribute(key);
    if (text.empty()) return otherwise;
    std::uint64_t value = 0;
    const char* const end = text.data() + text.size();
    const auto result = std::from_chars(text.data(), end, value);
    if (result.ec != std::errc() || result.ptr != end)
      throw bad(tag.at, "its " + key + " '" + text.substr(0, 40) + "' is no number,");
    return value;
  }

  void takeAppended(const Tag& tag) {
    header_.appended_encoding = tag.attribute("encoding");
    if (header_.appended_encoding.empty() || tag.is_empty)
      throw bad(tag.at, "its AppendedData has no encoding or no data");
    for (;;) {
      const std::uint64_t at = characters_.at();
      const auto c = characters_.next();
      if (c && *c == '_') break;
      if (!c || !isBlank(*c)) throw bad(at, "its appended data do not begin with '_'");
    }
    header_.appended_at = characters_.at();
  }

  bool isIn(std::initializer_list<std::string_view> path) const {
    return std::equal(open_.begin(), open_.end(), path.begin(), path.end());
  }
  Error bad(std::uint64_t at, const std::string& reason) const {
    return badXml(characters_.file(), at, reason);
  }

  Characters characters_;
  std::vector<std::string> open_;  // the elements around the next tag
  VtiHeader header_;
};

}  // namespace

VtiHeader readVtiHeader(const InputFile& file) { return VtiReader(file).read(); }

}  // namespace isobrick
