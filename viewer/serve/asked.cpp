#include "isobrick/viewer/serve/asked.h"

#include <charconv>
#include <cmath>
#include <glm/common.hpp>
#include <glm/gtc/type_ptr.hpp>

#include "isobrick/storage/nesting.h"

namespace isobrick {
namespace {

// Discarded if it is no JSON.
nlohmann::json parsed(std::string_view text) {
  require(nestingDepth(text) <= kMostNesting, 400, "brackets are nested more than 16 deep");
  return nlohmann::json::parse(text, nullptr, false);
}

// "%2C" is ",".
std::string decoded(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    auto byte = static_cast<unsigned char>(text[i]);
    if (text[i] == '%') {
      const std::string_view digits = text.substr(i + 1, 2);
      const char* const end = digits.data() + digits.size();
      require(digits.size() == 2 && std::from_chars(digits.data(), end, byte, 16).ptr == end, 400,
              "the address has a '%' without two digits behind it");
      i += 2;
    }
    result += static_cast<char>(byte);
  }
  return result;
}

// Numbers if it is some, else text.
nlohmann::json valueOf(const std::string& word) {
  const nlohmann::json list = parsed("[" + word + "]");
  if (list.is_discarded()) return word;
  return list.size() == 1 ? list.front() : list;
}

}  // namespace

Asked Asked::ofMessage(std::string_view text) {
  const nlohmann::json message = parsed(text);
  require(message.is_object(), 400, "there is something else in place of a JSON object");
  return Asked(message.get<Members>());
}

Asked Asked::ofAddress(std::string_view words) {
  Members members;
  while (!words.empty()) {
    const std::string_view word = words.substr(0, words.find('&'));
    words.remove_prefix(std::min(words.size(), word.size() + 1));
    const std::size_t equals = word.find('=');
    require(equals != std::string_view::npos && equals > 0, 400,
            "the address has a word that is not NAME=VALUE");
    const std::string value = decoded(word.substr(equals + 1));
    require(members.emplace(decoded(word.substr(0, equals)), valueOf(value)).second, 400,
            "the address has a word twice");
  }
  return Asked(std::move(members));
}

std::optional<glm::dvec3> Asked::point(const char* name) const {
  constexpr double kFar = 1e12;
  const auto point = of<std::array<double, 3>>(name, "3 numbers");
  if (!point) return std::nullopt;
  return glm::clamp(glm::make_vec3(point->data()), glm::dvec3(-kFar), glm::dvec3(kFar));
}

std::optional<double> Asked::within(const char* name, double least, double most) const {
  const auto value = number(name);
  if (value && (*value < least || *value > most)) refuse(name, "within its bounds");
  return value;
}

std::optional<int> Asked::integer(const char* name, int least, int most) const {
  const auto value = within(name, least, most);
  if (!value) return std::nullopt;
  if (*value != std::floor(*value)) refuse(name, "a whole number");
  return static_cast<int>(*value);
}

double Asked::needed(const char* name, double least, double most) const {
  const auto value = clamped(name, least, most);
  if (!value) refuse(name, "there");
  return *value;
}

std::vector<Asked> Asked::objects(const char* name, std::size_t most) const {
  const std::string what = "a list of 1 to " + std::to_string(most) + " objects";
  auto list = of<std::vector<Members>>(name, what);
  if (!list || list->empty() || list->size() > most) refuse(name, what);
  std::vector<Asked> result;
  for (Members& members : *list) result.push_back(Asked(std::move(members)));
  return result;
}

std::string Asked::normalized() const { return jsonText(nlohmann::json(members_)); }

std::optional<VolumePath> volumePathOf(std::string_view path) {
  constexpr std::string_view kBegin = "/api/volume/";
  if (!path.starts_with(kBegin)) return std::nullopt;
  VolumePath result;
  const char* const end = path.data() + path.size();
  const auto read = std::from_chars(path.data() + kBegin.size(), end, result.volume);
  result.rest = path.substr(static_cast<std::size_t>(read.ptr - path.data()));
  const bool is_whole = result.rest.empty() || result.rest.front() == '/';
  return read.ec == std::errc() && is_whole ? std::optional(result) : std::nullopt;
}

std::string jsonText(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace isobrick
