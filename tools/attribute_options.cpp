#include "tools/attribute_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <tuple>

#include "isobrick/extract/mesh_distance.h"
#include "isobrick/extract/read_mesh_file.h"
#include "isobrick/extract/wall_thickness.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/extract_report.h"
#include "tools/interrupt.h"
#include "tools/plain_text.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

using AttributeKind = AttributeOptions::Kind;

std::optional<double> numberOrNothing(const std::string& text) {
  try {
    return parseNumber(text);
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
}

// "[NAME=]WHAT"
AttributeOptions parseAttribute(const std::string& word) {
  AttributeOptions options;
  std::string what = word;
  if (const std::size_t equals = word.find('=');
      equals != std::string::npos && isAttributeName(word.substr(0, equals))) {
    options.name = word.substr(0, equals);
    what = word.substr(equals + 1);
  }
  const auto named = [&](AttributeKind kind, const char* name) {
    options.kind = kind;
    if (options.name.empty()) options.name = name;
  };
  const auto behind = [&](std::string_view prefix) -> std::optional<std::string> {
    return what.starts_with(prefix) ? std::optional(what.substr(prefix.size())) : std::nullopt;
  };
  if (what == kComponentAttribute) {
    named(AttributeKind::kComponent, kComponentAttribute);
  } else if (what == "thickness") {
    named(AttributeKind::kThickness, "thickness");
  } else if (const auto limit = behind("thickness:")) {
    named(AttributeKind::kThickness, "thickness");
    options.limit = parseNumber(*limit);
    if (!(*options.limit > 0)) throw std::invalid_argument("a thickness is above 0");
  } else if (const auto other = behind("distance:")) {
    options.limit = numberOrNothing(*other);
    named(options.limit ? AttributeKind::kValueDistance : AttributeKind::kMeshDistance, "distance");
    if (!options.limit) options.input.path = *other;
  } else if (const auto labels = behind("nearest:")) {
    named(AttributeKind::kNearest, "label");
    options.input.path = *labels;
  } else {
    named(AttributeKind::kValue, "value");
    options.input.path = what;
  }
  return options;
}

// "viridis", "viridis:0:5"
ColoringOptions parseColorMap(const std::string& word) {
  const std::size_t colon = word.find(':');
  const auto found = std::ranges::find(kColorMapNames, std::string_view(word).substr(0, colon));
  if (found == kColorMapNames.end())
    throw std::invalid_argument(
        fmt::format("'{}' is no map; take one of {}", word, fmt::join(kColorMapNames, ", ")));
  ColoringOptions options;
  options.map = static_cast<ColorMap>(found - kColorMapNames.begin());
  if (colon == std::string::npos) return options;
  const std::size_t second = word.find(':', colon + 1);
  if (second == std::string::npos)
    throw std::invalid_argument("a map's range is NAME:MIN:MAX, such as viridis:0:5");
  options.range = {parseNumber(word.substr(colon + 1, second - colon - 1)),
                   parseNumber(word.substr(second + 1))};
  if (!(options.range->first < options.range->second))
    throw std::invalid_argument("a map's range goes from a number to a greater one");
  return options;
}

}  // namespace

void addAttributeOptions(CLI::App& app, std::vector<AttributeOptions>& attributes,
                         ColoringOptions& coloring, CLI::Option* output) {
  addRepeatedOption(
      app, "--attribute",
      [&](const std::string& word) { attributes.push_back(parseAttribute(word)); }, "[NAME=]WHAT",
      "A number for every vertex of .ply, .vtp and .glb; may be given again. OTHER: the value of "
      "another pyramid or volume where the vertex is in the world, level 0, trilinear (value); "
      "nearest:OTHER: of its nearest voxel, for labels, whole numbers as they are (label); "
      "component: the number of the connected piece, 0 the one of the largest area, as "
      "--components lists them (component); thickness[:MOST]: the world length of a ray inward "
      "until it leaves the inside, at most MOST (thickness); distance:MESH.ply, .stl, or "
      "distance:ISOVALUE: the world distance from that surface, below 0 inside of a closed one "
      "(distance). All pyramids share --memory")
      ->needs(output);
  CLI::Option* const color_by =
      app.add_option("--color-by", coloring.attribute,
                     "Colours for the vertices of .ply, .glb and .obj by the attribute of this "
                     "name: labels and components get one each, other numbers those of --colormap")
          ->type_name("NAME")
          ->needs(output);
  addRepeatedOption(
      app, "--colormap",
      [&](const std::string& word) {
        const ColoringOptions map = parseColorMap(word);
        coloring.map = map.map;
        coloring.range = map.range;
      },
      "MAP[:MIN:MAX]",
      "For --color-by: viridis (default), cividis, inferno, cool_warm or grey, from the value MIN "
      "to MAX; default: all values of the other pyramid, or 0 to the greatest thickness")
      ->needs(color_by);
}

std::uint64_t pyramidsOf(const std::vector<AttributeOptions>& attributes) {
  return static_cast<std::uint64_t>(
      std::ranges::count_if(attributes, &AttributeOptions::isOfPyramid));
}

