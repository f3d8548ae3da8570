// The object that --json prints.
#pragma once

#include <cstdio>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <string>

#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// Keys stay in the order in which they were put. An object begins as Json::object(): a null that
// becomes one when its first key is put would be destroyed wrongly if memory ran out just then.
using Json = nlohmann::ordered_json;

inline Json jsonOf(const Index3& v) { return {v.x, v.y, v.z}; }
inline Json jsonOf(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

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
