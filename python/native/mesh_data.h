// A mesh whose memory numpy arrays share.
#pragma once

#include <isobrick/isobrick.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

namespace isobrick::python {

// Memory that grows, keeps its pages and has no initial values. Large pieces lie in huge pages
// if the system grants them.
class RoomyBytes {
 public:
  RoomyBytes() = default;
  RoomyBytes(const RoomyBytes&) = delete;
  RoomyBytes& operator=(const RoomyBytes&) = delete;
  ~RoomyBytes();

  // At least so many bytes; what they hold is not kept. Throws std::bad_alloc.
  std::byte* room(std::size_t bytes);

 private:
  std::byte* data_ = nullptr;
  std::size_t bytes_ = 0;
};

// An extracted mesh, and what is made of it when it is first asked for. One thread at a time makes
// it; afterwards any number may read.
class MeshData {
 public:
  // For extractions to fill, before anything else is asked for.
  SurfaceMesh& surface() { return surface_; }
  // To be called after every extraction. `values` may be null; a mesh that has one holds on to it.
  void filled(const MeshFrame& frame, const ExtractionReport& report,
              std::shared_ptr<const VertexValues> values);

  const ExtractionReport& report() const { return report_; }
  const SurfaceMesh& surface() const { return surface_; }
  std::uint64_t vertices() const { return surface_.positions().size(); }
  std::uint64_t triangles() const { return surface_.triangles().size() / 3; }
  const MeshFrame& frame() const { return frame_; }

  // Whether points are doubles: if floats do not separate neighbouring crossings.
  bool hasDoubles() const { return frame_.coordinateMagnitudeInVoxels() > 2048; }
  // Three coordinates a vertex in world units, floats or doubles.
  const void* points();
  // Three coordinates a vertex in voxel indices, doubles. Made anew for every call, into `out`.
  void indexPoints(double* out) const;
  // The pyramid level of every triangle.
  const std::uint8_t* levels();
  // Whether each triangle is a cap (Query::cap).
  const bool* caps();
  bool hasValues() const { return values_ != nullptr; }
  // The values of the field that the mesh was extracted with, one a vertex.
  const float* values();

  // Writes the file that an extraction straight into it writes, to the byte. Values are its own.
  void save(const std::string& path, MeshFileOptions options) const;

 private:
  SurfaceMesh surface_;
  MeshFrame frame_;
  ExtractionReport report_;
  std::shared_ptr<const VertexValues> values_;
  RoomyBytes point_bytes_, level_bytes_, cap_bytes_, value_bytes_;
  bool has_points_ = false, has_levels_ = false, has_caps_ = false, has_evaluated_ = false;
};

}  // namespace isobrick::python
