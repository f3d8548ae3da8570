// Backgrounds of pictures to choose from.
#pragma once

#include <array>
#include <glm/vec3.hpp>

namespace isobrick {

struct Background {
  const char* name;
  glm::vec3 top, bottom;  // sRGB, 0..1
};

// For screens, for slides, and for print.
inline constexpr std::array<Background, 3> kBackgrounds{{
    {"dark", {0.36f, 0.38f, 0.41f}, {0.16f, 0.17f, 0.19f}},
    {"light", {0.96f, 0.97f, 0.98f}, {0.78f, 0.80f, 0.83f}},
    {"white", {1.0f, 1.0f, 1.0f}, {1.0f, 1.0f, 1.0f}},
}};

}  // namespace isobrick
