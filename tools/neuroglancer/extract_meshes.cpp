#include "tools/neuroglancer/extract_meshes.h"

#include <fmt/format.h>

#include <vector>

#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/measured_sink.h"
#include "tools/neuroglancer/precomputed_meshes.h"
#include "tools/outputs.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

Json jsonOfMeshes(const std::string& output, const std::vector<PrecomputedMesh>& meshes) {
  Json json = {{"output", output}, {"segments", Json::array()}};
  for (const PrecomputedMesh& mesh : meshes)
    json["segments"].push_back({{"segment", mesh.segment},
                                {"isovalue", mesh.isovalue},
                                {"triangles", mesh.triangles},
                                {"fragments", mesh.fragments},
                                {"bytes", mesh.bytes}});
  return json;
}

void printMeshes(const std::string& output, const std::vector<PrecomputedMesh>& meshes,
                 double seconds) {
  for (const PrecomputedMesh& mesh : meshes) {
    if (mesh.segment == 0) continue;
    std::string triangles;
    for (const std::uint64_t count : mesh.triangles)
      triangles += (triangles.empty() ? "" : ", ") + countText(count);
    fmt::print("{}: segment {}, isovalue {}: {} in {} fragments; triangles of the levels: {}\n",
               oneLine(output), mesh.segment, mesh.isovalue, byteSizeText(mesh.bytes),
               countText(mesh.fragments), triangles);
  }
  fmt::print("{:.2f} s; peak memory {}\n", seconds, byteSizeText(peakResidentBytes()));
}

}  // namespace

void refuseForMeshes(const CLI::App& command, const QueryOptions& options,
                     const std::string& output, bool force) {
  const auto refuse = [](const std::string& option) {
    throw UsageError(
        fmt::format("{} does not go with a .precomputed output, which holds all levels of the "
                    "pyramid; leave it out, or write another format",
                    option));
  };
  for (const CLI::Option* const option :
       optionsBeside(command, {"FILE", "--iso", "--inside", "--output", "--force", "--json",
                               "--threads", "--memory", "--no-map"}))
    if (option->count() > 0) refuse(option->get_name());
  refuseReplacingFolder({output}, {options.input.path, options.input.pyramid}, force,
                        holdsPrecomputedMeshes);
}

int runExtractMeshes(QueryOptions options, const std::string& output, bool as_json) {
  findPyramid(options);
  const Stopwatch watch;
  double open_seconds = 0;
  std::vector<std::string> lost;
  const std::vector<PrecomputedMesh> meshes = runWithThreads(options.threads, [&] {
    const auto pyramid = openPyramidFile(options.input.pyramid, options.memory_bytes,
                                         fileAccess(options.no_map), remoteOptions(options.input));
    open_seconds = watch.seconds();
    chooseIsovalues(options, *pyramid);
    refuseTwinIsovalues(options.isovalues);
    lost = neuroglancerLosses(pyramid->spec().geometry);
    std::vector<double> isovalues;
    for (const std::optional<double>& isovalue : options.isovalues) {
      isovalues.push_back(*isovalue);
      options.isovalue = *isovalue;
      warnOfEmptySurface(options, *pyramid);
    }
    ProgressBar bar(0, "million triangles");
    return writePrecomputedMeshes(
        *pyramid, isovalues, insideOf(options, *pyramid), output, &interruptFlag(),
        [&](Extractor& extractor, const Query& query, TriangleSink& sink) {
          MeasuredSink measured(sink, bar);
          return extractor.extract(query, measured);
        });
  });
  if (as_json) {
    Json json = jsonOfMeshes(output, meshes);
    json["seconds"] = {{"open", open_seconds}, {"extract", watch.seconds() - open_seconds}};
    json["threads"] = options.threads;
    json["lost"] = lost;
    json["peak_rss_bytes"] = peakResidentBytes();
    printJson(json);
  } else {
    printMeshes(output, meshes, watch.seconds());
  }
  warnOfLosses(output, lost);
  return 0;
}

}  // namespace isobrick
