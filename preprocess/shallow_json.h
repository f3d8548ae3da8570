// JSON out of a file of unknown origin.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "isobrick/storage/nesting.h"

namespace isobrick {

// Discarded (is_discarded()) if the text is no JSON or is nested deeper than 32. `Json` is
// nlohmann::json or its ordered kin.
template <typename Json = nlohmann::json>
Json parseShallowJson(const std::string& text) {
  constexpr int kDeepest = 32;
  if (nestingDepth(text) > kDeepest) return Json(Json::value_t::discarded);
  return Json::parse(text, nullptr, false);
}

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
