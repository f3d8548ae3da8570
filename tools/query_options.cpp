#include "tools/query_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <stop_token>
#include <thread>
#include <utility>

#include "isobrick/extract/query_box.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/isovalue_suggestions.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/parse_text.h"
#include "tools/plain_text.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

// Half way from the voxels of a label, which become 1, to all others, which become 0.
constexpr double kIsovalueOfLabel = 0.5;

void refuseBoxOutside(const QueryBox& box, const Pyramid& pyramid, const std::string& path) {
  const Index3 last = pyramid.lattice().voxels() - Index3(1);
  for (int axis = 0; axis < 3; ++axis)
    if (!(box.min[axis] < static_cast<double>(last[axis]) && box.max[axis] > 0))
      throw Error(fmt::format("the box of --box lies outside of '{}', whose voxels are 0,0,0 to "
                              "{},{},{} (with --world, the box is in world units); move it there",
                              path, last.x, last.y, last.z),
                  {.path = path});
}

// Takes "500,1200" or "auto".
void readIsovalues(QueryOptions& options, const std::string& text, bool several) {
  const std::size_t before = options.isovalues.size();
  for (std::size_t begin = 0, end = 0; end != std::string::npos; begin = end + 1) {
    end = text.find(',', begin);
    const std::string word = text.substr(begin, end - begin);
    if (word != "auto") static_cast<void>(parseSingle(word));  // no voxel is larger
    options.isovalues.push_back(word == "auto" ? std::nullopt : std::optional(parseNumber(word)));
  }
  if (options.isovalues.size() > 1 && !several)
    throw std::invalid_argument("one isovalue is wanted; 'isobrick extract' takes several");
  options.isovalue = options.isovalues.front().value_or(0);
  options.isovalues_by_word.push_back(options.isovalues.size() - before);
}

SimplifyOptions parseSimplify(const std::string& text) {
  bool in_world = false;
  const double distance = parserOfLengths(parseNumber, in_world)(text);
  if (!(distance > 0)) throw std::invalid_argument("a distance is wanted that is above 0");
  return {distance, in_world};
}

}  // namespace

void addQueryOptions(CLI::App& app, QueryOptions& options, bool several) {
  options.threads = allCores();
  (several ? addVolumeInputs(app, options.files) : addVolumeInput(app, options.input))->required();
  beginGroup(app, kSurfaceGroup);
  CLI::Option* const isovalue = addRepeatedOption(
      app, "--iso",
      [&options, several](const std::string& text) { readIsovalues(options, text, several); },
      several ? "V,..." : "V",
      "Isovalue; values of at least V are inside (see --inside). 'auto' is the first one that "
      "`isobrick info` "
      "suggests" +
          std::string(several
                          ? ". With several, 500,1200, each is a surface of its own. Of several "
                            "FILE once for all, or once for each, in their order"
                          : ""));
  isovalue->required();
  const Choices<std::optional<InsideOf>> sides = {
      {"above", InsideOf::kAbove}, {"below", InsideOf::kBelow}, {"auto", std::nullopt}};
  addChoiceOption(app, "--inside", options.inside, sides, "above|below|auto",
                  "Where the object is: values of at least the isovalue (default), or those below "
                  "it. Normals look away from it. 'auto': below for a level set of OpenVDB, else "
                  "above");
  beginGroup(app, kDetailGroup);
  addChoiceOptions(app, options.choice);
  addRepeatedOption(
      app, "--or-finer",
      [&options](const std::string& text) { options.or_finer.push_back(parseChoice(text)); },
      "CHOICE",
      "Refine the cells of another choice too, such as 'focus=10,20,30 radius=5'; may be given "
      "again. Focus, curvature, eye and level that are given together leave cells coarse together");
  beginGroup(app, kSurfaceGroup);
  addBoxOption(app, options.box, &options.box_in_world);
  app.add_flag(
      "--cap", options.cap,
      "Close the surface where it leaves the volume, or the part of it that is asked for, as if "
      "all values beyond were outside: the mesh is that of a solid. A --box grows until it cuts no "
      "cell. Beside voxels without data (--mask-nan) the surface stays open");
  app.add_flag("--world", options.world,
               "--focus, --radius and --box are in world units. The radius is divided by the least "
               "spacing, so that the whole world sphere is of the finest level; on an oblique "
               "volume the box becomes the least box of indices around it");
  addVolumeOptions(app, options.input);
  findOption(app, "--label")->excludes(isovalue)->each([&options, isovalue](const std::string&) {
    isovalue->required(false);
    options.isovalue = kIsovalueOfLabel;
    options.isovalues = {options.isovalue};
  });
  beginGroup(app, kResourceGroup);
  addMemoryOption(app, options.memory_bytes);
  addNoMapFlag(app, options.no_map);
  addThreadsOption(app, options.threads);
}

