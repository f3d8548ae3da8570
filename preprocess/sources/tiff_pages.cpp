#include "isobrick/preprocess/sources/tiff_pages.h"

#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/length_units.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// The text of OME grows with the planes of a file.
constexpr std::uint64_t kMostTextBytes = std::uint64_t{16} << 20;
// Pages of a volume are its slices.
constexpr std::uint64_t kMostPages = std::uint64_t{1} << 20;

// Follows the list from page to page: a page begins with the number of its entries, and behind
// these is the offset of the next page.
class TiffPageList {
 public:
  explicit TiffPageList(const std::string& path) : file_(path) {}

  TiffResolution resolution() {
    const std::uint64_t page = begin();
    const std::uint64_t word = is_big_tiff_ ? 8 : 4, entry_bytes = is_big_tiff_ ? 20 : 12;
    const std::uint64_t entries = number(page, is_big_tiff_ ? 8 : 2);
    if (entries > file_.size() / entry_bytes) throw cutShort();
    TiffResolution result;
    for (std::uint64_t i = 0; i < entries; ++i) {
      const std::uint64_t at = page + (is_big_tiff_ ? 8 : 2) + i * entry_bytes;
      const std::uint64_t tag = number(at, 2), type = number(at + 2, 2);
      const std::uint64_t count = number(at + 4, word), value = at + 4 + word;
      constexpr std::uint64_t kText = 2, kShort = 3, kLong = 4;
      if (tag == 296 && (type == kShort || type == kLong))
        result.unit = static_cast<int>(number(value, type == kShort ? 2 : 4) & 3);
      constexpr std::uint64_t kLsmInfo = 34412, kVoxelAt = 40, kVoxelEnd = 64;
      if (tag == kLsmInfo && count >= kVoxelEnd)
        for (int axis = 0; axis < 3; ++axis)
          result.lsm_voxel[axis] = std::bit_cast<double>(
              number(number(value, word) + kVoxelAt + 8 * static_cast<std::uint64_t>(axis), 8));
      if (tag == 282) result.x = realNumber(type, value);
      if (tag == 283) result.y = realNumber(type, value);
      if (tag == 270 && type == kText && count <= kMostTextBytes) {
        result.description.resize(static_cast<std::size_t>(count));
        const std::uint64_t from = count <= word ? value : number(value, word);
        if (from > file_.size() ||
            file_.readAt(from, result.description.data(), result.description.size()) != count)
          throw cutShort();
      }
    }
    return result;
  }

  // The offset of the first page.
  std::uint64_t begin() {
    std::array<char, 2> order = {};
    if (file_.readAt(0, order.data(), order.size()) != order.size()) throw cutShort();
    big_endian_ = order[0] == 'M';
    is_big_tiff_ = number(2, 2) == 43;
    return number(is_big_tiff_ ? 8 : 4, is_big_tiff_ ? 8 : 4);
  }

  void check() {
    std::uint64_t page = begin();
    const std::uint64_t word = is_big_tiff_ ? 8 : 4, entry = is_big_tiff_ ? 20 : 12;
    for (std::uint64_t count = 0; page != 0; ++count) {
      if (count == kMostPages) throw cutShort();
      const std::uint64_t count_bytes = is_big_tiff_ ? 8 : 2;
      const std::uint64_t entries = number(page, count_bytes);
      if (entries > file_.size() / entry) throw cutShort();
      checkEntries(page + count_bytes, entries, entry);
      page = number(page + count_bytes + entries * entry, word);
    }
  }

 private:
  // The tags that decide the size of a row; without a tag 1, or 0 for sizes.
  struct Form {
    std::uint64_t width = 0, height = 0, bits = 1, samples = 1, planes = 1;
    bool operator==(const Form&) const = default;
  };

  void checkEntries(std::uint64_t first, std::uint64_t entries, std::uint64_t entry_bytes) {
    Form form;
    for (std::uint64_t i = 0; i < entries; ++i) {
      const std::uint64_t at = first + i * entry_bytes;
      // Behind the tag its type, how many values there are, and the value, if there is one.
      const std::uint64_t count_bytes = is_big_tiff_ ? 8 : 4;
      const std::uint64_t tag = number(at, 2), type = number(at + 2, 2);
      const std::uint64_t bytes = type == 3                    ? 2
                                  : type == 4                  ? 4
                                  : type == 16 && is_big_tiff_ ? 8
                                                               : 1;
      const std::uint64_t value = number(at + 4, count_bytes) == 1
                                      ? number(at + 4 + count_bytes, bytes)
                                      : number(at + 4, count_bytes);
      if (tag == 254 && value != 0) return;  // a smaller picture beside the pages
      if (tag == 256) form.width = value;
      if (tag == 257) form.height = value;
      if (tag == 258) form.bits = value;
      if (tag == 277) form.samples = value;
      if (tag == 284) form.planes = value;
    }
    if (!first_) first_ = form;
    if (form != *first_)
      throw unusable(file_.path(),
                     "its pages differ in size or in their values; keep only those of one volume");
  }

