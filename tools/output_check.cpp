#include "tools/output_check.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <optional>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

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
  const std::optional<fs::path> named = dataFileOf(path);
  if (named && isSameFile(*named, voxels)) return;
  throw Error(fmt::format("'{}' exists and is not the data of '{}', which would have its voxels "
                          "there; {}",
                          voxels.string(), path, output.way_out),
              {.path = voxels.string()});
}

}  // namespace isobrick
