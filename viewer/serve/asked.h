// What a client asks for by names: the members of a message, or the words of an address. Clients
// may be hostile.
#pragma once

#include <array>
#include <cstddef>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

class Asked {
 public:
  // Throws Error, one line, as all members do, for what is no object.
  explicit Asked(nlohmann::json object);
  // "iso=500&focus=1,2,3" is {"iso": 500, "focus": [1, 2, 3]}. Throws Error for other text.
  static Asked ofAddress(std::string_view words);

  // Each is nothing if there is none of this name, or null. Throws Error, which has the name, for
  // one of another kind. Numbers are finite.
  std::optional<double> number(const char* name) const;
  std::optional<std::array<double, 2>> pair(const char* name) const;
  // Its coordinates are so small that squares and products are finite.
  std::optional<glm::dvec3> point(const char* name) const;
  std::optional<bool> flag(const char* name) const;
  std::optional<Asked> object(const char* name) const;
  std::string text(const char* name) const;  // empty: there is none

  // The same, and throws Error for a number beyond the bounds.
  std::optional<double> within(const char* name, double least, double most) const;
  std::optional<int> integer(const char* name, int least, int most) const;
  // The same, brought into the bounds.
  std::optional<double> clamped(const char* name, double least, double most) const;
  // Throws Error if there is none, too.
  double needed(const char* name, double least, double most) const;
  // 1 .. `most` objects.
  std::vector<Asked> objects(const char* name, std::size_t most) const;

  // One text for all orders of the words.
  std::string normalized() const;

 private:
  const nlohmann::json* find(const char* name) const;
  template <std::size_t N>
  std::optional<std::array<double, N>> numbers(const char* name) const;
  template <typename T>
  std::optional<T> of(const char* name, nlohmann::json::value_t type, const char* what) const;

  nlohmann::json members_;
};

// Of a message or an answer; bytes that are no UTF-8 are replaced.
std::string jsonText(const nlohmann::ordered_json& json);

}  // namespace isobrick
