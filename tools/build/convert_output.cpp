#include "tools/build/convert_output.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "isobrick/preprocess/export/neuroglancer_info.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/storage/error.h"
#include "tools/output_check.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// A folder is replaced only if it plainly holds the same kind of output.
bool holdsNothingElse(const std::string& folder, const std::string& pattern) {
  std::error_code ignored;
  if (fs::is_empty(folder, ignored)) return true;
  if (pattern.empty())
    return isZarrFolder(folder) || neuroglancerTypeOf(folder) == "neuroglancer_multiscale_volume";
  const auto slices = parseNumberedName(pattern);
  return std::all_of(fs::directory_iterator(folder, ignored), fs::directory_iterator(),
                     [&](const fs::directory_entry& entry) {
                       return entry.is_regular_file() && slices &&
                              slices->matches(entry.path().filename().string());
                     });
}

// `pattern`: of the slices in it, or empty.
void refuseFolder(const std::string& folder, const std::string& pattern,
                  const std::vector<std::string>& inputs, bool force) {
  std::error_code ignored;
  const fs::path whole = fs::weakly_canonical(folder, ignored);
  for (const std::string& input : inputs) {
    const fs::path inside = fs::weakly_canonical(input, ignored).lexically_relative(whole);
    if (!inside.empty() && *inside.begin() != "..")
      throw Error(fmt::format("'{}' holds the input; choose another output with -o", folder));
  }
  if (!holdsNothingElse(folder, pattern))
    throw Error(fmt::format(
        "'{}' is a folder with something else in it; choose another output with -o", folder));
  if (!force)
    throw Error(fmt::format(
        "'{}' exists already; replace it with --force, or choose another output with -o", folder));
}

// "scan.h5" for "scan.h5:/entry/data".
std::string fileOf(const std::string& name) {
  return isHdf5Name(name) ? splitHdf5Name(name).first : name;
}

}  // namespace

void refuseConvertOutput(const std::string& output, const std::vector<std::string>& inputs,
                         bool force) {
  std::vector<std::string> files;
  std::transform(inputs.begin(), inputs.end(), std::back_inserter(files), fileOf);
  if (isHdf5Name(output)) return refuseReplacing({fileOf(output)}, files, true);
  const fs::path path(output);
  const std::string name = path.filename().string();
  const bool has_slices = name.find('%') != std::string::npos && path.has_parent_path();
  const std::string place = has_slices ? path.parent_path().string() : output;
  std::error_code ignored;
  if (fs::is_directory(place, ignored))
    refuseFolder(place, has_slices ? name : "", files, force);
  else
    refuseReplacingVolume({place}, files, force);
}

}  // namespace isobrick
