// The subcommands of the executable `isobrick-build`, which `isobrick` starts.
#include "tools/command.h"

namespace isobrick {

std::vector<Command> addCommands(CLI::App& app) {
  return {addBuildCommand(app), addConvertCommand(app), addVolumeFormatsCommand(app)};
}

std::optional<std::string> commandOfFile(const std::string&) { return std::nullopt; }

void runExternalCommand(std::string_view, char**) {}

}  // namespace isobrick
