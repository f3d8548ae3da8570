// A mesh in memory that is written in place and kept from query to query.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Address space for the most elements there may be, of which a part from the beginning is open.
// Addresses alone cost nothing, not even where the system promises no more than it has
// (vm.overcommit_memory=2) or bounds what a process may write to (RLIMIT_DATA). Memory comes with
// the first write to an open page, in huge pages where the system grants them, and stays.
class ReservedBytes {
 public:
  explicit ReservedBytes(std::size_t bytes) : bytes_(bytes) {}
  ~ReservedBytes() { release(); }
  ReservedBytes(ReservedBytes&& other) noexcept;
  ReservedBytes& operator=(ReservedBytes&& other) noexcept;

  // Takes the addresses, unless it has them. Throws Error where there are none.
  void reserve();
  // The first `bytes` may be read and written from here on; they are reserved. By one thread at a
  // time. Throws Error where the system does not promise the memory.
  void open(std::size_t bytes) {
    if (bytes > open_bytes_) openFurther(bytes);
  }
  // nullptr before reserve().
  std::byte* data() const { return data_; }
  // Gives all memory and addresses back to the system.
  void release() noexcept;

 private:
  // What is open counts as used where memory is promised, so there is not much more of it than is
  // asked for.
  static constexpr std::size_t kStep = std::size_t{32} << 20;

  void openFurther(std::size_t bytes);

  std::byte* data_ = nullptr;
  std::size_t bytes_ = 0, open_bytes_ = 0;
};

// An indexed triangle mesh. Every vertex is stored once. Positions are counted in voxels from the
// origin of their part (see MeshBatch::origin), where float holds them exactly; a renderer passes a
// part's origin as an offset, and worldPosition() gives doubles.
//
// The object keeps the memory of the largest mesh it held, so a query into it writes to warm
// memory. Extracting into it throws Error where the system grants no address space or no memory.
class SurfaceMesh {
 public:
  // What one brick added: vertices and triangles [first, first + count). Its triangles may use
  // vertices of parts before it.
  struct Part {
    std::uint64_t first_vertex = 0, vertices = 0;
    std::uint64_t first_triangle = 0, triangles = 0;
    Index3 origin{0};
    int level = 0;
  };
  // Vertex numbers have 32 bits, of which some stand for no vertex (surface_writer.cpp).
  static constexpr std::uint64_t kMostVertices = (std::uint64_t{1} << 32) - 1024;
  static constexpr std::uint64_t kMostTriangles = std::uint64_t{1} << 33;

  SurfaceMesh();
  // What was moved from is empty.
  SurfaceMesh(SurfaceMesh&& other) noexcept;
  SurfaceMesh& operator=(SurfaceMesh&& other) noexcept;

  std::span<const glm::vec3> positions() const { return {positionData(), vertices_}; }
  // World, unit, towards lower values.
  std::span<const glm::vec3> normals() const { return {normalData(), vertices_}; }
  // Three vertex numbers each, counter-clockwise seen in the world from the lower values.
  std::span<const std::uint32_t> triangles() const { return {triangleData(), 3 * triangles_}; }
  // In the order of their vertices and triangles.
  const std::vector<Part>& parts() const { return parts_; }

  const Part& partOfVertex(std::uint64_t vertex) const;
  glm::dvec3 worldPosition(std::uint64_t vertex) const {
    return placement_.worldPosition(partOfVertex(vertex).origin, positions()[vertex]);
  }

  // Forgets the mesh and gives its memory back to the system.
  void release() noexcept;

 private:
  friend class SurfaceWriter;
  friend class SurfaceJoiner;
  // Forgets the mesh and keeps its memory.
  void clear(const GridGeometry& geometry);
  // Room for so many, to be written to. By one thread at a time. Throws Error where a mesh can have
  // no more.
  void openFor(std::uint64_t vertices, std::uint64_t triangles);
  glm::vec3* positionData() const { return reinterpret_cast<glm::vec3*>(position_bytes_.data()); }
  glm::vec3* normalData() const { return reinterpret_cast<glm::vec3*>(normal_bytes_.data()); }
  std::uint32_t* triangleData() const {
    return reinterpret_cast<std::uint32_t*>(triangle_bytes_.data());
  }

  ReservedBytes position_bytes_, normal_bytes_, triangle_bytes_;
  std::uint64_t vertices_ = 0, triangles_ = 0;
  std::vector<Part> parts_;
  WorldPlacement placement_;
  // Numbers of crossings on the high sides of bricks, kept for their memory.
  std::vector<RawVector<std::uint32_t>> side_numbers_;
};

}  // namespace isobrick
