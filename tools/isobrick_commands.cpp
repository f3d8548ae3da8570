// The subcommands of the executable `isobrick`.
#include <algorithm>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_file.h"
#include "tools/command.h"
#include "tools/extract_surface.h"
#include "tools/own_folder.h"
#include "tools/repair.h"
#include "tools/volume_input.h"

namespace isobrick {
namespace {

constexpr char kExamples[] = R"(
Examples:
  isobrick phantom head --voxels 256 -o head.nrrd      make a test volume
  isobrick build head.nrrd                           make head.isb in the current folder
  isobrick build 'scans/*.nrrd' --out-dir pyramids   one pyramid each; again: only what changed
  isobrick build scan.raw --raw-dims 512,512,400 --raw-type u16
  isobrick convert head.isb --level 1 -o half.nrrd   a level for other programs
  isobrick info head.isb
  isobrick extract head.isb --iso 1324 -o bone.ply   the finest surface
  isobrick extract head.isb --iso 1324 --focus 128,40,128 --radius 30 -o part.stl
  isobrick render head.isb --iso 500 -o skin.png
  isobrick view head.isb                             in a window: H lists the keys
  isobrick head.nrrd                                 the same of a volume, or a folder of DICOM
  isobrick serve head.isb                            the same in a browser
  isobrick cache                                     pyramids that were built of volumes

'isobrick SUBCOMMAND --help' lists the options of a subcommand.
Exit status: 0 success, 1 failed, 2 wrong usage, 130 interrupted.)";

// Subcommands that another executable has.
struct ExternalCommand {
  std::string_view name, description, executable;
};
constexpr ExternalCommand kExternalCommands[] = {
    {"build", kBuildDescription, "isobrick-build"},
    {"convert", kConvertDescription, "isobrick-build"},
#if ISOBRICK_WITH_WINDOW
    {"view", kViewDescription, "isobrick-view"},
#endif
};

}  // namespace

std::vector<Command> addCommands(CLI::App& app) {
  std::vector<Command> commands;
  // Only for --help: runExternalCommand() was called before.
  for (const ExternalCommand& command : kExternalCommands)
    app.add_subcommand(std::string(command.name), std::string(command.description));
  commands.push_back(addInfoCommand(app));
  commands.push_back(addVerifyCommand(app));
  commands.push_back(addExtractCommand(app));
  commands.push_back(addMergeCommand(app));
#if ISOBRICK_WITH_VIEWER
  commands.push_back(addRenderCommand(app));
#endif
#if ISOBRICK_WITH_SERVER
  commands.push_back(addServeCommand(app));
#endif
  commands.push_back(addPhantomCommand(app));
  commands.push_back(addCacheCommand(app));
  commands.push_back(addFormatsCommand(app));
  commands.push_back(addBenchCommand(app));
  commands.push_back(addBenchRowCommand(app));
  app.footer(kExamples);  // last: subcommands would inherit it
  return commands;
}

std::optional<std::string> commandOfFile(const std::string& word) {
  if (ISOBRICK_WITH_WINDOW == 0 || !(isVolume(word) || isPyramidFile(word))) return std::nullopt;
  return "view";
}

void runExternalCommand(std::string_view name, char** argv) {
  const auto named =
      std::find_if(std::begin(kExternalCommands), std::end(kExternalCommands),
                   [&](const ExternalCommand& command) { return command.name == name; });
  if (named == std::end(kExternalCommands)) return;
  noteWords(argv);
  becomeExecutable(std::string(named->executable));
}

VolumeExtraction* volumeExtraction() { becomeExecutable("isobrick-build"); }
PyramidRepair* pyramidRepair() { becomeExecutable("isobrick-build"); }

PyramidJoin* pyramidJoin() { becomeExecutable("isobrick-build"); }

}  // namespace isobrick
