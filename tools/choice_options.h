// The options for the surface's detail at each place: the query's own, or a further choice.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "isobrick/extract/query.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Degrees, from corner to corner of a picture whose field of view is not given.
inline constexpr double kDefaultFieldOfView = 90;

struct ChoiceOptions {
  std::optional<glm::dvec3> focus;  // in voxels, or millimetres of the world
  std::optional<double> radius;     // likewise
  bool focus_in_world = false, radius_in_world = false;
  bool eye_has_unit = false;  // or --look-at, or --field-radius
  std::optional<int> level;
  std::optional<double> curvature_tolerance;
  std::optional<double> curvature_radius;
  std::optional<glm::dvec3> eye;
  std::optional<double> pixels_per_radian, pixels_per_unit, pixels;
  std::optional<glm::dvec3> look_at;
  std::optional<double> field_of_view;  // degrees
  std::optional<double> field_radius;
};

void addChoiceOptions(CLI::App& app, ChoiceOptions& options);

// True if they choose level 0 everywhere: nothing but, at most, the level.
bool isFinest(const ChoiceOptions& options);

// A further choice in words: "focus=10,20,30 radius=5 curvature=0.01", the options' names without
// their dashes. Throws std::invalid_argument with the reason.
ChoiceOptions parseChoice(const std::string& text);

// `world`: the focus and its radius are in world units, whatever they say. Throws Error for
// millimetres of a volume whose unit is unknown.
DetailChoice makeChoice(const ChoiceOptions& options, bool world, const Pyramid& pyramid);

// Throws Error if the volume's unit is unknown; `option` was given with a unit.
void refuseUnitOfUnknown(const GridGeometry& geometry, const char* option);

}  // namespace isobrick
