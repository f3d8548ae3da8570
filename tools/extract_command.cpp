// isobrick extract: a mesh of one isosurface, or its size.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/extract/sinks/xml_text.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/remote_options.h"
#include "tools/attribute_options.h"
#include "tools/command.h"
#include "tools/extract_report.h"
#include "tools/extract_surface.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/neuroglancer/extract_meshes.h"
#include "tools/neuroglancer/precomputed_meshes.h"
#include "tools/outputs.h"
#include "tools/parse_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

ExtractResult extractOne(const ExtractArguments& arguments, const Pyramid& pyramid,
                         Extractor& extractor, AttributeFields& fields, const std::string& output,
                         std::unique_ptr<MeshFileSink> sink_of_all) {
  ProgressBar bar(0, "million triangles");
  ExtractedSurface surface(arguments, pyramid, fields.of(arguments.query, &pyramid, &extractor),
                           output, bar);
  if (sink_of_all) surface.writeTo(std::move(sink_of_all));
  Query& query = surface.query();
  if (arguments.most_triangles)
    query.simplify = findSimplification(extractor, query, *arguments.most_triangles);
  const ShareNumber share = arguments.part.value_or(ShareNumber());
  if (isShareName(output))
    surface.writeTo(
        makeMeshShareSink(output, pyramid, extractor.plan(query), share, &interruptFlag()));
  if (surface.wantsComponents()) {
    extractor.extract(query, surface.componentSink());
    surface.endComponents();
  }
  for (int repeat = 1; repeat <= arguments.repeat; ++repeat) {
    TriangleSink& sink = surface.meshSink(repeat == arguments.repeat);
    const ExtractionPlan plan = extractor.plan(query);
    const NumberRun run = bricksOf(plan, share);
    surface.endMesh(extractor.execute(plan, run.first, run.count, sink));
  }
  return surface.end([&] { return pyramid.valueRange(); });
}

ExtractResults extract(ExtractArguments& arguments) {
  ExtractResults results;
  results.attributes = attributeFacts(arguments);
  results.part = arguments.part;
  results.threads = arguments.query.threads;
  const Stopwatch open_watch;
  // All pyramids share the memory.
  const std::uint64_t others = pyramidsOf(arguments.attributes);
  const std::uint64_t memory_bytes =
      arguments.query.memory_bytes / (1 + others + arguments.query.region.masks.size());
  const FileAccess access = fileAccess(arguments.query.no_map);
  const RemoteOptions remote = remoteOptions(arguments.query.input);
  const auto file = openPyramidFile(arguments.query.input.pyramid, memory_bytes, access, remote);
  const Pyramid& pyramid = *file;
  AttributeFields fields(arguments.attributes, arguments.coloring, others * memory_bytes,
                         arguments.query.no_map, remote);
  openMasks(arguments.query, memory_bytes);
  results.unit = pyramid.spec().geometry.unit;
  results.open_seconds = open_watch.seconds();
  results.opening = pyramid.remoteCounters();
  chooseIsovalues(arguments.query, pyramid);
  refuseTwinIsovalues(arguments.query.isovalues);
  refuseOutputs(arguments);
  const std::vector<std::string> names = meshNames(arguments);
  Extractor extractor(pyramid);
  MeshCollection* const together = collectionOf(arguments, pyramid, fields);
  for (std::size_t i = 0; i < names.size(); ++i) {
    arguments.query.isovalue = *arguments.query.isovalues[i];
    results.surfaces.push_back(
        extractOne(arguments, pyramid, extractor, fields, names[i],
                   together ? together->add(objectOf(arguments, i)) : nullptr));
  }
  if (together && !arguments.label) together->finish();
  results.pager = pyramid.parts().counters();
  if (isRemotePath(arguments.query.input.pyramid)) results.remote = pyramid.remoteCounters();
  return results;
}

