// One surface of `isobrick extract`, from the words of the user to its line in the report: where
// its triangles come from, pyramid or volume, is the caller's.
#pragma once

#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/mesh_check.h"
#include "isobrick/extract/sinks/mesh_collection.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "tools/attribute_options.h"
#include "tools/extract_report.h"
#include "tools/measured_sink.h"
#include "tools/mesh_options.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"

namespace isobrick {

struct ExtractArguments : MeshOptions {
  QueryOptions query;
  std::optional<std::uint64_t> label;        // whose surface it is
  std::size_t step = 0;                      // which of several FILE it is
  std::vector<AttributeOptions> attributes;  // of vertices
  ColoringOptions coloring;
  std::optional<std::uint64_t> most_triangles;
  bool drop_small = false;
  bool list_components = false;
  std::optional<std::uint64_t> keep_largest;
  std::optional<double> drop_below;  // area, world units^2
  std::optional<ShareNumber> part;
  bool together = false;                       // all surfaces in one file
  std::vector<glm::vec3> colors;               // then: of the surfaces, in their order; empty: none
  std::shared_ptr<MeshCollection> collection;  // that file, as soon as it is begun
  int repeat = 1;
};

// Of `isobrick extract -o`: the file of each isovalue, or of several isovalues with the value
// behind its stem, "bone-500.ply" and "bone-1200.ply", unless all go together. Empty for one that
// is not chosen yet.
std::vector<std::string> meshNames(const ExtractArguments& arguments);
// Throws Error if a file is in the way: before the work, so that a path that cannot be written
// costs no time.
void refuseOutputs(const ExtractArguments& arguments);
// The facts of the attributes for the report.
std::vector<AttributeFacts> attributeFacts(const ExtractArguments& arguments);
// True of a share of a mesh, .isbm.
bool isShareName(const std::string& output);

// The one file of all surfaces, if the user wants it; null: each has its own. Begun once, it is
// arguments.collection; `fields` outlive its use.
MeshCollection* collectionOf(ExtractArguments& arguments, const Pyramid& pyramid,
                             AttributeFields& fields);
// The surface with this number in it.
MeshObject objectOf(const ExtractArguments& arguments, std::size_t surface);

// One surface on its way. Passes of the surface go into componentSink(), if wantsComponents(), and
// then into meshSink(), as often as wanted; each is ended before the next one begins.
class ExtractedSurface {
 public:
  // All outlive it, and so do the fields of the attributes. Makes the query of
  // arguments.query.isovalue, and begins no file yet.
  ExtractedSurface(const ExtractArguments& arguments, const Pyramid& pyramid,
                   SurfaceAttributes attributes, std::string output, ProgressBar& bar);
  ExtractedSurface(const ExtractedSurface&) = delete;
  ExtractedSurface& operator=(const ExtractedSurface&) = delete;

  Query& query() { return query_; }
  // In place of the file of the output's format.
  void writeTo(std::unique_ptr<MeshFileSink> sink) { file_sink_ = std::move(sink); }

  bool wantsComponents() const;
  TriangleSink& componentSink();
  void endComponents();
  // Into the file, or counted only.
  TriangleSink& meshSink(bool to_file);
  void endMesh(const ExtractionReport& report);

  // Warns of what the user should know. `range_of` gives the range of the voxels, as stored; it is
  // called if there are no triangles.
  ExtractResult end(const std::function<ValueRange()>& range_of);

 private:
  TriangleSink& measured(TriangleSink& sink);

  const ExtractArguments& arguments_;
  const Pyramid& pyramid_;
  const SurfaceAttributes attributes_;
  ProgressBar& bar_;
  const double isovalue_;
  Query query_;
  ExtractResult result_;
  std::unique_ptr<MeshFileSink> file_sink_;
  CountingSink counting_sink_;
  std::unique_ptr<ComponentFinder> finder_;
  std::optional<MeasuredSink> measured_;  // around the sink of the pass
  std::optional<MeshCheck> check_;
  std::optional<ComponentFilter> filter_;
  bool to_file_ = false;
  Stopwatch watch_;                            // of the pass
  std::vector<std::uint64_t> outside_before_;  // of each attribute
};

// The surfaces of a volume at level 0, of which no pyramid is built. Nothing if the volume's
// pyramid is there already, which is then arguments.query.input.pyramid, or if the memory does not
// suffice to go through the volume. Throws as the extraction of a pyramid does.
using VolumeExtraction = std::optional<ExtractResults>(ExtractArguments& arguments);
// isobrick-build does it: `isobrick` becomes that here, which begins anew.
VolumeExtraction* volumeExtraction();

}  // namespace isobrick
