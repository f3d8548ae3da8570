// The interface that receives triangles: batch by batch, in an order that no thread count changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// Identifies a crossing among all levels: the voxel position of its edge's lower end and the axis.
// Axis 3 is none: the lattice point itself, a corner of a cap.
//
//   bit 63 62   61 .. 42   41 .. 22   21 .. 2   1 0
//       0  0    z          y          x         axis
//
// The edge's length is not part of it: if leaves of two levels share an edge, only the coarser
// edge carries a crossing, so one (position, axis) names one edge in a mesh. With bit 63 it is the
// key of a vertex where a region cuts the surface (extract/region/region_cutter.h).
using EdgeKey = std::uint64_t;
// The key of no edge.
inline constexpr EdgeKey kNoEdge = ~EdgeKey{0};

// The key of the edge that begins at a voxel position and goes along `axis`.
constexpr EdgeKey makeEdgeKey(const Index3& position, int axis) {
  return (static_cast<EdgeKey>(position.z) << 42) | (static_cast<EdgeKey>(position.y) << 22) |
         (static_cast<EdgeKey>(position.x) << 2) | static_cast<EdgeKey>(axis);
}
static_assert(kMaxVoxelsPerAxis <= (std::int64_t{1} << 20));

// For vectors whose resize() leaves new elements as they are: memory that is filled right away.
template <typename T>
struct RawAllocator : std::allocator<T> {
  // As allocators have it.
  template <typename U>
  struct rebind {
    using other = RawAllocator<U>;  // for elements of another type
  };
  // Leaves the element as it is.
  template <typename U>
  void construct(U* at) noexcept {
    static_assert(std::is_trivially_destructible_v<U>);
    ::new (static_cast<void*>(at)) U;
  }
  // Makes the element of the arguments.
  template <typename U, typename... Arguments>
  void construct(U* at, Arguments&&... arguments) {
    ::new (static_cast<void*>(at)) U(std::forward<Arguments>(arguments)...);
  }
};

// A vector whose resize() leaves new elements as they are.
template <typename T>
using RawVector = std::vector<T, RawAllocator<T>>;

// The part of a mesh that one brick of one level adds.
struct MeshBatch {
  // A vertex that other batches may have too; equal keys are one vertex.
  struct SharedVertex {
    std::uint32_t vertex;      // index into positions
    std::uint8_t batches = 0;  // that list it in the whole mesh, at the most; 0: not known
    EdgeKey key;               // of the edge that it lies on
  };

  int level = 0;                       // of the brick
  Index3 brick{0};                     // its place among the bricks of the level
  bool is_uniform = false;             // see Query::has_brick
  double fraction_done = 0;            // of the extraction's bricks, with this one: 0 .. 1
  Index3 origin{0};                    // the voxel that positions are counted from
  RawVector<glm::vec3> positions;      // in voxels from the origin; exact, see worldPosition()
  RawVector<glm::vec3> normals;        // world, unit, outward: towards lower values, or towards
                                       // higher ones if Query::inside is below; one a position
  RawVector<std::uint32_t> triangles;  // three indices into positions each, counter-clockwise
                                       // seen in the world from the outside
  std::vector<SharedVertex> shared;    // ascending in `vertex`
  // The last so many of `triangles` are caps (Query::cap), which lie in the border of the volume,
  // of the query's box or of its region.
  std::size_t cap_indices = 0;
  // The last so many before them belong to transition cells, which join two levels.
  std::size_t transition_indices = 0;
  std::uint64_t cells = 0;             // leaves with at least one triangle
  std::uint64_t transition_cells = 0;  // those of them that have a fan

  // Forgets what the brick added; keeps the memory.
  void clear() {
    positions.clear();
    normals.clear();
    triangles.clear();
    shared.clear();
    cap_indices = transition_indices = 0;
    cells = transition_cells = 0;
  }
  // Bytes that it takes in memory, without spare capacity.
  std::uint64_t bytes() const {
    return (positions.size() + normals.size()) * sizeof(glm::vec3) +
           triangles.size() * sizeof(std::uint32_t) + shared.size() * sizeof(SharedVertex);
  }
};

// Facts of the volume that a sink may need before the first batch.
struct MeshFrame {
  GridGeometry geometry;               // of the volume, or of where a file has it (see `placed`)
  Index3 voxels{0};                    // of level 0
  bool has_missing = false;            // voxels without data, beside which the surface is open
  InsideOf inside = InsideOf::kAbove;  // of the query
  bool has_caps = false;               // Query::cap

