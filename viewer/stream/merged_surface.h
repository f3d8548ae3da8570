// A finished pass of a stream as one mesh, for front ends that draw meshes rather than chunks.
//
//   SurfaceMerger merger(pyramid->spec().geometry);
//   while (std::optional<StreamMessage> end = merger.next(stream))
//     if (end->kind == StreamMessage::Kind::kPassDone) show(merger.merged());
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <vector>

#include "isobrick/storage/grid.h"
#include "isobrick/viewer/stream/surface_stream.h"

namespace isobrick {

// An indexed mesh. Each vertex is there once, so it is closed and oriented wherever the surface is.
struct MergedSurface {
  std::vector<glm::dvec3> vertices;      // world units
  std::vector<glm::vec3> normals;        // world, unit to 1/32767, outward; one a vertex
  std::vector<std::uint32_t> triangles;  // 3 vertices each, counter-clockwise from the outside
  std::vector<std::uint8_t> levels;      // of the pyramid, one a triangle; 0 is the finest
};

// Keeps the chunks of the pass that was finished last, in memory, and those of the pass under way.
// For one thread, the one that polls the stream.
class SurfaceMerger {
 public:
  // Of the stream's pyramid.
  explicit SurfaceMerger(const GridGeometry& geometry);
  ~SurfaceMerger();
  SurfaceMerger(const SurfaceMerger&) = delete;
  SurfaceMerger& operator=(const SurfaceMerger&) = delete;

  // Takes messages up to the end of a pass, and returns that one, without waiting; none: there is
  // no end yet, and on_news will say when to look again. One merger takes all messages of a stream,
  // since passes leave out bricks that the pass before had.
  //
  // kPassDone: the pass is the one that merged() gives. kDropped and kFailed: that stays what it
  // was. A pass whose chunks find no memory fails too; ask again without StreamRequest::may_reuse.
  std::optional<StreamMessage> next(SurfaceStream& stream);

  // A surface of the pass that was finished last, by its number; empty if it has none. Vertices are
  // joined here: some 10 million a second. Throws Error for more than 2^32 vertices.
  MergedSurface merged(int surface = 0) const;

 private:
  struct Kept;
  std::unique_ptr<Kept> kept_;
};

}  // namespace isobrick