// Level 0 alone, in one pass or two, which no pyramid would make faster. Numbers of bricks go with
// the pyramid, and so does a cache that the user names.
bool needsNoPyramid(const ExtractArguments& arguments) {
  const QueryOptions& query = arguments.query;
  const bool is_known = std::all_of(query.isovalues.begin(), query.isovalues.end(),
                                    [](const auto& isovalue) { return isovalue.has_value(); });
  return isReadAsVolume(query.input) && query.input.cache_folder.empty() && is_known &&
         !masksNan(query.input) &&
         std::ranges::none_of(arguments.attributes, &AttributeOptions::isOfSurface) &&
         isFinest(query.choice) && query.or_finer.empty() && !arguments.most_triangles &&
         !arguments.part && arguments.repeat == 1 && !isShareName(arguments.output);
}

ExtractResults extractFromPyramid(ExtractArguments& arguments) {
  if (arguments.query.input.pyramid.empty()) findPyramid(arguments.query);
  return runWithThreads(arguments.query.threads, [&] { return extract(arguments); });
}

// The arguments for each of the labels, whose surfaces get files of their own if there are several
// and not together; the arguments as they are without --label.
std::vector<ExtractArguments> argumentsOfLabels(const ExtractArguments& arguments) {
  const auto given = arguments.query.input.derivation.find("--label");
  if (given == arguments.query.input.derivation.end() || given->second.empty()) return {arguments};
  std::vector<ExtractArguments> all;
  try {
    for (const std::uint64_t label : parseLabels(given->second)) {
      all.push_back(arguments);
      all.back().label = label;
      all.back().query.input.derivation["--label"] = fmt::format("{}", label);
    }
  } catch (const std::invalid_argument& failure) {
    throw UsageError(fmt::format("--label: {}", failure.what()));
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all.size() > 1 && !arguments.output.empty() && !arguments.together)
      all[i].output = nameWith(arguments.output, fmt::format("{}", *all[i].label));
    if (!arguments.colors.empty() && arguments.colors.size() == all.size())
      all[i].colors = {arguments.colors[i]};
  }
  return all;
}

// The arguments for each FILE, with an output of its own, and for each of the labels of that.
std::vector<ExtractArguments> argumentsOfFiles(const ExtractArguments& arguments) {
  const std::vector<std::string>& files = arguments.query.files;
  const std::vector<std::string> outputs = outputsOfEach(arguments.output, files);
  std::vector<ExtractArguments> all;
  for (std::size_t i = 0; i < files.size(); ++i) {
    ExtractArguments one = arguments;
    one.query = queryOfFile(arguments.query, i);
    one.output = outputs[i];
    one.step = i;
    for (ExtractArguments& of_label : argumentsOfLabels(one)) all.push_back(std::move(of_label));
  }
  return all;
}

// One after the other; each is a volume of its own.
ExtractResults extractAll(std::vector<ExtractArguments> all) {
  // Before the first one: this program may become another one here.
  VolumeExtraction* const extract_volume =
      std::ranges::any_of(all, needsNoPyramid) ? volumeExtraction() : nullptr;
  std::optional<ExtractResults> together;
  std::shared_ptr<MeshCollection> collection;  // of the labels of one file
  for (std::size_t i = 0; i < all.size(); ++i) {
    ExtractArguments& one = all[i];
    one.collection = std::move(collection);
    std::optional<ExtractResults> results;
    if (needsNoPyramid(one)) results = extract_volume(one);
    if (!results) results = extractFromPyramid(one);
    if (one.label && i + 1 < all.size() && all[i + 1].step == one.step)
      collection = one.collection;
    else if (one.label && one.collection != nullptr)
      one.collection->finish();
    for (ExtractResult& surface : results->surfaces) {
      surface.label = one.label;
      surface.step = one.step;
      if (one.query.files.size() > 1) surface.file = one.query.input.path;
    }
    if (together)
      addResults(std::move(*results), *together);
    else
      together = std::move(results);
  }
  return std::move(*together);
}

constexpr std::string_view kPvdEnding = ".pvd";

