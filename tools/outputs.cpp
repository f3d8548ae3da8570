#include "tools/outputs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <vector>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/plain_text.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

std::string placeOf(std::string_view key) { return fmt::format("{{{}}}", key); }

bool isPlain(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return byte >= 0x80 || std::isalnum(byte) != 0 || c == '.' || c == '_' || c == '+' || c == '-';
}

// The file with a MetaImage's voxels, if the header can be read.
std::optional<fs::path> dataFileOf(const fs::path& header) {
  if (!isRegularFile(header)) return std::nullopt;
  constexpr int kMostLines = 100;
  std::ifstream file(header);
  std::string line;
  for (int i = 0; i < kMostLines && std::getline(file, line); ++i) {
    if (line.rfind("ElementDataFile", 0) != 0) continue;
    const std::size_t begin = line.find_first_not_of(" \t", line.find('=') + 1);
    const std::size_t end = line.find_last_not_of(" \t\r");
    if (begin == std::string::npos || begin > end) return std::nullopt;
    return header.parent_path() / line.substr(begin, end + 1 - begin);
  }
  return std::nullopt;
}

void refuseInput(const std::string& file, const PlannedOutput& output,
                 const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs)
    if (isSameFile(input, file))
      throw Error(fmt::format("'{}' is the input; {}", file, output.way_out), {.path = file});
}

[[noreturn]] void refuseExisting(const PlannedOutput& output) {
  throw Error(fmt::format("'{}' exists already; replace it with --force, or {}", output.path,
                          output.way_out),
              {.path = output.path});
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

bool isDividedName(const std::string& path) {
  return lowerExtension(path.substr(0, path.find_last_not_of('/') + 1)) == kDividedEnding;
}

std::string withPlaceFilled(std::string pattern, std::string_view key, const std::string& value) {
  const std::string part = plainName(value);
  const std::string place = placeOf(key);
  for (std::size_t at = 0; (at = pattern.find(place, at)) != std::string::npos; at += part.size())
    pattern.replace(at, place.size(), part);
  return pattern;
}

std::string nameWith(const std::string& output, const std::string& what) {
  const fs::path path = output;
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

CLI::Option* addForceFlag(CLI::App& app, bool& force) {
  return app.add_flag("--force", force, "Replace what has the name of the output, never an input");
}

void refuseReplacing(const PlannedOutput& output, const std::vector<std::string>& inputs,
                     bool force) {
  const std::string& path = output.path;
  if (isRemotePath(path))
    throw Error(
        fmt::format("'{}' is a URL, and isobrick writes files alone; {}", path, output.way_out),
        {.path = path});
  refuseInput(path, output, inputs);
  if (isPresent(path) && !isRegularFile(path))
    throw Error(fmt::format("'{}' is {}; {}", path,
                            isFolder(path) ? "a folder" : "not a regular file", output.way_out),
                {.path = path});
  if (!force && isNameTaken(path)) refuseExisting(output);
}

void refuseReplacingFolder(const PlannedOutput& output, const std::vector<std::string>& inputs,
                           bool force,
                           const std::function<bool(const std::string& folder)>& holds_own) {
  const std::string& folder = output.path;
  if (isNameTaken(folder) && !isFolder(folder))
    throw Error(fmt::format("'{}' exists and is no folder; {}", folder, output.way_out),
                {.path = folder});
  if (!isNameTaken(folder)) return refuseReplacing(output, inputs, force);
  const fs::path whole = canonicalPath(folder);
  for (const std::string& input : inputs) {
    const fs::path inside = canonicalPath(input).lexically_relative(whole);
    if (!inside.empty() && *inside.begin() != "..")
      throw Error(fmt::format("'{}' holds the input; {}", folder, output.way_out),
                  {.path = folder});
  }
  if (!holdsNothingBut(folder, [](const FolderMember&) { return false; }) && !holds_own(folder))
    throw Error(
        fmt::format("'{}' is a folder with something else in it; {}", folder, output.way_out),
        {.path = folder});
  if (!force) refuseExisting(output);
}

void refuseReplacingVolume(const PlannedOutput& output, const std::vector<std::string>& inputs,
                           bool force) {
  refuseReplacing(output, inputs, force);
  const std::string& path = output.path;
  if (fs::path(path).extension() != ".mhd") return;
  const fs::path voxels = fs::path(path).replace_extension(".raw");
  if (!isNameTaken(voxels)) return;
  refuseInput(voxels.string(), output, inputs);
  std::vector<std::string> headers = {path};
  // Of a run that ended between the two renames: it has given the voxels their name already.
  if (force || !isNameTaken(voxels.string() + kTemporaryEnding))
    headers.push_back(path + kTemporaryEnding);
  for (const std::string& header : headers)
    if (const auto named = dataFileOf(header); named && isSameFile(*named, voxels)) return;
  throw Error(fmt::format("'{}' exists and is not the data of '{}', which would have its voxels "
                          "there; {}",
                          voxels.string(), path, output.way_out),
              {.path = voxels.string()});
}

void warnOfLosses(const std::string& output, const std::vector<std::string>& losses) {
  for (const std::string& loss : losses)
    fmt::print(stderr, "isobrick: warning: '{}': {}\n", oneLine(output), oneLine(loss));
}

}  // namespace isobrick
