#include "isobrick/viewer/serve/asked.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <glm/common.hpp>
#include <glm/gtc/type_ptr.hpp>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/nesting.h"

namespace isobrick {
namespace {

using AskedJson = nlohmann::json;

constexpr double kFar = 1e12;

[[noreturn]] void refuseMember(const char* name, const std::string& what) {
  throw Error(std::string("'") + name + "' is not " + what);
}

// Discarded if it is no JSON.
AskedJson parsed(std::string_view text) {
  if (nestingDepth(text) > kMostNesting) throw Error("brackets are nested more than 16 deep");
  return AskedJson::parse(text, nullptr, false);
}

// "%2C" is ",".
std::string decoded(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      result += text[i];
      continue;
    }
    unsigned char byte = 0;
    const char* const end = text.data() + std::min(i + 3, text.size());
    const auto read = std::from_chars(text.data() + i + 1, end, byte, 16);
    if (read.ec != std::errc() || read.ptr != text.data() + i + 3)
      throw Error("the address has a '%' without two digits behind it");
    result += static_cast<char>(byte);
    i += 2;
  }
  return result;
}

// Numbers if it is some, else text.
AskedJson valueOf(const std::string& word) {
  const AskedJson list = parsed("[" + word + "]");
  if (list.is_discarded()) return word;
  return list.size() == 1 ? list.front() : list;
}

}  // namespace

Asked Asked::ofMessage(std::string_view text) {
  const AskedJson message = parsed(text);
  if (!message.is_object()) throw Error("there is something else in place of a JSON object");
  return Asked(message.get<Members>());
}

Asked Asked::ofAddress(std::string_view words) {
  Members members;
  while (!words.empty()) {
    const std::string_view word = words.substr(0, words.find('&'));
    words.remove_prefix(std::min(words.size(), word.size() + 1));
    const std::size_t equals = word.find('=');
    if (equals == std::string_view::npos || equals == 0)
      throw Error("the address has a word that is not NAME=VALUE");
    const std::string value = decoded(word.substr(equals + 1));
    if (!members.emplace(decoded(word.substr(0, equals)), valueOf(value)).second)
      throw Error("the address has a word twice");
  }
  return Asked(std::move(members));
}

template <typename T>
std::optional<T> Asked::of(const char* name, const std::string& what) const {
  const auto found = members_.find(name);
  if (found == members_.end() || found->second.is_null()) return std::nullopt;
  try {
    T value = found->second.get<T>();
    if (AskedJson(value) == found->second) return value;  // nothing was left out or changed
  } catch (const AskedJson::exception&) {
  }
  refuseMember(name, what);
}

std::optional<double> Asked::number(const char* name) const { return of<double>(name, "a number"); }

std::optional<std::array<double, 2>> Asked::pair(const char* name) const {
  return of<std::array<double, 2>>(name, "2 numbers");
}

std::optional<glm::dvec3> Asked::point(const char* name) const {
  const auto point = of<std::array<double, 3>>(name, "3 numbers");
  if (!point) return std::nullopt;
  return glm::clamp(glm::make_vec3(point->data()), glm::dvec3(-kFar), glm::dvec3(kFar));
}

std::vector<glm::dvec4> Asked::quadruples(const char* name) const {
  constexpr std::size_t kMost = 8;
  const std::string what = "4 numbers each of 1 to 8";
  const auto numbers = of<std::vector<double>>(name, what);
  if (!numbers) return {};
  if (numbers->empty() || numbers->size() % 4 != 0 || numbers->size() > 4 * kMost)
    refuseMember(name, what);
  std::vector<glm::dvec4> result;
  for (std::size_t i = 0; i < numbers->size(); i += 4)
    result.push_back(
        glm::clamp(glm::make_vec4(numbers->data() + i), glm::dvec4(-kFar), glm::dvec4(kFar)));
  return result;
}

std::optional<bool> Asked::flag(const char* name) const { return of<bool>(name, "true or false"); }

std::optional<Asked> Asked::object(const char* name) const {
  auto members = of<Members>(name, "an object");
  return members ? std::optional(Asked(std::move(*members))) : std::nullopt;
}

std::string Asked::text(const char* name) const {
  return of<std::string>(name, "text").value_or("");
}

std::optional<double> Asked::within(const char* name, double least, double most) const {
  const auto value = number(name);
  if (value && (*value < least || *value > most)) refuseMember(name, "within its bounds");
  return value;
}

std::optional<int> Asked::integer(const char* name, int least, int most) const {
  const auto value = within(name, least, most);
  if (!value) return std::nullopt;
  if (*value != std::floor(*value)) refuseMember(name, "a whole number");
  return static_cast<int>(*value);
}

std::optional<double> Asked::clamped(const char* name, double least, double most) const {
  const auto value = number(name);
  return value ? std::optional(std::clamp(*value, least, most)) : std::nullopt;
}

double Asked::needed(const char* name, double least, double most) const {
  const auto value = clamped(name, least, most);
  if (!value) refuseMember(name, "there");
  return *value;
}

std::vector<Asked> Asked::objects(const char* name, std::size_t most) const {
  const std::string what = "a list of 1 to " + std::to_string(most) + " objects";
  auto list = of<std::vector<Members>>(name, what);
  if (!list || list->empty() || list->size() > most) refuseMember(name, what);
  std::vector<Asked> result;
  for (Members& members : *list) result.push_back(Asked(std::move(members)));
  return result;
}

std::string Asked::normalized() const { return jsonText(AskedJson(members_)); }

std::string jsonText(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace isobrick
