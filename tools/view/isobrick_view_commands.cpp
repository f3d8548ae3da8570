// The subcommand of the executable `isobrick-view`, which `isobrick` starts.
#include "tools/command.h"

namespace isobrick {

std::vector<Command> addCommands(CLI::App& app) { return {addViewCommand(app)}; }

std::optional<std::string> commandOfFile(const std::string&) { return std::nullopt; }

void runExternalCommand(std::string_view, char**) {}

}  // namespace isobrick
