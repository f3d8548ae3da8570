#include "isobrick/preprocess/sources/tiff_lengths.h"

#include <array>
#include <charconv>
#include <cmath>
#include <optional>

#include "isobrick/preprocess/sources/length_units.h"
#include "isobrick/preprocess/sources/tiff_pages.h"

namespace isobrick {
namespace {

// What is said; 0 where nothing is.
struct TiffLengths {
  glm::dvec3 spacing{0.0};
  std::array<std::string, 3> units;
};

double positiveNumber(const std::string& text) {
  double number = 0;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number > 0 && std::isfinite(number) ? number : 0;
}

// What stands between `before` and `end`, or "".
std::string textBehind(const std::string& text, const std::string& before, char end) {
  const std::size_t at = text.find(before);
  if (at == std::string::npos) return "";
  const std::size_t first = at + before.size();
  const std::size_t last = text.find(end, first);
  return last == std::string::npos && end != '\n' ? "" : text.substr(first, last - first);
}

// The schema's unit is the micrometre where none is said.
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
