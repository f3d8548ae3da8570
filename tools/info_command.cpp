// isobrick info: the facts of a pyramid.
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/isovalue_suggestions.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/json_output.h"
#include "tools/plain_text.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"
#include "tools/volume_input.h"
#if ISOBRICK_WITH_VIEWER
#include "isobrick/viewer/render/gl_device.h"
#endif

namespace isobrick {
namespace {

struct InfoArguments {
  VolumeInput input;
  bool no_map = false;
  bool json = false;
  bool graphics = false;
};

// The provenance as an object. The file may be hostile: text that is no JSON, or nested too deep,
// is given as text.
Json provenanceOf(const Pyramid& pyramid) {
  Json json = parseShallowJson<Json>(pyramid.provenance());
  return json.is_discarded() ? Json(pyramid.provenance()) : json;
}

// Where level 0 of an index lies; nothing for other pyramids.
std::string sourceOfLevel0(const Pyramid& pyramid) {
  if (pyramid.spec().level0 == Level0Place::kStored) return {};
  const auto json = parseShallowJson(pyramid.provenance());
  const std::string path = textOf(member(member(json, "level0"), "path"));
  return path.empty() ? "its source" : path;
}

Json jsonOfCodecs(const CodecCounts& counts) {
  Json json = Json::object();
  for (std::uint32_t codec = 0; codec < counts.size(); ++codec)
    if (counts[codec] > 0)
      json[std::string(codecName(static_cast<format::Codec>(codec)))] = counts[codec];
  return json;
}

// "812 lz4, 3 stored, 190 constant": the most frequent first.
std::string codecsText(const CodecCounts& counts) {
  std::vector<std::uint32_t> codecs(counts.size());
  std::iota(codecs.begin(), codecs.end(), 0u);
  std::stable_sort(codecs.begin(), codecs.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return counts[a] > counts[b]; });
  std::string text;
  for (const std::uint32_t codec : codecs)
    if (counts[codec] > 0)
      text += fmt::format("{}{} {}", text.empty() ? "" : ", ", countText(counts[codec]),
                          codecName(static_cast<format::Codec>(codec)));
  return text;
}

Json jsonOfSuggestions(const IsovalueSuggestions& suggestions) {
  Json values = Json::array();
  for (const IsovalueSuggestion& suggestion : suggestions.values)
    values.push_back({{"value", suggestion.value},
                      {"area", suggestion.area},
                      {"gradient", suggestion.gradient}});
  return values;
}

// "DAPI #0000ff", as far as it has them; the file may be hostile.
std::string channelText(const Json& channel) {
  std::string text;
  for (const char* const key : {"name", "color"})
    if (channel.is_object() && channel.contains(key) && channel[key].is_string())
      text +=
          fmt::format("{}{}", text.empty() ? "" : " ", oneLine(channel[key].get<std::string>()));
  return text;
}

// The values that are padding: none, one or two.
std::vector<double> paddingOf(const IsovalueSuggestions& suggestions) {
  std::vector<double> padding;
  for (const auto& value : {suggestions.padding_least, suggestions.padding_greatest})
    if (value) padding.push_back(*value);
  return padding;
}

std::string suggestionsText(const IsovalueSuggestions& suggestions) {
  if (suggestions.values.empty()) return "none: all voxels are equal";
  std::string text;
  for (const IsovalueSuggestion& suggestion : suggestions.values)
    text += fmt::format("{}{}", text.empty() ? "" : ", ", suggestion.value);
  for (const double value : paddingOf(suggestions)) text += fmt::format("; padding {}", value);
  return text + (suggestions.values.size() > 1 ? " (suggested, best first)" : " (suggested)");
}

// `sums`: nothing if the rows of all bricks cannot be read.
void printInfoJson(const Pyramid& pyramid, const std::optional<PyramidSums>& sums) {
  const PyramidSpec& spec = pyramid.spec();
  const IsovalueSuggestions suggestions = suggestIsovalues(pyramid);
  Json json = Json::object();
  json["pyramid"] = withoutSecrets(pyramid.path());
  putGrid(spec.voxels, spec.voxel_type, spec.geometry, json);
  json["value_range"] = {pyramid.realRange().min, pyramid.realRange().max};
  // Value = offset + scale * the number that is stored as voxel_type.
  json["stored_values"] = {{"scale", spec.values.scale}, {"offset", spec.values.offset}};
  json["noise"] = spec.values.scale * pyramid.noise();
  json["isovalues"] = jsonOfSuggestions(suggestions);
  json["padding"] = paddingOf(suggestions);
  json["levels"] = jsonOfLevels(pyramid.layout());
  json["bytes"] = sums ? jsonOfBytes(sums->bytes) : Json(nullptr);
  json["codecs"] = nullptr;
  // Bricks of all levels by the codec of their part, such as {"lz4": 812, "stored": 3}.
  if (sums)
    json["codecs"] = {{"samples", jsonOfCodecs(sums->codecs.samples)},
                      {"ranges", jsonOfCodecs(sums->codecs.ranges)},
                      {"curvature", jsonOfCodecs(sums->codecs.curvature)}};
  json["division"] = nullptr;
  if (const PyramidDivision* const division = pyramid.parts().tables().division())
    json["division"] = {{"super_brick_cells", division->superBricks().cells()},
                        {"files", division->fileCount()},
                        {"index_bytes", division->indexBytes()}};
  const std::string source = sourceOfLevel0(pyramid);
  json["level0"] = source.empty() ? Json(nullptr) : Json({{"path", source}});
  json["brick_cells"] = spec.brick_cells;
  json["tile_cells"] = spec.tile_cells;
  json["has_curvature"] = spec.has_curvature;
  json["curvature_epsilon"] = spec.curvature_epsilon;
  json["filter"] = filterName(spec.filter);
  json["provenance"] = provenanceOf(pyramid);
  printJson(json);
}

void printSums(const PyramidSums& sums) {
  const auto& [bytes, codecs] = sums;
  fmt::print(
      "bytes      {} ({:.2f} x raw): level 0 {} (of it aprons {}), coarser {}, ranges {}, "
      "curvature {}, index {}\n",
      byteSizeText(bytes.total), static_cast<double>(bytes.total) / static_cast<double>(bytes.raw),
      byteSizeText(bytes.samples_level0), byteSizeText(bytes.aprons_level0),
      byteSizeText(bytes.samples_coarser), byteSizeText(bytes.ranges),
      byteSizeText(bytes.curvature), byteSizeText(bytes.index));
  fmt::print("samples    {}\nranges     {}\ncurvature  {}\n", codecsText(codecs.samples),
             codecsText(codecs.ranges), codecsText(codecs.curvature));
}

void printInfoText(const Pyramid& pyramid, const std::string& path,
                   const std::optional<PyramidSums>& sums) {
  const PyramidSpec& spec = pyramid.spec();
  const GridGeometry& geometry = spec.geometry;
  const RealRange range = pyramid.realRange();
  fmt::print("{}: {} x {} x {} {}, values {} to {}\n", path, spec.voxels.x, spec.voxels.y,
             spec.voxels.z, voxelTypeName(spec.voxel_type), valueText(pyramid, range.min),
             valueText(pyramid, range.max));
  if (path != pyramid.path()) fmt::print("pyramid    {} (in the cache)\n", pyramid.path());
  if (!spec.values.isIdentity())
    fmt::print("stored     as {} + {} x number\n", spec.values.offset, spec.values.scale);
  fmt::print("noise      {:.3g} (sigma, estimated)\n", spec.values.scale * pyramid.noise());
  fmt::print("isovalues  {}\n", suggestionsText(suggestIsovalues(pyramid)));
  const char* const unit =
      geometry.unit == LengthUnit::kMillimetre ? " mm" : " (of an unknown unit)";
  fmt::print("spacing    {} {} {}{}\n", geometry.spacing.x, geometry.spacing.y, geometry.spacing.z,
             unit);
  fmt::print("origin     {} {} {}{}\n", geometry.origin.x, geometry.origin.y, geometry.origin.z,
             unit);
  for (int axis = 0; axis < 3; ++axis) {
    const glm::dvec3& to = geometry.direction[axis];
    fmt::print("axis {}     {} {} {}\n", "xyz"[axis], to.x, to.y, to.z);
  }
  if (const PyramidDivision* const division = pyramid.parts().tables().division())
    fmt::print("files      {}, one for each {} cells along an edge, and an index of {}\n",
               division->fileCount(), division->superBricks().cells(),
               byteSizeText(division->indexBytes()));
  fmt::print("bricks     {} cells, tiles {} cells; filter {}; curvature {}\n", spec.brick_cells,
             spec.tile_cells, filterName(spec.filter), spec.has_curvature ? "yes" : "no");
  if (const std::string source = sourceOfLevel0(pyramid); !source.empty())
    fmt::print("level 0    stays in {}\n", oneLine(source));
  if (sums) printSums(*sums);
  for (int level = 0; level < pyramid.lattice().levels(); ++level) {
    const Index3 samples = pyramid.lattice().samples(level);
    fmt::print("level {:<4} {} x {} x {} samples, {} bricks\n", level, samples.x, samples.y,
               samples.z, elementCount(pyramid.layout().bricks(level)));
  }
  if (const Json made = provenanceOf(pyramid); made.is_object() && made.contains("channel"))
    fmt::print("channel    {}\n", channelText(made["channel"]));
  fmt::print("made from  {}\n", oneLine(pyramid.provenance()));
}

// The time steps and the channels that --select chooses from.
void printMembers(const Json& facts) {
  if (const auto steps = facts["time_steps"].get<std::int64_t>(); steps > 1)
    fmt::print("time       {} steps; --select time=N takes one, from 0\n",
               countText(static_cast<std::uint64_t>(steps)));
  const Json& channels = facts["channels"];
  for (std::size_t i = 0; i < channels.size() && channels.size() > 1; ++i)
    fmt::print("channel {:<2} {}\n", i, channelText(channels[i]));
}

// Of a volume without a pyramid: see factsOfVolume().
void printFactsText(const Json& facts, const std::string& path) {
  const auto numbers = [](const Json& list) {
    std::string text;
    for (const Json& number : list)
      text += fmt::format("{}{}", text.empty() ? "" : " ", number.get<double>());
    return text;
  };
  const Json& dimensions = facts["dimensions"];
  fmt::print("{}: {} x {} x {} {}, {}\n", path, dimensions[0].dump(), dimensions[1].dump(),
             dimensions[2].dump(), facts["voxel_type"].get<std::string>(),
             facts["format"].get<std::string>());
  if (!facts["value_range"].is_null())
    fmt::print("values     {} to {}, in a sample of {} voxels\n",
               facts["value_range"][0].get<float>(), facts["value_range"][1].get<float>(),
               countText(facts["sampled_voxels"].get<std::uint64_t>()));
  const std::string unit = facts["length_unit"] == "millimetres" ? " mm" : " (of an unknown unit)";
  fmt::print("spacing    {}{}\norigin     {}{}\n", numbers(facts["spacing"]), unit,
             numbers(facts["origin"]), unit);
  for (std::size_t axis = 0; axis < 3; ++axis)
    fmt::print("axis {}     {}\n", "xyz"[axis], numbers(facts["direction"][axis]));
  printMembers(facts);
  fmt::print("bytes      {} of voxels\n", byteSizeText(facts["bytes"]["raw"].get<std::uint64_t>()));
  for (const Json& note : facts["notes"])
    fmt::print("note       {}\n", oneLine(note.get<std::string>()));
  fmt::print("pyramid    none yet; 'isobrick build' makes one, and says more\n");
}

#if ISOBRICK_WITH_VIEWER
void printGraphicsJson(const GraphicsReport& report) {
  Json json = Json::object();
  json["device"] = report.device;
  json["vendor"] = report.vendor;
  json["version"] = report.version;
  json["software"] = report.is_software;
  json["place"] = report.place;
  json["places"] = Json::array();
  for (const GraphicsReport::Place& place : report.places)
    json["places"].push_back({{"name", place.name}, {"about", place.about}});
  json["limits"] = Json::object();
  for (const GlLimits::Row& row : report.limits)
    json["limits"][row.name] = {{"value", row.value}, {"wanted", row.wanted}};
  json["switched_off"] = report.switched_off;
  printJson(json);
}

// Of what draws on this machine.
void printGraphics(bool json) {
  const GraphicsReport report = graphicsReport();
  if (json) return printGraphicsJson(report);
  fmt::print("device   {}{}\nversion  {}\nvendor   {}\n", report.device,
             report.is_software ? " (the processor draws)" : "", report.version, report.vendor);
  std::string places;
  for (const GraphicsReport::Place& place : report.places)
    places += fmt::format("{}{}{}", places.empty() ? "" : ", ", place.name,
                          place.about.empty() ? "" : " (" + place.about + ")");
  fmt::print("found    {}, of {} (ISOBRICK_GRAPHICS chooses)\n\n", report.place, places);
  TextTable table("LRRL");
  table.add({"limit", "here", "wanted", "with less"});
  for (const GlLimits::Row& row : report.limits)
    table.add({row.name, std::to_string(row.value),
               row.wanted == 0 ? "-" : std::to_string(row.wanted), row.with_less});
  fmt::print("{}\n", table.text());
  if (report.switched_off.empty()) fmt::print("Nothing is switched off.\n");
  for (const std::string& line : report.switched_off) fmt::print("Here {}.\n", line);
}
#endif

int runInfo(InfoArguments& arguments) {
#if ISOBRICK_WITH_VIEWER
  if (arguments.graphics) {
    printGraphics(arguments.json);
    return 0;
  }
#endif
  if (arguments.input.path.empty()) throw UsageError("FILE is required");
  if (const std::string text = findPyramidOrFacts(arguments.input); !text.empty()) {
    const Json facts = Json::parse(text);
    if (arguments.json)
      printJson(facts);
    else
      printFactsText(facts, arguments.input.path);
    return 0;
  }
  const auto file = openPyramidFile(arguments.input.pyramid, Pyramid::kDefaultBudgetBytes,
                                    fileAccess(arguments.no_map), remoteOptions(arguments.input));
  const Pyramid& pyramid = *file;
  std::optional<PyramidSums> sums;
  std::optional<Error> fault;
  try {
    sums = pyramid.sums();
  } catch (const Error& error) {
    // A file of a divided pyramid that is lost: the index says all the rest.
    if (pyramid.parts().tables().division() == nullptr) throw;
    fault = error;
  }
  if (arguments.json)
    printInfoJson(pyramid, sums);
  else
    printInfoText(pyramid, withoutSecrets(arguments.input.path), sums);
  if (fault) throw *fault;
  return 0;
}

}  // namespace

Command addInfoCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("info", "Say what a pyramid or a volume holds");
  const auto arguments = std::make_shared<InfoArguments>();
  CLI::Option* const file = addVolumeInput(*sub, arguments->input);
  addVolumeOptions(*sub, arguments->input);
  addNoMapFlag(*sub, arguments->no_map);
  addJsonFlag(*sub, arguments->json);
#if ISOBRICK_WITH_VIEWER
  sub->add_flag("--graphics", arguments->graphics,
                "Say what draws pictures on this machine, and its limits, in place of a FILE's "
                "facts")
      ->excludes(file);
  sub->footer(R"(
Examples:
  isobrick info head.isb --json
  isobrick info --graphics
  ISOBRICK_GRAPHICS=software isobrick info --graphics    another device of those it lists)");
#else
  file->required();
  sub->footer(R"(
Example:
  isobrick info head.isb --json)");
#endif
  return {sub, [arguments] { return runInfo(*arguments); }};
}

}  // namespace isobrick
