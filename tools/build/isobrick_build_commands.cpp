// The subcommands of the executable `isobrick-build`, which `isobrick` starts.
#include <fmt/format.h>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tools/command.h"
#include "tools/json_output.h"

namespace isobrick {

std::vector<Command> addCommands(CLI::App& app) {
  // People know the last three as commands of `isobrick`, which becomes this executable for
  // volumes.
  std::vector<Command> commands = {addBuildCommand(app),         addConvertCommand(app),
                                   addVolumeFormatsCommand(app), addExtractCommand(app),
                                   addMergeCommand(app),         addVerifyCommand(app)};
  for (std::size_t i = 3; i < commands.size(); ++i) commands[i].parser->group("");
  return commands;
}

std::optional<std::string> commandOfFile(const std::string&) { return std::nullopt; }

void runExternalCommand(std::string_view, char**) {}

Command addVolumeFormatsCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("volume-formats", "Formats of volumes, as JSON");
  sub->group("");  // not for people
  return {sub, [] {
            Json json{{"read", Json::array()}, {"write", Json::array()}};
            for (const ReadableFormat& format : readableFormats())
              json["read"].push_back({{"name", format.name},
                                      {"endings", format.namedBy()},
                                      {"built_in", format.is_built_in},
                                      {"volume_endings", format.volumeEndings()}});
            json["write"].push_back({{"ending", ".isb"}, {"levels", false}, {"built_in", true}});
            for (const WritableFormat& format : writableFormats())
              json["write"].push_back({{"ending", format.ending},
                                       {"levels", format.has_levels},
                                       {"built_in", format.is_built_in}});
            printJson(json);
            return 0;
          }};
}

}  // namespace isobrick
