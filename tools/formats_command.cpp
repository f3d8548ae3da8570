// isobrick formats: lists the formats to read and write, from the tables that select readers and
// writers.
#include <fmt/format.h>

#include <memory>
#include <string>

#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/error.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/own_folder.h"
#include "tools/plain_text.h"
#include "tools/program_run.h"
#include "tools/shared_options.h"
#if ISOBRICK_WITH_VIEWER
#include "isobrick/viewer/image.h"
#endif

namespace isobrick {

Json volumeFormats() {
  Json json = Json::parse(
      runProgram({{requireOwn("isobrick-build"), "volume-formats"}, {}}, &interruptFlag()), nullptr,
      false);
  if (!json.is_object() || !json.contains("read") || !json.contains("write"))
    throw Error("'isobrick-build' does not say what it reads; install isobrick again");
  return json;
}

namespace {

// Those of volumes, "meshes": [...] and "pictures": [...].
Json allFormats() {
  Json json = volumeFormats();
  json["meshes"] = Json::array();
  for (const MeshFormatInfo& format : meshFormats())
    json["meshes"].push_back({{"ending", format.ending},
                              {"attribute", format.has_attributes},
                              {"color-by", format.has_colors},
                              {"zlib", format.has_zlib},
                              {"meshopt", format.has_meshopt}});
  for (const char* const ending : {".precomputed", kMeshShareEnding})
    json["meshes"].push_back({{"ending", ending},
                              {"attribute", false},
                              {"color-by", false},
                              {"zlib", false},
                              {"meshopt", false}});
  json["pictures"] = Json::array();
#if ISOBRICK_WITH_VIEWER
  for (const auto& [ending, format] : kImageFormats)
    json["pictures"].push_back({{"ending", ending}});
#endif
  return json;
}

std::string noteOf(const Json& format) {
  if (!format.value("built_in", true)) return "left out of this build";
  std::string note;
  for (const char* what : {"levels", "attribute", "color-by", "zlib", "meshopt"})
    if (format.value(what, false)) note += (note.empty() ? "--" : ", --") + std::string(what);
  return note == "--levels" ? "--all-levels" : note;
}

void printFormats(const Json& json) {
  TextTable read("LLL");
  for (const Json& format : json["read"])
    read.add({"  " + format["name"].get<std::string>(), format["endings"].get<std::string>(),
              noteOf(format)});
  fmt::print("Volumes in (build, convert, and wherever a pyramid may stand):\n{}", read.text());
  const auto printWritten = [&](const char* title, const char* key) {
    TextTable table("LL");
    for (const Json& format : json[key])
      table.add({"  " + format["ending"].get<std::string>(), noteOf(format)});
    fmt::print("{}:\n{}", title, table.text());
  };
  printWritten("Volumes out (convert)", "write");
  printWritten("Meshes out (extract)", "meshes");
  printWritten("Pictures out (render, view)", "pictures");
}

}  // namespace

Command addFormatsCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("formats", "List the formats that are read and written");
  const auto as_json = std::make_shared<bool>(false);
  addJsonFlag(*sub, *as_json);
  sub->footer(R"(
docs/FORMATS.md says what each format keeps.

Example:
  isobrick formats)");
  return {sub, [as_json] {
            const Json json = allFormats();
            if (*as_json)
              printJson(json);
            else
              printFormats(json);
            return 0;
          }};
}

}  // namespace isobrick
