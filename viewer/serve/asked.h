// What a client asks for by names: the members of a message, or the words of an address. Clients
// may be hostile.
#pragma once

#include <array>
#include <cstddef>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

class Asked {
 public:
  // Both throw Error, one line, as all members do, for other text.
  static Asked ofMessage(std::string_view text);
  // "iso=500&focus=1,2,3" is {"iso": 500, "focus": [1, 2, 3]}.
  static Asked ofAddress(std::string_view words);

  // Each is nothing if there is none of this name, or null. Throws Error, which has the name, for
  // one of another kind. Numbers are finite.
  std::optional<double> number(const char* name) const;
  std::optional<std::array<double, 2>> pair(const char* name) const;
  // Its coordinates are so small that squares and products are finite.
  std::optional<glm::dvec3> point(const char* name) const;
  // 1 to 8 of them, one after the other, of coordinates as those of points; none: empty.
  std::vector<glm::dvec4> quadruples(const char* name) const;
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
  using Members = nlohmann::json::object_t;
  explicit Asked(Members members) : members_(std::move(members)) {}
  template <typename T>
  std::optional<T> of(const char* name, const std::string& what) const;

  Members members_;
};

// Of a message or an answer; bytes that are no UTF-8 are replaced.
std::string jsonText(const nlohmann::ordered_json& json);

}  // namespace isobrick
