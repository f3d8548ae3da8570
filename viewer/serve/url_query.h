// The target of a request: its path, and the words behind the question mark.
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace isobrick {

class UrlQuery {
 public:
  // "iso=500&focus=1,2,3". Throws Error for text that is no such words.
  explicit UrlQuery(std::string_view words);

  // Empty if it is not there.
  std::string text(const std::string& name) const;
  // Each throws Error, which names the word, if it is there and no such number, or not within the
  // bounds.
  std::optional<double> number(const std::string& name, double least, double most) const;
  std::optional<int> integer(const std::string& name, int least, int most) const;
  std::optional<std::array<double, 2>> pair(const std::string& name) const;
  std::optional<glm::dvec3> point(const std::string& name) const;

  // The same words in one order, for the same answer.
  std::string normalized() const;

 private:
  template <std::size_t N>
  std::optional<std::array<double, N>> numbers(const std::string& name) const;

  std::map<std::string, std::string> words_;
};

// The number of the volume and what is asked of it, for "/api/volume/12/slice.png"; nothing for
// another path.
struct VolumePath {
  std::size_t volume = 0;
  std::string_view rest;  // "/slice.png"
};
std::optional<VolumePath> volumePathOf(std::string_view path);

}  // namespace isobrick
