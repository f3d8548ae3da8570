#include "isobrick/preprocess/number_text.h"

#include <cstdlib>
#include <filesystem>
#include <utility>

namespace isobrick {

std::string numberText(double number) {
  char text[40];
  char* end = text;
  for (const int digits : {15, 16, 17}) {
    end = std::to_chars(text, text + sizeof text, number, std::chars_format::general, digits).ptr;
    if (numberIn<double>({text, end}) == number) break;
  }
  return {text, end};
}

std::string indexText(const Index3& v, const char* separator) {
  return concat(v.x, separator, v.y, separator, v.z);
}

std::string pointText(const glm::dvec3& v, const char* separator) {
  return numberText(v.x) + separator + numberText(v.y) + separator + numberText(v.z);
}

std::string hexColorText(std::uint32_t color) {
  std::string text = "#000000";
  for (std::size_t digit = 6; digit > 0; --digit, color >>= 4)
    text[digit] = "0123456789abcdef"[color & 15];
  return text;
}

std::optional<std::uint32_t> parseHexColor(std::string text) {
  if (text.starts_with('#')) text.erase(0, 1);
  constexpr std::size_t kDigits = 6;
  std::uint32_t color = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), color, 16);
  const bool is_all = fault == std::errc() && end == text.data() + text.size();
  return is_all && text.size() == kDigits ? std::optional(color) : std::nullopt;
}

std::string NumberedName::of(std::int64_t number) const {
  const std::string digits = std::to_string(std::abs(number));
  const std::string sign = number < 0 ? "-" : "";
  const std::size_t have = sign.size() + digits.size();
  const std::string filling(width > have ? width - have : 0, fill);
  return before + (fill == '0' ? sign + filling : filling + sign) + digits + after;
}

bool NumberedName::matches(const std::string& name) const {
  if (name.size() <= before.size() + after.size() || !name.starts_with(before) ||
      !name.ends_with(after))
    return false;
  const std::size_t digits = name.size() - before.size() - after.size();
  return name.substr(before.size(), digits).find_first_not_of("0123456789") == std::string::npos;
}

std::optional<NumberedName> parseNumberedName(const std::string& text) {
  NumberedName name;
  const std::size_t percent = text.find('%');
  if (percent == std::string::npos || text.find('%', percent + 1) != std::string::npos)
    return std::nullopt;
  name.before = text.substr(0, percent);
  std::size_t at = percent + 1;
  if (at < text.size() && text[at] == '0') name.fill = '0';
  for (; at < text.size() && text[at] >= '0' && text[at] <= '9'; ++at) {
    name.width = 10 * name.width + static_cast<std::size_t>(text[at] - '0');
    if (name.width > 99) return std::nullopt;
  }
  if (at == text.size() || (text[at] != 'd' && text[at] != 'i')) return std::nullopt;
  name.after = text.substr(at + 1);
  return name;
}

std::optional<NumberedFiles> parseNumberedFiles(const std::string& path) {
  constexpr std::size_t kMostDigits = 18;
  const std::filesystem::path whole(path);
  const std::string folder = whole.parent_path().string();
  std::optional<NumberedName> name = parseNumberedName(whole.filename().string());
  if (!name || name->width > kMostDigits || folder.empty() || folder.find('%') != std::string::npos)
    return std::nullopt;
  name->fill = '0';
  return NumberedFiles{folder, std::move(*name)};
}

}  // namespace isobrick
