// isobrick extract: a mesh of one isosurface, or its size.
#include <fmt/format.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/sinks/counting_sink.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/lowercase.h"
#include "tools/byte_size.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/measured_sink.h"
#include "tools/one_line.h"
#include "tools/output_check.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"
#include "tools/stopwatch.h"
#include "tools/thread_count.h"

namespace isobrick {
namespace {

struct ExtractArguments {
  QueryOptions query;
  std::string output;     // empty: the mesh is counted only
  VolumeInput attribute;  // whose values vertices get; path empty: none
  bool zlib = false;
  bool meshopt = false;
  int repeat = 1;
  bool force = false;
  bool json = false;
};

struct ExtractResult {
  ExtractionReport report;  // of the last repeat
  std::uint64_t vertices = 0;
  double open_seconds = 0;
  std::vector<double> extract_seconds;  // one for every repeat, without the time in a file's sink
  BrickPager::Counters pager;
  std::uint64_t vertices_outside = 0;  // of the other pyramid
  double write_seconds = 0;            // inside the file's sink: writing, and waiting for the disk
};

ExtractResult extract(ExtractArguments& arguments) {
  ExtractResult result;
  const Stopwatch open_watch;
  // Two pyramids share the memory.
  const bool has_attribute = !arguments.attribute.path.empty();
  const std::uint64_t memory_bytes = arguments.query.memory_bytes / (has_attribute ? 2 : 1);
  const FileAccess access = fileAccess(arguments.query.no_map);
  const Pyramid pyramid(arguments.query.input.pyramid, memory_bytes, access);
  std::optional<Pyramid> other;
  std::optional<PyramidValues> values;
  if (has_attribute) {
    other.emplace(arguments.attribute.pyramid, memory_bytes, access);
    values.emplace(*other);
  }
  result.open_seconds = open_watch.seconds();
  chooseIsovalue(arguments.query, pyramid);
  const Query query = makeQuery(arguments.query, pyramid);
  if (!arguments.output.empty())
    refuseReplacing({arguments.output}, {pyramid.path(), arguments.attribute.pyramid},
                    arguments.force);
  const MeshFileOptions options{.cancel = &interruptFlag(),
                                .values = values ? &*values : nullptr,
                                .zlib = arguments.zlib,
                                .meshopt = arguments.meshopt};
  const auto file_sink =
      arguments.output.empty() ? nullptr : makeMeshFileSink(arguments.output, options);

  Extractor extractor(pyramid);
  ProgressBar bar(0, "million triangles");
  for (int repeat = 1; repeat <= arguments.repeat; ++repeat) {
    const bool to_file = file_sink != nullptr && repeat == arguments.repeat;
    CountingSink counting_sink;
    TriangleSink& sink = to_file ? static_cast<TriangleSink&>(*file_sink) : counting_sink;
    MeasuredSink measured(sink, bar);
    const Stopwatch watch;
    result.report = extractor.extract(query, measured);
    const double seconds = watch.seconds();
    if (to_file) result.write_seconds = measured.seconds(arguments.query.threads);
    result.extract_seconds.push_back(seconds - result.write_seconds);
    result.vertices = to_file ? file_sink->vertices() : counting_sink.vertices();
  }
  result.pager = pyramid.counters();
  if (values) result.vertices_outside = values->outside();
  warnOfEmptySurface(arguments.query, pyramid);
  if (result.vertices_outside > 0)
    fmt::print(stderr,
               "isobrick: warning: {} of {} vertices lie outside of '{}' and have no value ({})\n",
               countText(result.vertices_outside), countText(result.vertices),
               oneLine(arguments.attribute.path),
               lowerExtension(arguments.output) == ".glb" ? "0 in the file" : "NaN in the file");
  return result;
}

// Over all repeats.
Json jsonOfPager(const BrickPager::Counters& counters) {
  return {{"hits", counters.hits},
          {"misses", counters.misses},
          {"loads_joined", counters.loads_joined},
          {"bytes_read", counters.bytes_read},
          {"bytes_unpacked", counters.bytes_unpacked},
          {"evictions", counters.parts_released},
          {"fetched", counters.parts_fetched},
          {"fetched_unused", counters.fetched_unused},
          {"seconds_waited", 1e-9 * static_cast<double>(counters.wait_nanoseconds)}};
}

Json jsonOfResult(const ExtractArguments& arguments, const ExtractResult& result) {
  const ExtractionReport& report = result.report;
  Json json;
  json["output"] = arguments.output.empty() ? Json() : Json(arguments.output);
  if (!arguments.attribute.path.empty())
    json["attribute"] = {{"path", arguments.attribute.path},
                         {"vertices_outside", result.vertices_outside}};
  json["isovalue"] = arguments.query.isovalue;
  json["triangles"] = report.triangles;
  json["vertices"] = result.vertices;
  json["seconds"] = {{"open", result.open_seconds},
                     {"extract", result.extract_seconds},
                     {"write", result.write_seconds}};
  json["levels"] = Json::array();
  for (const LevelCounts& counts : report.levels)
    json["levels"].push_back({{"level", counts.level},
                              {"cells", counts.cells},
                              {"triangles", counts.triangles},
                              {"transition_cells", counts.transition_cells}});
  json["bricks"] = {{"active", report.bricks_active}, {"read", report.bricks_read}};
  json["bytes_read"] = report.bytes_read;
  json["bytes_active"] = report.bytes_active;
  json["pager"] = jsonOfPager(result.pager);
  json["peak_rss_bytes"] = peakResidentBytes();
  json["threads"] = arguments.query.threads;
  return json;
}

void printSummary(const ExtractArguments& arguments, const ExtractResult& result) {
  const ExtractionReport& report = result.report;
  fmt::print("{}{} triangles, {} vertices\n",
             arguments.output.empty() ? "" : arguments.output + ": ", countText(report.triangles),
             countText(result.vertices));
  for (const LevelCounts& counts : report.levels)
    fmt::print("  level {:<2} {:>14} triangles in {} cells, {} of them in transition\n",
               counts.level, countText(counts.triangles), countText(counts.cells),
               countText(counts.transition_cells));
  fmt::print("bricks: {} active of {}, {} read of {}\n", countText(report.bricks_active),
             byteSizeText(report.bytes_active), countText(report.bricks_read),
             byteSizeText(report.bytes_read));
  std::string extract_text;
  for (const double seconds : result.extract_seconds)
    extract_text += fmt::format(" {:.4f}", seconds);
  fmt::print("seconds: open {:.4f}, extract{}, write {:.4f}; {} threads; peak memory {}\n",
             result.open_seconds, extract_text, result.write_seconds, arguments.query.threads,
             byteSizeText(peakResidentBytes()));
}

int runExtract(ExtractArguments arguments) {
  // Before any work, so that a name that is taken costs no time.
  if (!arguments.output.empty())
    refuseReplacing({arguments.output}, {arguments.query.input.path, arguments.attribute.path},
                    arguments.force);
  findPyramid(arguments.query);
  VolumeInput& attribute = arguments.attribute;
  attribute.cache_folder = arguments.query.input.cache_folder;
  if (!attribute.path.empty())
    findPyramid(attribute, arguments.query.threads, arguments.query.memory_bytes);
  const ExtractResult result =
      runWithThreads(arguments.query.threads, [&] { return extract(arguments); });
  if (arguments.json)
    printJson(jsonOfResult(arguments, result));
  else
    printSummary(arguments, result);
  return 0;
}

}  // namespace

Command addExtractCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("extract", "Extract an isosurface of a pyramid or a volume");
  const auto arguments = std::make_shared<ExtractArguments>();
  addQueryOptions(*sub, arguments->query);
  CLI::Option* const output =
      sub->add_option("-o,--output", arguments->output,
                      "Output; a mesh, .ply, .stl, .obj, .glb or .vtp, in world units. "
                      "Without it the mesh is only counted")
          ->type_name("MESH");
  addForceFlag(*sub, arguments->force)->needs(output);
  sub->add_option("--attribute", arguments->attribute.path,
                  "Another pyramid or volume, whose value at every vertex goes into .ply and .vtp "
                  "(value) or "
                  ".glb (_VALUE): level 0, interpolated trilinearly where the vertex is in the "
                  "world. Both pyramids share --memory")
      ->type_name("OTHER")
      ->needs(output);
  sub->add_flag("--zlib", arguments->zlib, "Pack .vtp with zlib")->needs(output);
  sub->add_flag("--meshopt", arguments->meshopt,
                "Pack .glb with EXT_meshopt_compression: positions to 1/8192 of the least spacing, "
                "normals to 10 bits")
      ->needs(output);
  addParsedOption(
      *sub, "--repeat", arguments->repeat,
      [](const std::string& text) { return parseInteger(text, 1, 1000000); }, "N",
      "Extract N times; the last one is written");
  addJsonFlag(*sub, arguments->json);
  return {sub, [arguments] { return runExtract(*arguments); }};
}

}  // namespace isobrick
