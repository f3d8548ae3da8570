// A mesh whose memory numpy arrays share.
#pragma once

#include <isobrick/isobrick.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

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

// An attribute of vertices, with what it holds on to.
struct MeshField {
  std::string name;
  AttributeType type = AttributeType::kFloat32;
  std::shared_ptr<const VertexValues> values;
};

// As mesh files take them.
std::vector<VertexAttribute> attributesOf(const std::vector<MeshField>& fields);

// The connected pieces that a query keeps: `keep_largest` and `drop_below` of Python.
struct PieceChoice {
  std::optional<std::size_t> largest;
  std::optional<double> least_area;

  bool isGiven() const { return largest || least_area; }
  std::vector<std::uint8_t> keptOf(const SurfaceComponents& all) const {
    return all.kept(largest, least_area.value_or(0));
  }
};

// An extracted mesh, and what is made of it when it is first asked for. One thread at a time makes
// it; afterwards any number may read.
class MeshData {
 public:
  // For extractions to fill, before anything else is asked for.
  SurfaceMesh& surface() { return surface_; }
  // To be called after every extraction. A mesh holds on to its fields.
  void filled(const MeshFrame& frame, const Query& query, const ExtractionReport& report,
              std::vector<MeshField> fields);

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
  const std::vector<MeshField>& fields() const { return fields_; }
  // The numbers of a field that the mesh was extracted with, one a vertex, of its type.
  const void* values(std::size_t field);

  // Writes the file that an extraction straight into it writes, to the byte. Attributes are its
  // own.
  void save(const std::string& path, MeshFileOptions options) const;
  // All batches into a sink.
  void passTo(TriangleSink& sink, const CancelFlag* cancel) const;
  MeshQuality check(const CancelFlag* cancel) const;
  // Its connected pieces; `of_triangle`: of every triangle the place in the list.
  SurfaceComponents components(std::vector<std::uint32_t>& of_triangle,
                               const CancelFlag* cancel) const;
  // Forgets the others, and what is known of levels of all of them. To be called after filled().
  void keepPieces(const PieceChoice& choice, const CancelFlag* cancel);
  bool isOfPieces() const { return is_of_pieces_; }

 private:
  SurfaceMesh surface_;
  MeshFrame frame_;
  bool is_cut_ = false;  // by a box or a region
  bool is_of_pieces_ = false;
  ExtractionReport report_;
  std::vector<MeshField> fields_;
  std::vector<std::unique_ptr<RoomyBytes>> value_bytes_;  // of each field; null: not asked for yet
  RoomyBytes point_bytes_, level_bytes_, cap_bytes_;
  bool has_points_ = false, has_levels_ = false, has_caps_ = false;
};

}  // namespace isobrick::python
