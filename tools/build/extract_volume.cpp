// `isobrick extract` of a volume whose pyramid nobody needs: level 0, straight from the file.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/extract/one_pass_surface.h"
#include "isobrick/preprocess/brick_stream.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/storage/index_loop.h"
#include "tools/build/build_one.h"
#include "tools/build/input_words.h"
#include "tools/build/open_input.h"
#include "tools/extract_surface.h"
#include "tools/interrupt.h"
#include "tools/pyramid_cache.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

// The volume's pyramid, in the cache or beside the volume, if it is up to date. Of many files that
// would take as long to find out as to go through them.
std::string pyramidAtHand(const VolumeSource& source, const std::string& path) {
  constexpr std::size_t kMostFiles = 16;
  if (source.files().size() > kMostFiles) return {};
  const BuildOptions options;
  const std::string identity = inputIdentity(source, &interruptFlag());
  std::vector<std::string> places = {
      (std::filesystem::path(path).parent_path() / defaultOutputName(path)).string()};
  try {
    places.push_back(
        pathInCache(defaultCacheFolder(), buildIdentity(source.info(), identity, options)));
  } catch (const Error&) {  // nobody's home: there is no cache
  }
  for (const std::string& place : places)
    if (isUpToDate(place, source.info(), identity, options, true) && usePyramid(place))
      return place;
  return {};
}

// All surfaces in one pass of the volume.
using SinkOf = std::function<TriangleSink&(ExtractedSurface&)>;
std::vector<ExtractionReport> streamSurfaces(
    BrickStream& stream, std::vector<std::unique_ptr<ExtractedSurface>>& surfaces,
    const SinkOf& sink_of) {
  std::vector<std::unique_ptr<OnePassSurface>> streamed;
  IndexBox bricks;
  for (const auto& surface : surfaces) {
    const Query& query = surface->query();
    streamed.push_back(
        std::make_unique<OnePassSurface>(stream.pyramid(), query, sink_of(*surface)));
    bricks = unionOf(bricks, finestBricksOf(stream.pyramid().layout(), query));
  }
  stream.run(bricks, [&](const IndexBox& window) {
    for (const auto& surface : streamed) surface->mesh(window);
  });
  std::vector<ExtractionReport> reports;
  for (const auto& surface : streamed) reports.push_back(surface->finish());
  return reports;
}

ExtractResults extractFrom(BrickStream& stream, ExtractArguments& arguments,
                           AttributeFields& fields, const std::vector<SurfaceShift>* shifts,
                           double open_seconds) {
  ExtractResults results;
  results.attributes = attributeFacts(arguments);
  results.threads = arguments.query.threads;
  results.unit = stream.info().geometry.unit;
  results.open_seconds = open_seconds;
  const std::vector<std::string> names = meshNames(arguments);
  ProgressBar bar(0, "million triangles");
  MeshCollection* const together = collectionOf(arguments, stream.pyramid(), fields);
  std::vector<std::unique_ptr<ExtractedSurface>> surfaces;
  for (std::size_t i = 0; i < names.size(); ++i) {
    arguments.query.isovalue = *arguments.query.isovalues[i];
    surfaces.push_back(std::make_unique<ExtractedSurface>(
        arguments, stream.pyramid(), fields.of(arguments.query, &stream.pyramid(), nullptr),
        names[i], bar));
    if (together) surfaces.back()->writeTo(together->add(objectOf(arguments, i)));
  }
  if (surfaces.front()->wantsComponents()) {
    streamSurfaces(stream, surfaces,
                   [](ExtractedSurface& s) -> TriangleSink& { return s.componentSink(); });
    for (const auto& surface : surfaces) surface->endComponents();
  }
  const std::vector<ExtractionReport> reports = streamSurfaces(
      stream, surfaces, [](ExtractedSurface& s) -> TriangleSink& { return s.meshSink(true); });
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    surfaces[i]->endMesh(reports[i]);
    std::optional<SurfaceShift> moved;
    if (shifts != nullptr) moved = (*shifts)[i];
    results.surfaces.push_back(surfaces[i]->end([&] { return stream.range(); }));
    results.surfaces.back().moved = moved;
  }
  if (together && !arguments.label) together->finish();
  return results;
}

std::optional<ExtractResults> extractVolume(ExtractArguments& arguments) {
  const Stopwatch watch;
  InputWords words(arguments.query.input);
  try {
    refuseKnownMisfits(words.options());
  } catch (const UsageError&) {
    return std::nullopt;  // the build says it in words of this command
  }
  const std::uint64_t memory_bytes = arguments.query.memory_bytes;
  const auto shifts = words.watch(arguments.query.isovalues);
  // A pyramid's pager takes all that it may.
  const std::uint64_t source_bytes = memory_bytes / (isVolume(arguments.query.input.path) ? 2 : 8);
  const auto open = [&] { return openShowingProgress(words.options(), source_bytes); };
  std::unique_ptr<VolumeSource> source = open();
  refuseUnfitInputOptions(words.parser(), source->info());
  const auto& properties = source->info().properties;
  if (const auto grid_class = properties.find("vdb.class");
      !arguments.query.inside && grid_class != properties.end())
    arguments.query.inside = insideOfClass(grid_class->second);
  if (shifts == nullptr) {  // a pyramid does not know where its surface was before
    arguments.query.input.pyramid = pyramidAtHand(*source, arguments.query.input.path);
    if (!arguments.query.input.pyramid.empty()) return std::nullopt;
  }
  refuseOutputs(arguments);
  const std::vector<std::string> files = source->files();
  for (const std::string& name : meshNames(arguments))
    if (!name.empty()) refuseReplacing({name}, files, arguments.force);
  const std::uint64_t others =
      pyramidsOf(arguments.attributes) + arguments.query.region.masks.size();
  const std::uint64_t memory_of_each = memory_bytes / 2 / std::max<std::uint64_t>(others, 1);
  AttributeFields fields(arguments.attributes, arguments.coloring,
                         pyramidsOf(arguments.attributes) * memory_of_each, arguments.query.no_map,
                         {});
  return runWithThreads(arguments.query.threads, [&]() -> std::optional<ExtractResults> {
    BrickStreamOptions options;
    options.open = [&] { return source != nullptr ? std::move(source) : open(); };
    openMasks(arguments.query, memory_of_each);
    options.memory_bytes = memory_bytes / (others > 0 ? 4 : 2);
    options.cancel = &interruptFlag();
    BrickStream stream(std::move(options));
    if (!stream.fits()) return std::nullopt;
    return extractFrom(stream, arguments, fields, shifts.get(), watch.seconds());
  });
}

}  // namespace

VolumeExtraction* volumeExtraction() { return extractVolume; }

}  // namespace isobrick
