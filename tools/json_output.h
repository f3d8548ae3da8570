// The object that --json prints.
#pragma once

#include <cstdio>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <string>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// Keys stay in the order in which they were put. An object begins as Json::object(): a null that
// becomes one when its first key is put would be destroyed wrongly if memory ran out just then.
using Json = nlohmann::ordered_json;

// The formats of volumes, {"read": [...], "write": [...]}, as isobrick-build has them. Throws
// Error.
Json volumeFormats();

inline Json jsonOf(const Index3& v) { return {v.x, v.y, v.z}; }
inline Json jsonOf(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

// Puts the grid of a volume: voxels, their type and their place; a direction is the world's of the
// index axes x, y and z.
inline void putGrid(const Index3& voxels, VoxelType type, const GridGeometry& geometry,
                    Json& json) {
  json["dimensions"] = jsonOf(voxels);
  json["voxel_type"] = voxelTypeName(type);
  json["spacing"] = jsonOf(geometry.spacing);
  json["origin"] = jsonOf(geometry.origin);
  json["length_unit"] = lengthUnitName(geometry.unit);
  json["direction"] = Json::array();
  for (int axis = 0; axis < 3; ++axis)
    json["direction"].push_back(jsonOf(glm::dvec3(geometry.direction[axis])));
}

inline Json jsonOfLevels(const BrickLayout& layout) {
  Json levels = Json::array();
  for (int level = 0; level < layout.lattice().levels(); ++level)
    levels.push_back({{"level", level},
                      {"dimensions", jsonOf(layout.lattice().samples(level))},
                      {"bricks", elementCount(layout.bricks(level))}});
  return levels;
}

// The bytes of a pyramid, by kind.
inline Json jsonOfBytes(const PyramidBytes& bytes) {
  return {{"total", bytes.total},
          {"raw", bytes.raw},
          {"samples_level0", bytes.samples_level0},
          {"aprons_level0", bytes.aprons_level0},
          {"samples_coarser", bytes.samples_coarser},
          {"ranges", bytes.ranges},
          {"curvature", bytes.curvature},
          {"index", bytes.index}};
}

// Prints the object `json` on stdout, a line for every key. Paths need not be UTF-8, JSON must be.
inline void printJson(const Json& json) {
  const auto textOf = [](const Json& part) {
    return part.dump(-1, ' ', false, Json::error_handler_t::replace);
  };
  std::string text;
  for (const auto& [key, value] : json.items())
    text += (text.empty() ? "{\n  " : ",\n  ") + textOf(key) + ": " + textOf(value);
  text += "\n}\n";
  std::fwrite(text.data(), 1, text.size(), stdout);
}

}  // namespace isobrick
