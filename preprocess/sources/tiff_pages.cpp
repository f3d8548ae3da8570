#include "isobrick/preprocess/sources/tiff_pages.h"

#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/length_units.h"
#include "isobrick/preprocess/sources/tiff_directory.h"

namespace isobrick {
namespace {

// The text of OME grows with the planes of a file.
constexpr std::uint64_t kMostTextBytes = std::uint64_t{16} << 20;

// The tags that decide the size of a row; without a tag 1, or 0 for sizes.
struct PageForm {
  std::uint64_t width = 0, height = 0, bits = 1, samples = 1, planes = 1;
  bool operator==(const PageForm&) const = default;
};

// None: a smaller picture beside the pages.
std::optional<PageForm> formOf(const TiffDirectory& tiff, std::uint64_t page) {
  PageForm form;
  for (const TiffEntry& entry : tiff.entries(page)) {
    // Of bits for each sample their number is compared, too.
    const std::uint64_t value =
        entry.count == 1 ? tiff.wholeNumber(entry).value_or(0) : entry.count;
    if (entry.tag == 254 && value != 0) return std::nullopt;
    if (entry.tag == 256) form.width = value;
    if (entry.tag == 257) form.height = value;
    if (entry.tag == 258) form.bits = value;
    if (entry.tag == 277) form.samples = value;
    if (entry.tag == 284) form.planes = value;
  }
  return form;
}

}  // namespace

void checkTiffPages(const std::string& path) {
  const TiffDirectory tiff(path);
  std::optional<PageForm> first;
  for (const std::uint64_t page : tiff.pages()) {
    const std::optional<PageForm> form = formOf(tiff, page);
    if (!form) continue;
    if (!first) first = form;
    if (form != first)
      throw unusable(path,
                     "its pages differ in size or in their values; keep only those of one volume");
  }
}

void refuseMisreadTiff(const std::string& path, StoredType type) {
  const TiffDirectory tiff(path);
  std::uint64_t bits = 1, kind = 1;
  for (const TiffEntry& entry : tiff.entries(tiff.firstPage())) {
    if (entry.tag == 258) bits = tiff.wholeNumber(entry).value_or(0);
    if (entry.tag == 339) kind = tiff.wholeNumber(entry).value_or(0);
  }
  constexpr std::uint64_t kFloat = 3;
  const bool is_float = type == StoredType::kFloat32 || type == StoredType::kFloat64;
  if (bits <= 8 ||
      (bits == 8 * storedBytes(type) && is_float == (kind == kFloat) && (is_float || bits == 16)))
    return;
  throw unusable(path,
                 "its pictures of numbers of " + std::to_string(bits) +
                     " bits have a form that is not read (a palette, another corner first, or "
                     "pages that differ); save them as grey ones of one size");
}

namespace {

// The statements of the first page about lengths.
struct TiffResolution {
  int unit = 2;             // 1: none, 2: inch, 3: centimetre
  double x = 0, y = 0;      // pixels a unit; 0: not stated
  glm::dvec3 lsm_voxel{0};  // Zeiss LSM: its edges in metres; 0: not stated
  std::string description;  // no longer than descriptions usually are
};

TiffResolution tiffResolutionOf(const std::string& path) {
  const TiffDirectory tiff(path);
  TiffResolution result;
  for (const TiffEntry& entry : tiff.entries(tiff.firstPage())) {
    constexpr std::uint64_t kText = 2;
    constexpr std::uint64_t kLsmInfo = 34412, kVoxelAt = 40, kVoxelEnd = 64;
    if (entry.tag == 296) result.unit = static_cast<int>(tiff.wholeNumber(entry).value_or(2) & 3);
    if (entry.tag == kLsmInfo && entry.count >= kVoxelEnd)
      for (int axis = 0; axis < 3; ++axis)
        result.lsm_voxel[axis] = std::bit_cast<double>(
            tiff.number(entry.value_at + kVoxelAt + 8 * static_cast<std::uint64_t>(axis), 8));
    if (entry.tag == 282) result.x = tiff.realNumber(entry);
    if (entry.tag == 283) result.y = tiff.realNumber(entry);
    if (entry.tag == 270 && entry.type == kText && entry.count <= kMostTextBytes)
      result.description = tiff.text(entry.value_at, entry.count);
  }
  return result;
}

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
