// A mesh in memory that is written in place and kept from query to query.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// An indexed triangle mesh. Every vertex is stored once. Positions are counted in voxels from the
// origin of their part (see MeshBatch::origin), so that float holds them exactly; a renderer passes
// a part's origin as an offset, and worldPosition() gives doubles.
//
// The object keeps the memory of the largest mesh it held, so a query into it writes to warm
// memory. Extracting into it throws Error if the system grants no address space or no memory. Const
// members are thread-safe; spans are valid until the next query into the mesh, and while it lives.
class SurfaceMesh {
 public:
  // The part that one brick added: vertices and triangles [first, first + count). Its triangles may
  // use vertices of parts before it.
  struct Part {
    std::uint64_t first_vertex = 0;    // of the mesh
    std::uint64_t vertices = 0;        // how many
    std::uint64_t first_triangle = 0;  // of the mesh
    std::uint64_t triangles = 0;       // how many
    Index3 origin{0};                  // the voxel that positions are counted from
    int level = 0;                     // of the brick
    std::uint64_t caps = 0;            // the last so many of its triangles are (Query::cap)
  };
  // Vertex numbers have 32 bits, of which some stand for no vertex (surface_writer.cpp).
  static constexpr std::uint64_t kMostVertices = (std::uint64_t{1} << 32) - 1024;
  // The most triangles that there are addresses for.
  static constexpr std::uint64_t kMostTriangles = std::uint64_t{1} << 33;

  // Empty.
  SurfaceMesh();
  ~SurfaceMesh();
  // Leaves the other one empty.
  SurfaceMesh(SurfaceMesh&& other) noexcept;
  SurfaceMesh& operator=(SurfaceMesh&& other) noexcept;

  // In voxels from the origin of the vertex's part.
  std::span<const glm::vec3> positions() const { return {positionData(), vertices_}; }
  // World, unit, outward: see MeshBatch::normals.
  std::span<const glm::vec3> normals() const { return {normalData(), vertices_}; }
  // Three vertex numbers each, counter-clockwise seen in the world from the outside.
  std::span<const std::uint32_t> triangles() const { return {triangleData(), 3 * triangles_}; }
  // In the order of their vertices and triangles.
  const std::vector<Part>& parts() const { return parts_; }

  // The part that added the vertex.
  const Part& partOfVertex(std::uint64_t vertex) const;
  // The place of a vertex in the world.
  glm::dvec3 worldPosition(std::uint64_t vertex) const {
    return placement_.worldPosition(partOfVertex(vertex).origin, positions()[vertex]);
  }

  // Forgets the triangles whose entry, one for each, is 0, and the vertices that no other one uses.
  // What stays keeps its order.
  void keep(std::span<const std::uint8_t> is_kept);

  // Forgets the mesh and gives its memory back to the system.
  void release() noexcept;

 private:
  friend class SurfaceWriter;
  friend class SurfaceJoiner;
  // Forgets the mesh and keeps its memory.
  void clear(const GridGeometry& geometry);
  // Makes room for so many, to be written to. By one thread at a time. Throws Error if a mesh can
  // have no more.
  void openFor(std::uint64_t vertices, std::uint64_t triangles);
  glm::vec3* positionData() const;
  glm::vec3* normalData() const;
  std::uint32_t* triangleData() const;

  struct Memory;                    // extract/session/surface_memory.h
  std::unique_ptr<Memory> memory_;  // none before the first extraction
  std::uint64_t vertices_ = 0, triangles_ = 0;
  std::vector<Part> parts_;
  WorldPlacement placement_;
};

}  // namespace isobrick
