// isobrick-build volume-formats: `isobrick formats` calls it, as this executable has the libraries.
#include <fmt/format.h>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tools/command.h"
#include "tools/json_output.h"

namespace isobrick {

Command addVolumeFormatsCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("volume-formats", "Formats of volumes, as JSON");
  sub->group("");  // not for people
  return {sub, [] {
            Json json{{"read", Json::array()}, {"write", Json::array()}};
            for (const ReadableFormat& format : readableFormats())
              json["read"].push_back({{"name", format.name},
                                      {"endings", format.endings},
                                      {"built_in", format.is_built_in}});
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