QueryOptions queryOfFile(const QueryOptions& all, std::size_t file) {
  QueryOptions one = all;
  one.input.path = all.files.at(file);
  const std::vector<std::size_t>& counts = all.isovalues_by_word;
  if (all.files.size() == 1 || counts.size() <= 1) return one;
  if (counts.size() != all.files.size())
    throw UsageError(
        fmt::format("--iso is given {} times for {} files; give it once for all, or "
                    "once for each, in their order",
                    counts.size(), all.files.size()));
  auto own = all.isovalues.begin();
  for (std::size_t i = 0; i < file; ++i) own += static_cast<std::ptrdiff_t>(counts[i]);
  one.isovalues.assign(own, own + static_cast<std::ptrdiff_t>(counts[file]));
  one.isovalue = one.isovalues.front().value_or(0);
  return one;
}

void addNoMapFlag(CLI::App& app, bool& no_map) {
  app.add_flag("--no-map", no_map,
               "Read all of the file and map nothing of it: for network file systems; the result "
               "is the same");
}

namespace {

// An open remote pyramid. Ctrl-C ends every read of it, also one without a cancel flag.
class InterruptiblePyramid {
 public:
  explicit InterruptiblePyramid(std::shared_ptr<const Pyramid> pyramid)
      : pyramid_(std::move(pyramid)), watcher_([this](const std::stop_token& ended) {
          // Calls that look at the flag themselves come first, and say how far they were.
          constexpr auto kBetweenLooks = std::chrono::milliseconds(50);
          constexpr int kPatience = 6;
          int looks = 0;
          while (!ended.stop_requested() && looks < kPatience) {
            std::this_thread::sleep_for(kBetweenLooks);
            looks += interruptFlag().requested() ? 1 : 0;
          }
          if (looks == kPatience) pyramid_->parts().tables().bytes().abandonReads();
        }) {}
  const Pyramid& pyramid() const { return *pyramid_; }

 private:
  const std::shared_ptr<const Pyramid> pyramid_;
  std::jthread watcher_;  // ends before the pyramid does
};

}  // namespace

std::shared_ptr<const Pyramid> openPyramidFile(const std::string& path, std::uint64_t memory_bytes,
                                               FileAccess access, const RemoteOptions& remote) {
  if (!isRemotePath(path))
    return std::make_shared<const Pyramid>(path, memory_bytes, access, remote);
  auto pyramid = runAbandonable(&interruptFlag(), [=] {
    return std::make_shared<const Pyramid>(path, memory_bytes, access, remote);
  });
  const auto watched = std::make_shared<InterruptiblePyramid>(std::move(pyramid));
  return {watched, &watched->pyramid()};
}

void addSimplifyOption(CLI::App& app, QueryOptions& options) {
  addParsedOption(
      app, "--simplify", options.simplify, parseSimplify, "D",
      "Fewer triangles: of each brick, within D voxels of the least spacing of the "
      "surface as it is without this, either way; with a unit, 0.2mm or 50um, in the world");
}

void findPyramid(QueryOptions& options) {
  findPyramid(options.input, options.threads, options.memory_bytes);
}

std::string valueText(const Pyramid& pyramid, double value) {
  return pyramid.spec().values.isIdentity() ? fmt::format("{}", static_cast<float>(value))
                                            : fmt::format("{}", value);
}

void findMasks(QueryOptions& options) {
  findMasks(options.region, options.input.cache_folder, options.threads, options.memory_bytes);
}

void openMasks(QueryOptions& options, std::uint64_t memory_bytes) {
  openMasks(options.region, memory_bytes, fileAccess(options.no_map), remoteOptions(options.input));
}

