// The common part of the formats with numbered vertices.
#pragma once

#include <string>
#include <utility>

#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/storage/atomic_file.h"

namespace isobrick {

// A mesh whose vertices have numbers of 32 bits. `path` is for messages.
class NumberedMesh : public MeshFileSink {
 public:
  NumberedMesh(std::string path, const MeshFileOptions& options)
      : options_(options), path_(std::move(path)) {}

  void begin(const MeshFrame& frame) override;
  // Numbers vertices and triangles.
  void place(PlacedBatch& placed) override;
  std::uint64_t vertices() const override { return numbering_.count(); }

 protected:
  // Vertices that the batch brings.
  static std::size_t newVertices(const PlacedBatch& placed) {
    return placed.batch.positions.size() - placed.known.size();
  }
  bool hasAttribute() const { return options_.values != nullptr || options_.components; }
  // Fills placed.world, and placed.values if there is an attribute: of the new vertices, in their
  // order.
  void findVertices(PlacedBatch& placed) const;
  // The same for all vertices of the batch.
  void findAllVertices(PlacedBatch& placed) const;
  // The place of the first index of a cap among the batch's triangles.
  static std::size_t firstCapIndex(const MeshBatch& batch) {
    return batch.triangles.size() - batch.cap_indices;
  }
  // Calls f(v) for the index in the batch of every new vertex, in their order.
  template <typename F>
  static void forEachNew(const PlacedBatch& placed, F&& f) {
    forEachNewRun(placed, [&](std::size_t begin, std::size_t end, std::uint64_t) {
      for (std::size_t v = begin; v < end; ++v) f(v);
    });
  }

  // The shift between two texts, for a header; empty if there is none.
  std::string shiftLine(const std::string& before, const std::string& after) const {
    const glm::dvec3 shift = shiftOf(frame_);
    return shift == glm::dvec3(0.0) ? "" : before + shiftText(shift) + after;
  }

  const MeshFileOptions options_;
  const std::string path_;
  MeshFrame frame_;
  bool double_precision_ = false;  // floats would not separate crossings
  std::uint64_t triangles_ = 0;
  std::uint64_t caps_ = 0;  // those of them that are caps

 private:
  // `for_each` calls its argument with the index of every vertex that is wanted.
  template <typename ForEach>
  void findWorld(PlacedBatch& placed, const ForEach& for_each) const;

  WorldPlacement placement_, volume_placement_;
  VertexNumbering numbering_;
};

// A mesh file of one such mesh. Derived classes lay out the file.
class NumberedSink : public NumberedMesh {
 public:
  NumberedSink(const std::string& path, const MeshFileOptions& options)
      : NumberedMesh(path, options), file_(path) {}

 protected:
  // Writes the header to the beginning, and gives the file its name.
  void publish(const std::string& header) {
    file_.pwrite(header.data(), header.size(), 0);
    file_.commit(options_.cancel);
  }

  AtomicFile file_;
};

}  // namespace isobrick
