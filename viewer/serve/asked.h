// What a client asks for by names: the members of a message, or the words of an address. Clients
// may be hostile.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

// A request that gets one line in place of what it asks for.
struct Refusal : Error {
  Refusal(unsigned to_status, const std::string& why) : Error(why), status(to_status) {}
  unsigned status;  // of HTTP
};

inline void require(bool is_so, unsigned status, const std::string& why) {
  if (!is_so) throw Refusal(status, why);
}

// All members throw Refusal with 400, which has the name, for a value of another kind.
class Asked {
 public:
  // Both throw it for other text.
  static Asked ofMessage(std::string_view text);
  // "iso=500&focus=1,2,3" is {"iso": 500, "focus": [1, 2, 3]}.
  static Asked ofAddress(std::string_view words);

  // Each is nothing if there is none of this name, or null. Numbers are finite.
  std::optional<double> number(const char* name) const { return of<double>(name, "a number"); }
  std::optional<std::array<double, 2>> pair(const char* name) const {
    return of<std::array<double, 2>>(name, "2 numbers");
  }
  // Its coordinates are so small that squares and products are finite.
  std::optional<glm::dvec3> point(const char* name) const;
  std::optional<bool> flag(const char* name) const { return of<bool>(name, "true or false"); }
  std::optional<Asked> object(const char* name) const {
    auto members = of<Members>(name, "an object");
    return members ? std::optional(Asked(std::move(*members))) : std::nullopt;
  }
  // Empty: there is none.
  std::string text(const char* name) const { return of<std::string>(name, "text").value_or(""); }

  // A number beyond the bounds is refused.
  std::optional<double> within(const char* name, double least, double most) const;
  std::optional<int> integer(const char* name, int least, int most) const;
  // A number is brought into the bounds.
  std::optional<double> clamped(const char* name, double least, double most) const {
    const auto value = number(name);
    return value ? std::optional(std::clamp(*value, least, most)) : std::nullopt;
  }
  // The same, and refused if there is none.
  double needed(const char* name, double least, double most) const;
  // 1 .. `most` objects.
  std::vector<Asked> objects(const char* name, std::size_t most) const;

  // One text for all orders of the words.
  std::string normalized() const;

 private:
  using Members = nlohmann::json::object_t;
  explicit Asked(Members members) : members_(std::move(members)) {}
  [[noreturn]] static void refuse(const char* name, const std::string& what) {
    throw Refusal(400, std::string("'") + name + "' is not " + what);
  }
  template <typename T>
  std::optional<T> of(const char* name, const std::string& what) const {
    const auto found = members_.find(name);
    if (found == members_.end() || found->second.is_null()) return std::nullopt;
    try {
      T value = found->second.template get<T>();
      if (nlohmann::json(value) == found->second) return value;  // nothing was left out or changed
    } catch (const nlohmann::json::exception&) {
    }
    refuse(name, what);
  }

  Members members_;
};

// The number of the volume and what is asked of it, for "/api/volume/12/slice.png"; nothing for
// another path.
struct VolumePath {
  std::size_t volume = 0;
  std::string_view rest;  // "/slice.png"
};
std::optional<VolumePath> volumePathOf(std::string_view path);

// Of a message or an answer; bytes that are no UTF-8 are replaced.
std::string jsonText(const nlohmann::ordered_json& json);

}  // namespace isobrick
