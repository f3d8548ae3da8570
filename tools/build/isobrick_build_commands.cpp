// The subcommands of the executable `isobrick-build`, which `isobrick` starts.
#include "tools/command.h"

namespace isobrick {

std::vector<Command> addCommands(CLI::App& app) {
  std::vector<Command> commands = {addBuildCommand(app), addConvertCommand(app),
                                   addVolumeFormatsCommand(app), addExtractCommand(app)};
  // People know it as a command of `isobrick`, which becomes this executable for volumes.
  commands.back().parser->group("");
  return commands;
}

std::optional<std::string> commandOfFile(const std::string&) { return std::nullopt; }

void runExternalCommand(std::string_view, char**) {}

}  // namespace isobrick
