// --attribute, --color-by and --colormap of `isobrick extract`: from words to what a mesh file
// takes.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "tools/query_options.h"
#include "tools/volume_input.h"

namespace isobrick {

// One --attribute.
struct AttributeOptions {
  enum class Kind {
    kValue,          // of another pyramid or volume, trilinear
    kNearest,        // the same at the nearest voxel
    kComponent,      // the number of the component
    kThickness,      // of the wall behind the surface
    kMeshDistance,   // from a mesh in a file
    kValueDistance,  // from the surface of another isovalue
  };
  Kind kind = Kind::kValue;
  std::string name;
  VolumeInput input;            // the pyramid or volume, or the file of the mesh
  std::optional<double> limit;  // the greatest thickness, or the isovalue

  bool isOfPyramid() const { return kind == Kind::kValue || kind == Kind::kNearest; }
  // Needs the pyramid of the surface itself.
  bool isOfSurface() const { return kind == Kind::kThickness || kind == Kind::kValueDistance; }
};

struct ColoringOptions {
  std::string attribute;  // empty: no colours
  std::optional<ColorMap> map;
  std::optional<std::pair<double, double>> range;
};

// Both need `output`.
void addAttributeOptions(CLI::App& app, std::vector<AttributeOptions>& attributes,
                         ColoringOptions& coloring, CLI::Option* output);

// The attributes of one surface's vertices.
struct SurfaceAttributes {
  std::vector<VertexAttribute> attributes;
  // Of each, if it is of another pyramid.
  std::vector<const PyramidValues*> sampled;
  std::optional<VertexColors> colors;
};

// The fields of all attributes, opened; they live as long as this.
class AttributeFields {
 public:
  // `options` outlive it, their pyramids are found. The pyramids share `memory_bytes`.
  AttributeFields(const std::vector<AttributeOptions>& options, const ColoringOptions& coloring,
                  std::uint64_t memory_bytes, bool no_map, const RemoteOptions& remote);

  // Of the surface at query.isovalue, with query.inside, of a pyramid and its extractor; both may
  // be null if none isOfSurface().
  SurfaceAttributes of(const QueryOptions& query, const Pyramid* pyramid, Extractor* extractor);

 private:
  const VertexValues* fieldOf(const AttributeOptions& options, const QueryOptions& query,
                              const Pyramid* pyramid, Extractor* extractor);
  VertexColors colorsOf(const SurfaceAttributes& attributes) const;

  const std::vector<AttributeOptions>& options_;
  const ColoringOptions& coloring_;
  std::vector<std::shared_ptr<const Pyramid>> pyramids_;  // null for those without one
  std::vector<std::unique_ptr<const PyramidValues>> sampled_;
  std::map<std::string, std::unique_ptr<const VertexValues>> fields_;  // by what they are of
};

// Says how many of the vertices in `output` have no value of each attribute, since they lie outside
// of what it is of.
void warnOfVerticesOutside(const std::vector<AttributeOptions>& options,
                           const SurfaceAttributes& attributes,
                           const std::vector<std::uint64_t>& outside, std::uint64_t vertices,
                           const std::string& output);

// How many pyramids share the memory with that of the surface.
std::uint64_t pyramidsOf(const std::vector<AttributeOptions>& attributes);

}  // namespace isobrick
