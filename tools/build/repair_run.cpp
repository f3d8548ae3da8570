// isobrick verify --repair: the volume that a pyramid was made of, opened for its repair.
#include <filesystem>
#include <memory>
#include <string>

#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "tools/build/build_one.h"
#include "tools/build/input_words.h"
#include "tools/interrupt.h"
#include "tools/repair.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

std::unique_ptr<VolumeSource> openSource(const RepairArguments& arguments,
                                         const std::string& named) {
  VolumeInput source = arguments.source;
  if (source.path == "auto") {
    // As it was named, or beside the pyramid.
    source.path = named;
    if (!isVolume(named))
      source.path = besidePath(arguments.pyramid, fs::path(named).filename().string());
    if (named.empty() || !isVolume(source.path)) return nullptr;
  }
  const InputWords words(source);
  return openShowingProgress(words.options(), arguments.memory_bytes / 2);
}

RepairReport repairShowingProgress(const RepairArguments& arguments) {
  ProgressBar bar(100, "%");
  RepairOptions options;
  options.open_source = [&](const std::string& named) { return openSource(arguments, named); };
  options.memory_bytes = arguments.memory_bytes;
  options.tool_version = ISOBRICK_VERSION;
  options.cancel = &interruptFlag();
  options.progress = [&](std::string_view phase, double share) { bar.show(phase, share); };
  return runWithThreads(arguments.threads, [&] {
    return repairPyramid(canonicalPath(arguments.pyramid).string(), options);
  });
}

}  // namespace

PyramidRepair* pyramidRepair() { return repairShowingProgress; }

}  // namespace isobrick
