#include "isobrick/extract/color_map.h"

#include <algorithm>
#include <cassert>
#include <cstdint>

namespace isobrick {
namespace {

using Places = std::array<std::uint32_t, kColorMapPlaces>;  // 0xrrggbb, sRGB

constexpr std::array<Places, 5> kColorMaps{{
    {0x440154, 0x48186a, 0x472d7b, 0x424086, 0x3b528b, 0x33638d, 0x2c728e, 0x26828e, 0x21918c,
     0x1fa088, 0x28ae80, 0x3fbc73, 0x5ec962, 0x84d44b, 0xaddc30, 0xd8e219, 0xfde725},
    {0x00224e, 0x002e6a, 0x1a386f, 0x32436d, 0x434e6c, 0x535a6d, 0x61656f, 0x6f7073, 0x7d7c78,
     0x8c8878, 0x9b9476, 0xaba072, 0xbcae6c, 0xcdbb63, 0xdec958, 0xf0d846, 0xfee838},
    {0x000004, 0x0b0724, 0x210c4a, 0x3d0965, 0x57106e, 0x71196e, 0x8a226a, 0xa32c61, 0xbc3754,
     0xd24644, 0xe45a31, 0xf1731d, 0xf98e09, 0xfcac11, 0xf9cb35, 0xf2ea69, 0xfcffa4},
    {0x3b4cc0, 0x4e68d8, 0x6282ea, 0x779af7, 0x8db0fe, 0xa3c2fe, 0xb9d0f9, 0xccd9ed, 0xdddcdc,
     0xecd3c5, 0xf5c4ac, 0xf7b093, 0xf4987a, 0xeb7d62, 0xdd5f4b, 0xca3b37, 0xb40426},
    {0x000000, 0x101010, 0x202020, 0x303030, 0x404040, 0x505050, 0x606060, 0x707070, 0x808080,
     0x8f8f8f, 0x9f9f9f, 0xafafaf, 0xbfbfbf, 0xcfcfcf, 0xdfdfdf, 0xefefef, 0xffffff},
}};

// Ordered by hue, in steps that stay apart for colour-blind eyes by their lightness as well.
constexpr std::array<glm::vec3, 8> kLevelColors{{
    {0.84f, 0.24f, 0.27f},  // red
    {0.96f, 0.55f, 0.25f},  // orange
    {0.97f, 0.84f, 0.42f},  // yellow
    {0.58f, 0.77f, 0.40f},  // green
    {0.24f, 0.66f, 0.62f},  // teal
    {0.24f, 0.51f, 0.80f},  // blue
    {0.38f, 0.34f, 0.70f},  // indigo
    {0.60f, 0.38f, 0.64f},  // violet
}};

constexpr std::array<std::uint32_t, kComponentColorCount> kComponentColors{
    0xe69f00, 0x56b4e9, 0x009e73, 0xf0e442, 0x0072b2, 0xd55e00, 0xcc79a7};  // 0xrrggbb, sRGB

std::array<std::array<glm::vec3, kColorMapPlaces>, kColorMaps.size()> linearColorMaps() {
  std::array<std::array<glm::vec3, kColorMapPlaces>, kColorMaps.size()> maps;
  const auto channel = [](std::uint32_t color, unsigned shift) {
    return linearFromSrgb(static_cast<float>(color >> shift & 0xff) / 255.0f);
  };
  for (std::size_t map = 0; map < maps.size(); ++map)
    for (std::size_t place = 0; place < kColorMapPlaces; ++place) {
      const std::uint32_t color = kColorMaps[map][place];
      maps[map][place] = {channel(color, 16), channel(color, 8), channel(color, 0)};
    }
  return maps;
}

}  // namespace

const std::array<glm::vec3, kColorMapPlaces>& colorsOf(ColorMap map) {
  static const auto maps = linearColorMaps();
  return maps[static_cast<std::size_t>(map)];
}

glm::vec3 valueColor(ColorMap map, double share) {
  const std::array<glm::vec3, kColorMapPlaces>& colors = colorsOf(map);
  const double place = std::clamp(share, 0.0, 1.0) * static_cast<double>(kColorMapPlaces - 1);
  const std::size_t low = std::min(static_cast<std::size_t>(place), kColorMapPlaces - 2);
  const auto part = static_cast<float>(place - static_cast<double>(low));
  const glm::vec3 light = (1.0f - part) * colors[low] + part * colors[low + 1];
  return {srgbFromLinear(light.r), srgbFromLinear(light.g), srgbFromLinear(light.b)};
}

glm::vec3 levelColor(int level) {
  assert(level >= 0);
  return kLevelColors[std::min(static_cast<std::size_t>(level), kLevelColors.size() - 1)];
}

glm::vec3 componentColor(std::size_t place) {
  const std::uint32_t color = kComponentColors[place % kComponentColors.size()];
  return glm::vec3(color >> 16 & 0xff, color >> 8 & 0xff, color & 0xff) / 255.0f;
}

}  // namespace isobrick