  // A mesh that a file has elsewhere than in its volume's world.
  struct Placed {
    std::string space;      // "RAS"
    std::string unit;       // "inches"
    glm::dvec3 shift{0.0};  // was added last, in that space and unit
    GridGeometry volume;    // in its own world
  };
  std::optional<Placed> placed = {};  // none: in the volume's world

  // Greatest magnitude of a world coordinate divided by the least voxel spacing: above 2048, single
  // precision no longer separates crossings that are 1/4096 of an edge apart (rule 8).
  double coordinateMagnitudeInVoxels() const;
};

// From the positions of batches to the world. The same vertex of two batches gets the same bits.
class WorldPlacement {
 public:
  WorldPlacement() = default;
  // `geometry`: MeshFrame::geometry.
  explicit WorldPlacement(const GridGeometry& geometry)
      : origin_(geometry.origin), matrix_(geometry.indexToWorldMatrix()) {}

  // The place of a position that is counted from the voxel `origin`.
  glm::dvec3 worldPosition(const Index3& origin, const glm::vec3& position) const {
    // Both are exact, and so is their sum: 20 bits before the point, 24 behind at the most.
    return origin_ + matrix_ * (glm::dvec3(origin) + glm::dvec3(position));
  }
  // The place of a vertex of a batch.
  glm::dvec3 worldPosition(const MeshBatch& batch, std::uint32_t vertex) const {
    return worldPosition(batch.origin, batch.positions[vertex]);
  }

 private:
  glm::dvec3 origin_{0.0};
  glm::dmat3 matrix_{1.0};
};

// A vertex of a batch that another batch brought before.
struct KnownVertex {
  std::uint32_t vertex = 0;  // index in the batch
  std::uint64_t number = 0;  // in the mesh
};

// The number of a component that is in no list.
inline constexpr std::uint32_t kNoComponent = ~std::uint32_t{0};

// What a simplified brick keeps for simplification with its neighbours. Private to extract/.
struct SimplifyRemains;

// A batch and its place in the mesh, which a sink gives it, with memory that is reused.
struct PlacedBatch {
  MeshBatch batch;                   // as it was made
  std::uint64_t first_vertex = 0;    // of the mesh
  std::uint64_t first_triangle = 0;  // likewise
  std::uint64_t first_cap = 0;       // caps of the mesh before it
  std::uint64_t first_byte = 0;      // of the file, for sinks whose lines differ in length
  // Ascending. All other vertices are new and numbered from first_vertex on, in their order.
  std::vector<KnownVertex> known;
  std::vector<std::uint32_t> numbers;  // scratch for write()
  std::vector<std::byte> bytes;        // likewise
  std::vector<glm::dvec3> world;       // likewise
  std::vector<double> values;          // likewise
  // Of every vertex, the number of its component, or kNoComponent. Filled by a stage before the
  // sink (ComponentFilter, ComponentNumbering); without one of these it has no meaning.
  std::vector<std::uint32_t> components;
  // Of a brick that is simplified again with its neighbours; otherwise null.
  std::shared_ptr<SimplifyRemains> remains;
};

// Receives a mesh. begin() once, then every batch, finish() once. An exception of a sink
// ends the extraction and reaches its caller; finish() is not called then.
//
// A plain sink takes each batch in accept(): in order, never two calls at the same time, but from
// any thread. A sink with much to do for a batch overrides place() and write() instead: place() is
// called like accept() and only decides the batch's place; write() follows from any thread, for
// several batches at the same time, and is done before finish(). A sink that changes batches does
// it in prepare(), which comes before place(), from any thread, for several batches at the same
// time and in any order; a batch without triangles goes no further. A batch is valid only during
// the calls.
class TriangleSink {
 public:
  virtual ~TriangleSink() = default;
  // True if a simplified surface comes brick by brick, with remains, and the sink or who comes
  // after it simplifies what bricks share.
  virtual bool takesRemains() const { return false; }
  // Before the first batch.
  virtual void begin(const MeshFrame&) {}
  // May change the batch.
  virtual void prepare(PlacedBatch&) {}
  // A plain sink's batch.
  virtual void accept(const MeshBatch&) {}
  // Decides the batch's place.
  virtual void place(PlacedBatch& placed) { accept(placed.batch); }
  // Does the rest of the work on the batch.
  virtual void write(PlacedBatch&) {}
  // After the last batch.
  virtual void finish() {}
};

}  // namespace isobrick
