#include "tools/build/convert_output.h"

#include <algorithm>
#include <filesystem>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/storage/file_system.h"
#include "tools/output_check.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// `pattern`: of the slices in it, or empty.
bool holdsNothingElse(const std::string& folder, const std::string& pattern) {
  if (pattern.empty()) return isZarrFolder(folder);
  const auto slices = parseNumberedName(pattern);
  return slices && holdsNothingBut(folder, [&](const FolderMember& entry) {
           return entry.isRegularFile() && slices->matches(entry.name());
         });
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
  const fs::path path(fileOf(output));
  const std::string name = path.filename().string();
  const bool has_slices = name.find('%') != std::string::npos && path.has_parent_path();
  const std::string place = has_slices ? path.parent_path().string() : path.string();
  if (isFolder(place))
    refuseReplacingFolder({place}, files, force, [&](const std::string& folder) {
      return holdsNothingElse(folder, has_slices ? name : "");
    });
  else
    refuseReplacingVolume({place}, files, force);
}

}  // namespace isobrick
