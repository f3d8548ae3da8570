// What is written into a picture: a scale bar, the world's axes, a legend, marks, a sphere.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/color_map.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// What the colours of a picture mean. Colours are sRGB values 0..1.
struct PictureLegend {
  // A colour and what it stands for.
  struct Patch {
    glm::vec3 color{0.0f};  // sRGB, 0..1
    std::string text;       // UTF-8
  };
  std::vector<Patch> patches;  // surfaces, levels or pieces
  std::string rest;            // a line below them, UTF-8; empty: there is none
  // The values of the first and the last colour of a ramp; none: there is no ramp.
  std::optional<std::array<double, 2>> ramp;
  ColorMap ramp_colors = ColorMap::kViridis;  // of the ramp
  std::string ramp_title;                     // over the ramp, UTF-8
};

// Points of the scene joined by lines, in front of everything, and a text at the last one.
struct PictureMark {
  std::vector<glm::dvec3> points;  // world
  std::string text;                // UTF-8
};

// All of a size that goes with the picture's.
struct PictureNotes {
  bool scale_bar = false;                  // lower right: a length at the middle of what is framed
  bool axes = false;                       // lower left: the directions of the world's x, y and z
  bool legend = false;                     // upper left
  LengthUnit unit = LengthUnit::kUnknown;  // of the world
  PictureLegend meaning;                   // for the legend
  std::vector<PictureMark> marks;          // measurements

  // True if there is something to draw.
  bool any() const { return scale_bar || axes || legend || !marks.empty(); }
};

// A sphere whose outline is a part of a picture.
struct SphereOutline {
  glm::dvec3 center{0.0};  // world units
  double radius = 0.0;     // world units, > 0

  bool operator==(const SphereOutline&) const = default;  // equal in all
};

}  // namespace isobrick
