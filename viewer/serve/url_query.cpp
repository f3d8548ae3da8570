#include "isobrick/viewer/serve/url_query.h"

#include <charconv>
#include <cmath>
#include <cstddef>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

std::optional<int> digitOf(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return std::nullopt;
}

// "%2C" is ",".
std::string decoded(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      result += text[i];
      continue;
    }
    const auto high = i + 2 < text.size() ? digitOf(text[i + 1]) : std::nullopt;
    const auto low = high ? digitOf(text[i + 2]) : std::nullopt;
    if (!low) throw Error("the address has a '%' without two digits behind it");
    result += static_cast<char>(16 * *high + *low);
    i += 2;
  }
  return result;
}

}  // namespace

UrlQuery::UrlQuery(std::string_view words) {
  while (!words.empty()) {
    const std::string_view word = words.substr(0, words.find('&'));
    words.remove_prefix(std::min(words.size(), word.size() + 1));
    const std::size_t equals = word.find('=');
    if (equals == std::string_view::npos || equals == 0)
      throw Error("the address has a word that is not NAME=VALUE");
    if (!words_.emplace(decoded(word.substr(0, equals)), decoded(word.substr(equals + 1))).second)
      throw Error("the address has a word twice");
  }
}

std::string UrlQuery::text(const std::string& name) const {
  const auto found = words_.find(name);
  return found == words_.end() ? std::string() : found->second;
}

template <std::size_t N>
std::optional<std::array<double, N>> UrlQuery::numbers(const std::string& name) const {
  const auto found = words_.find(name);
  if (found == words_.end()) return std::nullopt;
  std::array<double, N> numbers{};
  const char *at = found->second.data(), *const end = at + found->second.size();
  for (std::size_t i = 0; i < N; ++i) {
    const auto read = std::from_chars(at, end, numbers[i]);
    const bool ends_well = i + 1 < N ? read.ptr != end && *read.ptr == ',' : read.ptr == end;
    if (read.ec != std::errc() || !ends_well || !std::isfinite(numbers[i]))
      throw Error("'" + name + "' is not " +
                  (N == 1 ? "a number" : std::to_string(N) + " numbers with commas"));
    at = read.ptr + 1;
  }
  return numbers;
}

std::optional<double> UrlQuery::number(const std::string& name, double least, double most) const {
  const auto number = numbers<1>(name);
  if (!number) return std::nullopt;
  if ((*number)[0] < least || (*number)[0] > most)
    throw Error("'" + name + "' is out of its bounds");
  return (*number)[0];
}

std::optional<int> UrlQuery::integer(const std::string& name, int least, int most) const {
  const auto value = number(name, least, most);
  if (!value) return std::nullopt;
  if (*value != std::floor(*value)) throw Error("'" + name + "' is not a whole number");
  return static_cast<int>(*value);
}

std::optional<std::array<double, 2>> UrlQuery::pair(const std::string& name) const {
  return numbers<2>(name);
}

std::optional<glm::dvec3> UrlQuery::point(const std::string& name) const {
  const auto point = numbers<3>(name);
  return point ? std::optional(glm::dvec3((*point)[0], (*point)[1], (*point)[2])) : std::nullopt;
}

std::string UrlQuery::normalized() const {
  std::string result;
  for (const auto& [name, value] : words_)
    result.append(name).append(1, '\0').append(value).append(1, '\0');
  return result;
}

std::optional<VolumePath> volumePathOf(std::string_view path) {
  constexpr std::string_view kBegin = "/api/volume/";
  if (path.substr(0, kBegin.size()) != kBegin) return std::nullopt;
  path.remove_prefix(kBegin.size());
  VolumePath result;
  const auto read = std::from_chars(path.data(), path.data() + path.size(), result.volume);
  if (read.ec != std::errc()) return std::nullopt;
  result.rest = path.substr(static_cast<std::size_t>(read.ptr - path.data()));
  if (!result.rest.empty() && result.rest.front() != '/') return std::nullopt;
  return result;
}

}  // namespace isobrick