  // Two whole numbers or a floating one, in the entry if it has room for them; 0 for others.
  double realNumber(std::uint64_t type, std::uint64_t value_at) const {
    constexpr std::uint64_t kRational = 5, kFloat = 11, kDouble = 12;
    if (type == kFloat)
      return static_cast<double>(
          std::bit_cast<float>(static_cast<std::uint32_t>(number(value_at, 4))));
    if (type != kRational && type != kDouble) return 0;
    const std::uint64_t at = is_big_tiff_ ? value_at : number(value_at, 4);
    if (type == kDouble) return std::bit_cast<double>(number(at, 8));
    const auto over = static_cast<double>(number(at + 4, 4));
    return over == 0 ? 0 : static_cast<double>(number(at, 4)) / over;
  }

  // A number of `bytes` bytes in the file's order.
  std::uint64_t number(std::uint64_t offset, std::uint64_t bytes) const {
    std::array<unsigned char, 8> stored = {};
    if (offset > file_.size() || file_.readAt(offset, stored.data(), bytes) != bytes)
      throw cutShort();
    return loadUnsigned(stored.data(), bytes, big_endian_);
  }
  Error cutShort() const {
    return unreadable(
        file_.path(),
        "its list of pages leads out of the file, or has no end; get the whole file again");
  }

  InputFile file_;
  bool big_endian_ = false, is_big_tiff_ = false;
  std::optional<Form> first_;
};

}  // namespace

void checkTiffPages(const std::string& path) { TiffPageList(path).check(); }

TiffResolution tiffResolutionOf(const std::string& path) { return TiffPageList(path).resolution(); }

namespace {

// The lengths that the file states; 0 if it states none.
struct TiffLengths {
  glm::dvec3 spacing{0.0};
  std::array<std::string, 3> units;
};

double positiveNumber(const std::string& text) {
  double number = 0;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number > 0 && std::isfinite(number) ? number : 0;
}

// The text between `before` and `end`, or "".
std::string textBehind(const std::string& text, const std::string& before, char end) {
  const std::size_t at = text.find(before);
  if (at == std::string::npos) return "";
  const std::size_t first = at + before.size();
  const std::size_t last = text.find(end, first);
  return last == std::string::npos && end != '\n' ? "" : text.substr(first, last - first);
}

// The schema's unit is the micrometre if none is stated.
std::optional<TiffLengths> omeLengths(const std::string& description) {
  if (description.find("<OME") == std::string::npos) return std::nullopt;
  TiffLengths lengths;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string name = std::string(" PhysicalSize") + "XYZ"[axis];
    lengths.spacing[static_cast<int>(axis)] =
        positiveNumber(textBehind(description, name + "=\"", '"'));
    const std::string unit = textBehind(description, name + "Unit=\"", '"');
    lengths.units[axis] = unit.empty() ? "micrometer" : unit;
  }
  if (lengths.spacing.x == 0 || lengths.spacing.y == 0) return std::nullopt;
  if (lengths.spacing.z == 0) lengths.units[2] = lengths.units[0];
  return lengths;
}

TiffLengths lengthsOf(const TiffResolution& said) {
  if (const auto ome = omeLengths(said.description)) return *ome;
  if (const glm::dvec3& voxel = said.lsm_voxel;
      voxel.x > 0 && voxel.y > 0 && voxel.z > 0 && std::isfinite(voxel.x + voxel.y + voxel.z))
    return {voxel, {"meter", "meter", "meter"}};
  TiffLengths lengths;
  if (said.x > 0 && said.y > 0) lengths.spacing = {1 / said.x, 1 / said.y, 0};
  std::string unit = said.unit == 2 ? "inch" : said.unit == 3 ? "centimeter" : "";
  if (said.description.starts_with("ImageJ=")) {
    unit = textBehind(said.description, "\nunit=", '\n');
    if (unit == "pixel" || unit == "pixels") unit.clear();
    lengths.spacing.z = positiveNumber(textBehind(said.description, "\nspacing=", '\n'));
  }
  if (lengths.spacing.x > 0) lengths.units = {unit, unit, unit};
  return lengths;
}

}  // namespace

void takeTiffLengths(const std::string& path, GridGeometry& geometry,
                     std::vector<std::string>& notes) {
  const TiffLengths lengths = lengthsOf(tiffResolutionOf(path));
  if (lengths.spacing.x == 0) {
    geometry.spacing.x = geometry.spacing.y = 1;
    notes.emplace_back("the pixels have no distance; 1 was used");
  } else {
    geometry.spacing.x = lengths.spacing.x;
    geometry.spacing.y = lengths.spacing.y;
  }
  geometry.spacing.z = lengths.spacing.z;
  if (lengths.spacing.z == 0) {
    geometry.spacing.z = geometry.spacing.x;
    notes.emplace_back(kNoSliceDistance);
  }
  takeLengthUnits(lengths.units, geometry, notes);
}

}  // namespace isobrick
