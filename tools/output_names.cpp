#include "tools/output_names.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <filesystem>
#include <set>

#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"

namespace isobrick {
namespace {

std::string placeOf(std::string_view key) { return fmt::format("{{{}}}", key); }

bool isPlain(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return byte >= 0x80 || std::isalnum(byte) != 0 || c == '.' || c == '_' || c == '+' || c == '-';
}

}  // namespace

bool hasPlace(const std::string& pattern, std::string_view key) {
  return pattern.find(placeOf(key)) != std::string::npos;
}

std::string plainName(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return !isPlain(c); }, '-');
  return text;
}

std::string withPlaceFilled(std::string pattern, std::string_view key, const std::string& value) {
  const std::string part = plainName(value);
  const std::string place = placeOf(key);
  for (std::size_t at = 0; (at = pattern.find(place, at)) != std::string::npos; at += part.size())
    pattern.replace(at, place.size(), part);
  return pattern;
}

std::string nameWith(const std::string& output, const std::string& what) {
  const std::filesystem::path path = output;
  return (path.parent_path() /
          fmt::format("{}-{}{}", path.stem().string(), what, path.extension().string()))
      .string();
}

std::vector<std::string> outputsOfEach(const std::string& pattern,
                                       const std::vector<std::string>& inputs) {
  std::vector<std::string> outputs(inputs.size(), pattern);
  if (pattern.empty() || (inputs.size() == 1 && !hasPlace(pattern, "name"))) return outputs;
  std::set<std::string> taken;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const std::string stem = inputStem(inputs[i]);
    outputs[i] = hasPlace(pattern, "name") ? withPlaceFilled(pattern, "name", stem)
                                           : nameWith(pattern, stem);
    if (!taken.insert(outputs[i]).second)
      throw UsageError(
          fmt::format("two inputs are called '{}', and would both become '{}'; give "
                      "them in calls of their own",
                      stem, outputs[i]));
  }
  return outputs;
}

std::string inputStem(const std::string& path) {
  std::string name = withoutSecrets(path);
  name.erase(name.find_last_not_of('/') + 1);
  name.erase(0, name.rfind('/') + 1);
  // The last one, whatever it is, and those that stand beside it: .nii.gz, .ome.zarr.
  for (const std::string_view ending : {".gz", "", ".ome", ".nii"}) {
    const std::size_t dot = name.rfind('.');
    if (dot == std::string::npos || dot == 0) break;
    if (ending.empty() || lowercase(name.substr(dot)) == ending) name.erase(dot);
  }
  return name;
}

}  // namespace isobrick
