// JSON out of a file of unknown origin.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace isobrick {

// Discarded (is_discarded()) if the text is no JSON or is nested deeper than 32: a parser, and any
// walk through the result, would take a stack as deep as that. `Json` is nlohmann::json or its
// ordered kin.
template <typename Json = nlohmann::json>
Json parseShallowJson(const std::string& text) {
  constexpr int kDeepest = 32;
  bool is_deep = false;
  const auto guard = [&](int depth, typename Json::parse_event_t, Json&) {
    is_deep = is_deep || depth > kDeepest;
    return !is_deep;
  };
  Json json = Json::parse(text, guard, false);
  return is_deep ? Json(Json::value_t::discarded) : json;
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