AttributeFields::AttributeFields(const std::vector<AttributeOptions>& options,
                                 const ColoringOptions& coloring, std::uint64_t memory_bytes,
                                 bool no_map, const RemoteOptions& remote)
    : options_(options), coloring_(coloring) {
  const std::uint64_t each = memory_bytes / std::max<std::uint64_t>(1, pyramidsOf(options));
  for (const AttributeOptions& one : options) {
    pyramids_.emplace_back();
    sampled_.emplace_back();
    if (one.kind == AttributeKind::kMeshDistance)
      fields_["mesh " + one.input.path] =
          std::make_unique<MeshDistance>(readMeshFile(one.input.path));
    if (!one.isOfPyramid()) continue;
    pyramids_.back() = openPyramidFile(one.input.pyramid, each, fileAccess(no_map), remote);
    sampled_.back() = std::make_unique<PyramidValues>(
        *pyramids_.back(),
        one.kind == AttributeKind::kNearest ? Sampling::kNearest : Sampling::kTrilinear);
  }
}

const VertexValues* AttributeFields::fieldOf(const AttributeOptions& options,
                                             const QueryOptions& query, const Pyramid* pyramid,
                                             Extractor* extractor) {
  std::string what;
  if (options.kind == AttributeKind::kThickness)
    what = fmt::format("thickness {} {}", query.isovalue, options.limit.value_or(0));
  else if (options.kind == AttributeKind::kValueDistance)
    what = fmt::format("isovalue {}", *options.limit);
  else
    what = "mesh " + options.input.path;
  std::unique_ptr<const VertexValues>& field = fields_[what];
  if (field == nullptr && options.kind == AttributeKind::kThickness) {
    field = std::make_unique<WallThickness>(
        *pyramid, query.isovalue, options.limit.value_or(std::numeric_limits<double>::infinity()),
        insideOf(query, *pyramid));
  } else if (field == nullptr) {
    Query other;
    other.isovalue = *options.limit;
    other.cancel = &interruptFlag();
    IndexedMeshSink sink;
    extractor->extract(other, sink);
    field = std::make_unique<MeshDistance>(sink.takeMesh());
  }
  return field.get();
}

SurfaceAttributes AttributeFields::of(const QueryOptions& query, const Pyramid* pyramid,
                                      Extractor* extractor) {
  SurfaceAttributes surface;
  for (std::size_t i = 0; i < options_.size(); ++i) {
    const AttributeOptions& options = options_[i];
    VertexAttribute attribute{options.name};
    surface.sampled.push_back(sampled_[i].get());
    if (options.isOfPyramid())
      attribute.values = sampled_[i].get();
    else if (options.kind != AttributeKind::kComponent)
      attribute.values = fieldOf(options, query, pyramid, extractor);
    if (options.kind == AttributeKind::kNearest) attribute.type = labelTypeOf(*pyramids_[i]);
    if (options.kind == AttributeKind::kComponent) attribute.type = AttributeType::kUint32;
    surface.attributes.push_back(attribute);
  }
  if (!coloring_.attribute.empty()) surface.colors = colorsOf(surface);
  return surface;
}

VertexColors AttributeFields::colorsOf(const SurfaceAttributes& surface) const {
  const auto found =
      std::ranges::find(surface.attributes, coloring_.attribute, &VertexAttribute::name);
  if (found == surface.attributes.end())
    throw UsageError(fmt::format("--color-by: there is no attribute '{}'; give --attribute with it",
                                 coloring_.attribute));
  VertexColors colors;
  colors.attribute = static_cast<std::size_t>(found - surface.attributes.begin());
  const AttributeOptions& options = options_[colors.attribute];
  colors.map = coloring_.map;
  const bool is_whole = found->type != AttributeType::kFloat32;
  if (!colors.map && is_whole) return colors;
  if (!colors.map) colors.map = ColorMap::kViridis;
  if (coloring_.range) {
    std::tie(colors.low, colors.high) = *coloring_.range;
  } else if (options.isOfPyramid()) {
    const RealRange range = pyramids_[colors.attribute]->realRange();
    colors.low = range.min;
    colors.high = range.max > range.min ? range.max : range.min + 1;
  } else if (options.kind == AttributeKind::kThickness && options.limit) {
    colors.high = *options.limit;
  } else {
    throw UsageError(
        fmt::format("--color-by: the range of '{}' is not known before the mesh is; "
                    "give it with --colormap {}:MIN:MAX",
                    found->name, kColorMapNames[static_cast<std::size_t>(*colors.map)]));
  }
  return colors;
}

void warnOfVerticesOutside(const std::vector<AttributeOptions>& options,
                           const SurfaceAttributes& attributes,
                           const std::vector<std::uint64_t>& outside, std::uint64_t vertices,
                           const std::string& output) {
  for (std::size_t i = 0; i < outside.size(); ++i) {
    if (outside[i] == 0) continue;
    const AttributeType type = attributes.attributes[i].type;
    const bool has_nan = (type == AttributeType::kFloat32 || type == AttributeType::kFloat64) &&
                         lowerExtension(output) != ".glb";
    fmt::print(stderr,
               "isobrick: warning: {} of {} vertices lie outside of '{}' and have no value ({} in "
               "the file)\n",
               countText(outside[i]), countText(vertices),
               oneLine(withoutSecrets(options[i].input.path)), has_nan ? "NaN" : "0");
  }
}

}  // namespace isobrick
