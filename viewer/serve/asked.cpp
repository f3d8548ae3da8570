#include "isobrick/viewer/serve/asked.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <glm/common.hpp>
#include <glm/gtc/type_ptr.hpp>
#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

using AskedJson = nlohmann::json;

[[noreturn]] void refuseMember(const char* name, const std::string& what) {
  throw Error(std::string("'") + name + "' is not " + what);
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
  const AskedJson list = AskedJson::parse("[" + word + "]", nullptr, false);
  if (list.is_discarded()) return word;
  return list.size() == 1 ? list.front() : list;
}

}  // namespace

Asked::Asked(AskedJson object) : members_(std::move(object)) {
  if (!members_.is_object()) throw Error("there is something else in place of a JSON object");
}

Asked Asked::ofAddress(std::string_view words) {
  AskedJson members = AskedJson::object();
  while (!words.empty()) {
    const std::string_view word = words.substr(0, words.find('&'));
    words.remove_prefix(std::min(words.size(), word.size() + 1));
    const std::size_t equals = word.find('=');
    if (equals == std::string_view::npos || equals == 0)
      throw Error("the address has a word that is not NAME=VALUE");
    const std::string name = decoded(word.substr(0, equals));
    if (members.contains(name)) throw Error("the address has a word twice");
    members[name] = valueOf(decoded(word.substr(equals + 1)));
  }
  return Asked(std::move(members));
}

const AskedJson* Asked::find(const char* name) const {
  const auto found = members_.find(name);
  return found == members_.end() || found->is_null() ? nullptr : &*found;
}

template <std::size_t N>
std::optional<std::array<double, N>> Asked::numbers(const char* name) const {
  const AskedJson* const value = find(name);
  if (value == nullptr) return std::nullopt;
  std::array<double, N> numbers{};
  for (std::size_t i = 0; i < N; ++i) {
    const bool is_there = N == 1 || (value->is_array() && value->size() == N);
    const AskedJson& number = N == 1 || !is_there ? *value : (*value)[i];
    if (!number.is_number() || !is_there)
      refuseMember(name, N == 1 ? "a number" : std::to_string(N) + " numbers");
    numbers[i] = number.get<double>();
  }
  return numbers;
}

std::optional<double> Asked::number(const char* name) const {
  const auto number = numbers<1>(name);
  return number ? std::optional((*number)[0]) : std::nullopt;
}

std::optional<std::array<double, 2>> Asked::pair(const char* name) const {
  return numbers<2>(name);
}

std::optional<glm::dvec3> Asked::point(const char* name) const {
  constexpr double kFar = 1e12;
  const auto point = numbers<3>(name);
  if (!point) return std::nullopt;
  return glm::clamp(glm::make_vec3(point->data()), glm::dvec3(-kFar), glm::dvec3(kFar));
}

template <typename T>
std::optional<T> Asked::of(const char* name, AskedJson::value_t type, const char* what) const {
  const AskedJson* const value = find(name);
  if (value == nullptr) return std::nullopt;
  if (value->type() != type) refuseMember(name, what);
  return value->get<T>();
}

std::optional<bool> Asked::flag(const char* name) const {
  return of<bool>(name, AskedJson::value_t::boolean, "true or false");
}

std::optional<Asked> Asked::object(const char* name) const {
  const AskedJson* const value = find(name);
  if (value == nullptr) return std::nullopt;
  if (!value->is_object()) refuseMember(name, "an object");
  return Asked(*value);
}

std::string Asked::text(const char* name) const {
  return of<std::string>(name, AskedJson::value_t::string, "text").value_or("");
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
  const AskedJson* const value = find(name);
  if (value == nullptr || !value->is_array() || value->empty() || value->size() > most ||
      !std::all_of(value->begin(), value->end(), [](const auto& one) { return one.is_object(); }))
    refuseMember(name, "a list of 1 to " + std::to_string(most) + " objects");
  return std::vector<Asked>(value->begin(), value->end());
}

std::string Asked::normalized() const { return jsonText(members_); }

std::string jsonText(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace isobrick
