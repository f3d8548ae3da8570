// Reading the JSON of Zarr, of which any member may be missing or of another type.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace isobrick {

// The member, or null.
inline const nlohmann::json& member(const nlohmann::json& json, const char* key) {
  static const nlohmann::json kNull;
  if (!json.is_object()) return kNull;
  const auto found = json.find(key);
  return found == json.end() ? kNull : *found;
}

// The string, or "".
inline std::string textOf(const nlohmann::json& json) {
  return json.is_string() ? json.get<std::string>() : std::string();
}

}  // namespace isobrick
