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
#include "tools/build/fitting_options.h"
#include "tools/build/open_input.h"
#include "tools/extract_surface.h"
#include "tools/interrupt.h"
#include "tools/pyramid_cache.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

// The words that say how to read the volume, as `isobrick build` reads them.
class InputWords {
 public:
  explicit InputWords(const VolumeInput& input) {
    addOpenOptions(parser_, options_);
    std::vector<std::string> words = wordsForBuild(input);
    std::reverse(words.begin(), words.end());  // as CLI11 wants them
    try {
      parser_.parse(std::move(words));
    } catch (const CLI::ParseError& error) {
      throw UsageError(error.what());
    }
    options_.path = input.path;
  }
  InputWords(const InputWords&) = delete;

  const CLI::App& parser() const { return parser_; }
  const InputOptions& options() const { return options_; }

 private:
  CLI::App parser_;
  InputOptions options_;
};

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
                           AttributeFields& fields, double open_seconds) {
  ExtractResults results;
  results.attributes = attributeFacts(arguments);
  results.threads = arguments.query.threads;
  results.unit = stream.info().geometry.unit;
  results.open_seconds = open_seconds;
  const std::vector<std::string> names = meshNames(arguments);
  ProgressBar bar(0, "million triangles");
  std::vector<std::unique_ptr<ExtractedSurface>> surfaces;
  for (std::size_t i = 0; i < names.size(); ++i) {
    arguments.query.isovalue = *arguments.query.isovalues[i];
    surfaces.push_back(std::make_unique<ExtractedSurface>(
        arguments, stream.pyramid(), fields.of(arguments.query.isovalue, stream.pyramid(), nullptr),
        names[i], bar));
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
    results.surfaces.push_back(surfaces[i]->end([&] { return stream.range(); }));
  }
  return results;
}

}  // namespace

std::optional<ExtractResults> extractVolume(ExtractArguments& arguments) {
  const Stopwatch watch;
  const InputWords words(arguments.query.input);
  try {
    refuseKnownMisfits(words.options());
  } catch (const UsageError&) {
    return std::nullopt;  // the build says it in words of this command
  }
  const std::uint64_t memory_bytes = arguments.query.memory_bytes;
  const auto open = [&] { return openShowingProgress(words.options(), memory_bytes / 2); };
  std::unique_ptr<VolumeSource> source = open();
  refuseUnfitInputOptions(words.parser(), source->info());
  arguments.query.input.pyramid = pyramidAtHand(*source, arguments.query.input.path);
  if (!arguments.query.input.pyramid.empty()) return std::nullopt;
  refuseOutputs(arguments);
  const std::vector<std::string> files = source->files();
  for (const std::string& name : meshNames(arguments))
    if (!name.empty()) refuseReplacing({name}, files, arguments.force);
  const bool has_others = pyramidsOf(arguments.attributes) > 0;
  AttributeFields fields(arguments.attributes, arguments.coloring, memory_bytes / 2,
                         arguments.query.no_map, {});
  return runWithThreads(arguments.query.threads, [&]() -> std::optional<ExtractResults> {
    BrickStreamOptions options;
    options.open = [&] { return source != nullptr ? std::move(source) : open(); };
    options.memory_bytes = memory_bytes / (has_others ? 4 : 2);
    options.cancel = &interruptFlag();
    BrickStream stream(std::move(options));
    if (!stream.fits()) return std::nullopt;
    return extractFrom(stream, arguments, fields, watch.seconds());
  });
}

}  // namespace isobrick