void chooseIsovalues(QueryOptions& options, const Pyramid& pyramid) {
  std::optional<double> best;
  for (std::optional<double>& isovalue : options.isovalues) {
    if (isovalue) continue;
    if (!best) {
      const IsovalueSuggestions suggestions = suggestIsovalues(pyramid);
      if (suggestions.values.empty())
        throw Error(fmt::format("all voxels of '{}' are {}: no isovalue has a surface",
                                withoutSecrets(options.input.path),
                                valueText(pyramid, pyramid.realRange().min)));
      best = suggestions.values.front().value;
      fmt::print(stderr, "isobrick: isovalue {}\n", *best);
    }
    isovalue = best;
  }
  if (!options.isovalues.empty()) options.isovalue = *options.isovalues.front();
}

InsideOf insideOfClass(const std::string& vdb_class) {
  return vdb_class == "level set" ? InsideOf::kBelow : InsideOf::kAbove;
}

InsideOf insideOf(const QueryOptions& options, const Pyramid& pyramid) {
  if (options.inside) return *options.inside;
  const nlohmann::json provenance = parseShallowJson(pyramid.provenance());
  return insideOfClass(textOf(member(member(provenance, "properties"), "vdb.class")));
}

Query makeQuery(const QueryOptions& options, const Pyramid& pyramid) {
  const GridGeometry& geometry = pyramid.spec().geometry;
  Query query;
  query.isovalue = options.isovalue;
  query.inside = insideOf(options, pyramid);
  static_cast<DetailChoice&>(query) = makeChoice(options.choice, options.world, pyramid);
  for (const ChoiceOptions& choice : options.or_finer)
    query.or_finer.push_back(makeChoice(choice, options.world, pyramid));
  if (options.box) {
    if (options.box_in_world) refuseUnitOfUnknown(geometry, "--box");
    query.box = QueryBox{options.box->lower, options.box->upper};
    if (options.world || options.box_in_world) query.box = indexBoxAround(*query.box, geometry);
    refuseBoxOutside(*query.box, pyramid, withoutSecrets(options.input.path));
  }
  if (options.simplify && options.simplify->in_world && geometry.unit == LengthUnit::kUnknown) {
    throw Error(fmt::format(
        "a distance of {} mm: the unit of '{}' is unknown; give it in voxels, whose least spacing "
        "is {}",
        options.simplify->distance, withoutSecrets(options.input.path), geometry.leastSpacing()));
  }
  query.region = makeRegion(options.region, options.world, geometry);
  query.cap = options.cap;
  query.simplify = options.simplify;
  query.cancel = &interruptFlag();
  return query;
}

bool warnOfEmptySurface(const QueryOptions& options, const Pyramid& pyramid) {
  return warnOfEmptySurface(options.input, options.isovalue, pyramid, pyramid.valueRange());
}

bool warnOfEmptySurface(const VolumeInput& input, double isovalue, const Pyramid& pyramid,
                        const ValueRange& range) {
  if (range.crosses(pyramid.storedIsovalue(isovalue))) return false;
  if (const auto label = input.derivation.find("--label");
      label != input.derivation.end() && !label->second.empty()) {
    fmt::print(stderr, "isobrick: warning: the mesh is empty: {} voxel of '{}' has the label {}\n",
               range.max > 0 ? "every" : "no", oneLine(withoutSecrets(input.path)), label->second);
    return true;
  }
  const ValueTransform& values = pyramid.spec().values;
  fmt::print(stderr,
             "isobrick: warning: the mesh is empty: no surface at the isovalue {}, since the "
             "values of '{}' are {} to {}\n",
             isovalue, oneLine(withoutSecrets(input.path)),
             valueText(pyramid, values.real(static_cast<double>(range.min))),
             valueText(pyramid, values.real(static_cast<double>(range.max))));
  return true;
}

void refuseTwinIsovalues(std::vector<std::optional<double>> isovalues) {
  std::sort(isovalues.begin(), isovalues.end());
  const auto twin = std::adjacent_find(isovalues.begin(), isovalues.end());
  if (twin != isovalues.end())
    throw UsageError(fmt::format("the isovalue {} is given twice; leave one out",
                                 *twin ? fmt::format("{}", **twin) : "auto"));
}

}  // namespace isobrick
