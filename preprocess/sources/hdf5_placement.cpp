#include "isobrick/preprocess/sources/hdf5_placement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/length_units.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

bool takeOwnAttributes(hid_t dataset, GridGeometry& geometry) {
  const auto spacing = Hdf5Attribute(dataset, "spacing").numbers(3);
  const auto origin = Hdf5Attribute(dataset, "origin").numbers(3);
  const auto direction = Hdf5Attribute(dataset, "direction").numbers(9);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int a = static_cast<int>(axis);
    if (!spacing.empty()) geometry.spacing[a] = spacing[axis];
    if (!origin.empty()) geometry.origin[a] = origin[axis];
    for (std::size_t row = 0; row < 3 && !direction.empty(); ++row)
      geometry.direction[a][static_cast<int>(row)] = direction[3 * axis + row];
  }
  if (!spacing.empty() &&
      Hdf5Attribute(dataset, "length_unit").text() == lengthUnitName(LengthUnit::kMillimetre))
    geometry.unit = LengthUnit::kMillimetre;
  return !spacing.empty();
}

// A number for every axis of the dataset, or for those of space, slowest first, or for the five
// that ilastik has: time, z, y, x, channel.
std::optional<glm::dvec3> elementSize(hid_t dataset, const Hdf5Axes& axes) {
  const auto sizes = Hdf5Attribute(dataset, "element_size_um").numbers();
  const bool has_all = sizes.size() == axes.fixed.size();
  if (!has_all && sizes.size() != 3 && sizes.size() != 5) return std::nullopt;
  std::array<std::size_t, 3> order = axes.of_space;
  std::sort(order.begin(), order.end());
  glm::dvec3 size;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t among =
        static_cast<std::size_t>(std::find(order.begin(), order.end(), axes.of_space[axis]) -
                                 order.begin()) +
        (sizes.size() == 5 ? 1 : 0);
    size[static_cast<int>(axis)] = sizes[has_all ? axes.of_space[axis] : among];
  }
  return size;
}

// Scales with a number for every element, in even steps.
bool takeScales(const Hdf5Axes& axes, const std::vector<Hdf5Scale>& scales, VolumeInfo& info) {
  if (scales.empty()) return false;
  GridGeometry geometry = info.geometry;
  std::array<std::string, 3> units;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Hdf5Scale& scale = scales[axes.of_space[axis]];
    const int a = static_cast<int>(axis);
    if (static_cast<std::int64_t>(scale.values.size()) != info.voxels[a]) return false;
    const double first = scale.values.front();
    const double step =
        (scale.values.back() - first) / static_cast<double>(scale.values.size() - 1);
    double furthest = 0;
    for (std::size_t i = 0; i < scale.values.size(); ++i)
      furthest =
          std::max(furthest, std::abs(scale.values[i] - (first + step * static_cast<double>(i))));
    constexpr double kMostVoxels = 0.01;
    if (!(furthest <= kMostVoxels * std::abs(step)))
      throw Error("cannot use '" + info.source + "': the steps of its axis " +
                      quotedText(scale.name, 40) + " are uneven, up to " +
                      shortText(furthest / std::abs(step)) +
                      " voxels off; give it a spacing, or resample it to even steps",
                  {.path = splitHdf5Name(info.source).first});
    geometry.spacing[a] = step;
    geometry.origin[a] = first;
    units[axis] = scale.units;
  }
  info.geometry = geometry;
  takeLengthUnits(units, info.geometry, info.notes);
  return true;
}

bool takeResolutions(const Hdf5Axes& axes, GridGeometry& geometry) {
  if (axes.resolutions.empty()) return false;
  glm::dvec3 steps;
  for (std::size_t axis = 0; axis < 3; ++axis)
    steps[static_cast<int>(axis)] = axes.resolutions[axes.of_space[axis]];
  if (!(steps.x > 0 && steps.y > 0 && steps.z > 0)) return false;
  geometry.spacing = steps;
  return true;
}

}  // namespace

void placeHdf5(hid_t dataset, const Hdf5Choice& choice, const Hdf5Axes& axes,
               const std::vector<Hdf5Scale>& scales, bool is_spacing_given, VolumeInfo& info) {
  const auto takeMicrometres = [&] {
    const auto size = elementSize(dataset, axes);
    if (size) info.geometry.spacing = *size;
    if (size) takeLengthUnits({"um", "um", "um"}, info.geometry, info.notes);
    return size.has_value();
  };
  if (takeOwnAttributes(dataset, info.geometry)) {
  } else if (choice.geometry) {
    info.geometry = *choice.geometry;
    takeLengthUnits({choice.unit, choice.unit, choice.unit}, info.geometry, info.notes);
  } else if (!takeMicrometres() && !is_spacing_given && !takeScales(axes, scales, info) &&
             !takeResolutions(axes, info.geometry)) {
    info.notes.push_back("the dataset says no spacing; 1 was used");
  }
  tidyGeometry(splitHdf5Name(info.source).first, info.geometry, info.voxels, info.notes);
}

}  // namespace isobrick
