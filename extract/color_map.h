// The colours of values, levels and components, and the two ways of writing down a colour.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <glm/vec3.hpp>
#include <string_view>

namespace isobrick {

// The sRGB curve (IEC 61966-2-1): linear light 0..1 to screen values 0..1; others are clipped, and
// NaN is black.
inline float srgbFromLinear(float linear) {
  if (!(linear > 0.0f)) return 0.0f;
  if (linear >= 1.0f) return 1.0f;
  return linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1.0f / 2.4f) - 0.055f;
}

// The inverse of the sRGB curve, for values 0..1.
inline float linearFromSrgb(float srgb) {
  return srgb <= 0.04045f ? srgb / 12.92f : std::pow((srgb + 0.055f) / 1.055f, 2.4f);
}

// Each but the diverging one gets lighter in even steps, to eyes that confuse colours too.
//
// Viridis and inferno (N. J. Smith and S. van der Walt, 2015), cividis (Nuñez, Anderton and
// Renslow, 2018) and cool to warm (K. Moreland, 2009, diverging: its middle is a light grey) as in
// matplotlib, at 17 places.
enum class ColorMap {
  kViridis,   // dark violet, green, yellow
  kCividis,   // blue, grey, yellow
  kInferno,   // black, red, yellow
  kCoolWarm,  // blue, grey, red
  kGrey,      // black to white
};
// Their names in files and on command lines, in this order.
inline constexpr std::array<std::string_view, 5> kColorMapNames{"viridis", "cividis", "inferno",
                                                                "cool_warm", "grey"};

// In even steps from the first to the last.
inline constexpr std::size_t kColorMapPlaces = 17;

// The colours at these places, linear light; between them light is mixed, by shaders too.
const std::array<glm::vec3, kColorMapPlaces>& colorsOf(ColorMap map);

// The colour of a share 0 .. 1 of the values, sRGB.
glm::vec3 valueColor(ColorMap map, double share);

// The colour (sRGB 0..1) of a pyramid level: red for 0, then through yellow and green to blue and
// violet for coarser ones; levels past the last distinct colour share it.
glm::vec3 levelColor(int level);

// How many colours components have; then they come again.
inline constexpr std::size_t kComponentColorCount = 7;

// The colour (sRGB 0..1) of a component by its place in a list, the largest one's first: orange,
// sky blue, bluish green, yellow, blue, vermilion, reddish purple. They stay apart to colour-blind
// eyes (M. Okabe and K. Ito, Color Universal Design, 2008, without its black).
glm::vec3 componentColor(std::size_t place);

}  // namespace isobrick
