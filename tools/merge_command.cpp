// isobrick merge: shares of a surface into one mesh.
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/extract/mesh_check.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "tools/attribute_options.h"
#include "tools/command.h"
#include "tools/extract_report.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/measured_sink.h"
#include "tools/mesh_options.h"
#include "tools/outputs.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/shared_options.h"
#include "tools/volume_input.h"

namespace isobrick {
namespace {

struct MergeArguments : MeshOptions {
  std::vector<std::string> shares;
  std::vector<AttributeOptions> attributes;
  ColoringOptions coloring;
  std::uint64_t memory_bytes = kDefaultMemoryBytes;  // of pyramids
  int threads = allCores();
};

// The files of a pyramid are joined alone, and their index has its own place.
int runJoin(const CLI::App& command, const MergeArguments& arguments) {
  if (arguments.shares.size() > 1)
    throw UsageError(fmt::format(
        "'{}' is a pyramid of many files, which is joined alone; give nothing beside it",
        *std::ranges::find_if(arguments.shares, isDividedName)));
  for (const CLI::Option* const option :
       optionsBeside(command, {"SHARE", "--memory", "--threads", "--json"}))
    if (option->count() > 0)
      throw UsageError(
          fmt::format("{} is for shares of a surface; a pyramid gets an index, and neither an "
                      "output nor a report of a mesh",
                      option->get_name()));
  return pyramidJoin()(arguments.shares.front(), arguments.memory_bytes, arguments.threads,
                       arguments.json);
}

// Refuses those of which a mesh alone does not tell the values.
void findAttributes(MergeArguments& arguments) {
  for (AttributeOptions& attribute : arguments.attributes) {
    if (attribute.isOfSurface() || attribute.kind == AttributeOptions::Kind::kComponent)
      throw UsageError(fmt::format(
          "--attribute {} needs the volume of the surface; 'isobrick extract' writes it in one run",
          attribute.name));
    if (attribute.isOfPyramid())
      findPyramid(attribute.input, arguments.threads, arguments.memory_bytes);
  }
}

int runMerge(const CLI::App& command, MergeArguments& arguments) {
  if (std::ranges::any_of(arguments.shares, isDividedName)) return runJoin(command, arguments);
  if (command.count("--memory") > 0 && arguments.attributes.empty())
    throw UsageError(
        "--memory is for a pyramid of many files (.isbs), and for --attribute; leave it out");
  const Stopwatch watch;
  const std::string& output = arguments.output;
  std::vector<std::string> inputs = arguments.shares;
  for (const AttributeOptions& attribute : arguments.attributes)
    inputs.push_back(attribute.input.path);
  if (!output.empty()) refuseReplacing({output}, inputs, arguments.force);
  findAttributes(arguments);
  AttributeFields fields(arguments.attributes, arguments.coloring, arguments.memory_bytes, false,
                         {});
  const SurfaceAttributes attributes = fields.of({}, nullptr, nullptr);
  MeshFileOptions file_options = meshFileOptions(arguments);
  file_options.attributes = attributes.attributes;
  file_options.colors = attributes.colors;
  const auto file_sink = output.empty() ? nullptr : makeMeshFileSink(output, file_options);
  CountingSink counting_sink;
  TriangleSink& plain_sink = file_sink ? static_cast<TriangleSink&>(*file_sink) : counting_sink;
  MeshCheck check(plain_sink);
  TriangleSink& sink = arguments.check ? check : plain_sink;
  const MergeReport report = runWithThreads(arguments.threads, [&] {
    ProgressBar bar(0, "million triangles");
    MeasuredSink measured(sink, bar);
    return mergeMeshShares(arguments.shares, measured, &interruptFlag());
  });
  const std::uint64_t vertices = file_sink ? file_sink->vertices() : counting_sink.vertices();
  std::vector<std::uint64_t> outside;
  for (const PyramidValues* const values : attributes.sampled)
    outside.push_back(values != nullptr ? values->outside() : 0);
  warnOfVerticesOutside(arguments.attributes, attributes, outside, vertices, output);
  if (arguments.json) {
    Json json = {{"output", output.empty() ? Json() : Json(output)},
                 {"shares", report.shares},
                 {"triangles", report.triangles},
                 {"vertices", vertices},
                 {"bytes_read", report.bytes},
                 {"seconds", watch.seconds()},
                 {"threads", arguments.threads},
                 {"peak_rss_bytes", peakResidentBytes()}};
    if (arguments.check) json["check"] = jsonOfQuality(check.quality());
    printJson(json);
    return 0;
  }
  fmt::print("{}{} triangles, {} vertices of {} shares ({} in {:.2f} s; peak memory {})\n",
             output.empty() ? "" : oneLine(output) + ": ", countText(report.triangles),
             countText(vertices), countText(report.shares), byteSizeText(report.bytes),
             watch.seconds(), byteSizeText(peakResidentBytes()));
  if (arguments.check) printQuality(check.quality());
  return 0;
}

}  // namespace

Command addMergeCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand(
      "merge", "Join what --part made: shares of a surface to one mesh, or the files of an .isbs");
  const auto arguments = std::make_shared<MergeArguments>();
  sub->add_option("SHARE", arguments->shares,
                  "All shares of one surface (.isbm), in any order; or the folder of a pyramid "
                  "(.isbs), which "
                  "is checked and gets its index, and no output")
      ->required();
  CLI::Option* const output =
      addMeshOptions(*sub, *arguments,
                     "Output; a mesh, .ply, .stl, .obj, .glb, .vtp or .3mf, the same bytes as "
                     "'extract' writes in one run. Without it the shares are checked and counted",
                     false);
  addAttributeOptions(*sub, arguments->attributes, arguments->coloring, output);
  findOption(*sub, "--attribute")
      ->description(
          "A number for every vertex of .ply, .vtp and .glb, as 'extract' has it: OTHER, "
          "nearest:OTHER, or distance:MESH.ply, .stl");
  sub->add_flag("--check", arguments->check,
                "Report what the mesh is like, as 'extract --check' does");
  addMemoryOption(*sub, arguments->memory_bytes);
  addThreadsOption(*sub, arguments->threads);
  addJsonFlag(*sub, arguments->json);
  sub->footer(R"(
Example:
  isobrick extract head.isb --iso 1324 --part 1/2 -o head-1.isbm    on one machine
  isobrick extract head.isb --iso 1324 --part 2/2 -o head-2.isbm    on another one
  isobrick merge head-1.isbm head-2.isbm -o head.ply
  isobrick merge scan.isbs)");
  return {sub, [sub, arguments] { return runMerge(*sub, *arguments); }};
}

}  // namespace isobrick
