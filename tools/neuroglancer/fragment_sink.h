// The fragments of one level of a mesh for Neuroglancer.
#pragma once

#include <atomic>
#include <cstdint>
#include <glm/matrix.hpp>
#include <mutex>
#include <span>
#include <vector>

#include "isobrick/extract/sinks/side_file.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// A brick's part of the surface: a node of the format's octree.
struct MeshFragment {
  Index3 brick{0};
  std::uint32_t bytes = 0;   // packed; 0: it has no triangles
  std::uint64_t offset = 0;  // in the side file
  std::uint64_t triangles = 0;
};

// Bits of a coordinate within its fragment.
inline constexpr int kFragmentBits = 16;

// A position within a fragment whose low corner is `low` and whose edge is `edge`, both in voxels:
// 0 is the low end of an axis, 2^16 - 1 the high one, 2^15 the middle. Vertices that two fragments
// share get coordinates of one and the same place: what is between them is closed.
glm::ivec3 fragmentPosition(const glm::dvec3& position, const Index3& low, std::int64_t edge);

// Packs each batch of a uniform level, a fragment each, into a side file. Cells end where a brick
// and its eighths end, so that no triangle crosses their borders, as the format wants it.
class FragmentSink : public TriangleSink {
 public:
  // `edge`: voxels of level 0 along a brick. `spool` outlives it, and its first free byte is `end`.
  FragmentSink(std::int64_t edge, SideFile& spool, std::atomic<std::uint64_t>& end)
      : edge_(edge), spool_(spool), end_(end) {}

  void begin(const MeshFrame& frame) override {
    is_mirrored_ = glm::determinant(frame.geometry.direction) < 0;
  }
  void prepare(PlacedBatch& placed) override;
  void write(PlacedBatch& placed) override;

  // After the extraction: in the order of the bricks' Morton codes.
  std::vector<MeshFragment> takeFragments();

 private:
  const std::int64_t edge_;
  SideFile& spool_;
  std::atomic<std::uint64_t>& end_;
  bool is_mirrored_ = false;  // then triangles that turn left in the world turn right in voxels
  std::mutex mutex_;
  std::vector<MeshFragment> fragments_;
};

// Bits of the three coordinates in turn, x lowest.
std::uint64_t mortonCode(const Index3& brick);

// Adds to the coarser level, without triangles, what holds a fragment of the finer one and is not
// there: a node without a parent would never be drawn. Both are in the order of Morton codes.
void addMissingParents(std::span<const MeshFragment> finer, std::vector<MeshFragment>& coarser);

}  // namespace isobrick