// ParaView's list of files that are the steps of one surface: each surface at its step, the
// surfaces of one step as its parts. Their files lie beside `path`.
void writePvd(const std::string& path, const std::vector<ExtractResult>& surfaces) {
  std::string text =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  std::map<std::size_t, int> parts;  // of each step, so far
  for (const ExtractResult& surface : surfaces)
    text += fmt::format("    <DataSet timestep=\"{}\" part=\"{}\" file=\"{}\"/>\n", surface.step,
                        parts[surface.step]++,
                        xmlText(std::filesystem::path(surface.output).filename().string()));
  text += "  </Collection>\n</VTKFile>\n";
  AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

// -o run.pvd: each surface is a .vtp beside it. Returns the name of the list; empty: none is
// wanted.
std::string takeCollection(ExtractArguments& arguments) {
  if (lowerExtension(arguments.output) != kPvdEnding) return {};
  std::string list = arguments.output;
  arguments.output.replace(arguments.output.size() - kPvdEnding.size(), kPvdEnding.size(), ".vtp");
  refuseReplacing({list}, arguments.query.files, arguments.force);
  return list;
}

int runExtract(const CLI::App& command, ExtractArguments arguments) {
  if (arguments.drop_small && !arguments.query.simplify && !arguments.most_triangles)
    throw UsageError("--drop-small goes with --simplify or --triangles; give one of them");
  for (const AttributeOptions& attribute : arguments.attributes)
    if (attribute.kind == AttributeOptions::Kind::kComponent && arguments.part)
      throw UsageError(
          "--attribute component looks at the whole surface; leave out --part, or name a file "
          "'./component'");
  if (isShareName(arguments.output))
    for (const char* const option :
         {"--attribute", "--space", "--unit", "--shift", "--together", "--zlib", "--meshopt"})
      if (findOption(command, option)->count() > 0)
        throw UsageError(fmt::format(
            "{} does not go with a share of a mesh, {}; 'isobrick merge' may have it, or write "
            "another format",
            option, kMeshShareEnding));
  const std::string collection = takeCollection(arguments);
  std::vector<ExtractArguments> all = argumentsOfFiles(arguments);
  for (const ExtractArguments& one : all) refuseTwinIsovalues(one.query.isovalues);
  const std::size_t surfaces =
      all.size() / arguments.query.files.size() * all.front().query.isovalues.size();
  if (!arguments.colors.empty() && arguments.colors.size() != surfaces)
    throw UsageError("--color is wanted once for each isovalue, or label, in their order");
  if (isPrecomputedName(arguments.output)) {
    if (all.size() > 1)
      throw UsageError(
          "a .precomputed output is of one volume; give one FILE and one --label, or another "
          "format");
    refuseForMeshes(command, all.front().query, arguments.output, arguments.force);
    return runExtractMeshes(all.front().query, arguments.output, arguments.json);
  }
  for (const ExtractArguments& one : all) refuseOutputs(one);
  for (AttributeOptions& attribute : arguments.attributes) {
    attribute.input.cache_folder = arguments.query.input.cache_folder;
    if (attribute.isOfPyramid())
      findPyramid(attribute.input, arguments.query.threads, arguments.query.memory_bytes);
  }
  findMasks(all.front().query);
  for (ExtractArguments& one : all) {
    one.attributes = arguments.attributes;
    one.query.region = all.front().query.region;
  }
  const ExtractResults results = extractAll(std::move(all));
  if (!collection.empty()) writePvd(collection, results.surfaces);
  if (arguments.json)
    printJson(jsonOfResults(results));
  else
    printResults(results);
  return 0;
}

// Returns those that look at the whole surface.
std::vector<CLI::Option*> addDetailOptions(CLI::App& app, ExtractArguments& arguments) {
  beginGroup(app, kDetailGroup);
  const auto atLeastOne = integerWithin(1, std::numeric_limits<std::int64_t>::max());
  addSimplifyOption(app, arguments.query);
  CLI::Option* const triangles = addParsedOption(
      app, "--triangles", arguments.most_triangles, atLeastOne, "N",
      "At most N triangles: finds the distance of --simplify for that, by extracting the surface "
      "some ten times");
  triangles->excludes(findOption(app, "--simplify"));
  app.add_flag("--drop-small", arguments.drop_small,
               "With --simplify or --triangles: leave out pieces of the surface that lie in one "
               "brick and whose box has a diagonal below the distance");
  CLI::Option* const components =
      app.add_flag("--components", arguments.list_components,
                   "List the connected pieces of the surface by their area, with the volume that "
                   "each encloses, in world units");
  CLI::Option* const largest =
      addParsedOption(app, "--keep-largest", arguments.keep_largest, atLeastOne, "N",
                      "Only the N connected pieces that enclose the most, with their cavities; the "
                      "border of the volume counts as a wall. With --box, those of the largest "
                      "area. They are listed, too");
  CLI::Option* const drop_below = addParsedOption(
      app, "--drop-below", arguments.drop_below, numberFrom(0), "AREA",
      "Only connected pieces of at least this area, in squares of the world's unit");
  CLI::Option* const check =
      app.add_flag("--check", arguments.check,
                   "Report whether the mesh is closed, manifold and oriented, its boundary loops, "
                   "Euler number, area and volume, triangles that cross or have no area, least "
                   "angle and aspect. Takes some 5 bytes of memory a triangle, more with "
                   "--simplify. For shares: 'merge --check'");
  return {triangles, components, largest, drop_below, check};
}

void addOutputOptions(CLI::App& app, ExtractArguments& arguments,
                      const std::vector<CLI::Option*>& of_whole_surface) {
  beginGroup(app, kOutputGroup);
  CLI::Option* const output = addMeshOptions(
      app, arguments,
      "Output; a mesh, .ply, .stl, .obj, .glb, .vtp or .3mf, in world units; .pvd: a "
      ".vtp for each FILE, as steps of time, and their list for ParaView; "
      ".precomputed: a folder for Neuroglancer with all levels; or .isbm: a share "
      "for 'isobrick merge'. Without it the mesh is only counted. Each of several "
      "isovalues or labels gets a file: mesh-500.ply; so does each FILE, mesh-run.ply, "
      "or where {name} stands",
      true);
  CLI::Option* const part = addParsedOption(
      app, "--part", arguments.part, parseShare, "I/N",
      "Do share I of N shares, I from 1: some of the surface's bricks. 'isobrick merge' joins the "
      "shares, as .isbm, to the mesh that one run gives; another format is open where "
      "other shares begin");
  for (CLI::Option* const option : of_whole_surface) part->excludes(option);
  addAttributeOptions(app, arguments.attributes, arguments.coloring, output);
  CLI::Option* const together =
      app.add_flag("--together", arguments.together,
                   "All isovalues in one file, .glb or .3mf, each an object named by its isovalue; "
                   "or all labels, also in one mesh, whose vertices have their label: .ply, .vtp, "
                   "or .obj, as groups")
          ->needs(output);
  addRepeatedOption(
      app, "--color",
      [&arguments](const std::string& text) { arguments.colors.push_back(parseColor(text)); },
      "COLOUR",
      "With --together: colour of the surface, #rrggbb, a name such as red, or R,G,B from 0 to 1, "
      "sRGB; once for each isovalue or label")
      ->needs(together);
  addParsedOption(app, "--repeat", arguments.repeat, integerWithin(1, 1000000), "N",
                  "Extract N times; the last one is written")
      ->group(kProgramGroup);
}

}  // namespace

Command addExtractCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("extract", "Extract an isosurface of a pyramid or a volume");
  const auto arguments = std::make_shared<ExtractArguments>();
  addQueryOptions(*sub, arguments->query, true);
  addRegionOptions(*sub, arguments->query.region);
  addOutputOptions(*sub, *arguments, addDetailOptions(*sub, *arguments));
  addJsonFlag(*sub, arguments->json);
  sub->footer(R"(
Example:
  isobrick extract head.isb --iso 500,1324 --focus 128,40,128 --radius 30 -o head.ply
writes head-500.ply and head-1324.ply. ParaView offers such names as one group.
  isobrick extract run-*.isb --iso 500 -o run.pvd
writes a .vtp of each step of time, and run.pvd, with which ParaView plays them.)");
  return {sub, [sub, arguments] { return runExtract(*sub, *arguments); }};
}

}  // namespace isobrick
