// The common part of the formats with numbered vertices.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/storage/atomic_file.h"

namespace isobrick {

// How a type of attributes is called, and the bytes of a number.
struct AttributeTypeInfo {
  std::string_view ply, vtk;
  std::size_t bytes;
};
constexpr AttributeTypeInfo infoOf(AttributeType type) {
  constexpr AttributeTypeInfo kInfos[] = {{"float", "Float32", 4},
                                          {"double", "Float64", 8},
                                          {"int", "Int32", 4},
                                          {"uint", "UInt32", 4}};
  return kInfos[static_cast<std::size_t>(type)];
}

// A mesh whose vertices have numbers of 32 bits. `path` is for messages.
class NumberedMesh : public MeshFileSink {
 public:
  NumberedMesh(std::string path, const MeshFileOptions& options)
      : options_(options), path_(std::move(path)) {}

  void begin(const MeshFrame& frame) override;
  // Numbers vertices and triangles.
  void place(PlacedBatch& placed) override;
  void beginObject(const std::string&) override { numbering_.forgetKeys(); }
  std::uint64_t vertices() const override { return numbering_.count(); }

 protected:
  // Vertices that the batch brings.
  static std::size_t newVertices(const PlacedBatch& placed) {
    return placed.batch.positions.size() - placed.known.size();
  }
  const std::vector<VertexAttribute>& attributes() const { return options_.attributes; }
  // For a header of a length of its own: what attributes and colours need beyond the one attribute
  // that it has room for.
  std::size_t extraBytes(std::size_t each) const {
    const std::size_t count = attributes().size() + (options_.colors ? 2 : 0);
    return count > 1 ? (count - 1) * each : 0;
  }
  // Fills placed.bytes with the numbers of the corners of all triangles, 32 bits each.
  static void findCorners(PlacedBatch& placed) {
    findNumbers(placed);
    placed.bytes.resize(placed.batch.triangles.size() * sizeof(std::uint32_t));
    BytePointer to(placed.bytes.data());
    for (const std::uint32_t corner : placed.batch.triangles) to.put(placed.numbers[corner]);
  }
  // As doubles, if floats would not separate crossings.
  void putPosition(BytePointer& to, const glm::dvec3& p) const {
    if (double_precision_)
      to.put(p.x, p.y, p.z);
    else
      to.put(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z));
  }
  // After findVertices(): of placed.world[i].
  static double valueOf(const PlacedBatch& placed, std::size_t attribute, std::size_t i) {
    return placed.values[attribute * placed.world.size() + i];
  }
  // As the type says, NaN as 0 if that has none.
  void putValue(BytePointer& to, const VertexAttribute& attribute, double value) const;
  // Of placed.world[i], if there are colours; sRGB.
  glm::vec3 colorOf(const PlacedBatch& placed, std::size_t i) const;
  // Fills placed.world, and placed.values, attribute by attribute: of the new vertices, or of all
  // of the batch, in their order.
  void findVertices(PlacedBatch& placed, bool all = false) const;
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
  // Of `vertices`, those of placed.world, in the volume's world.
  void findValues(PlacedBatch& placed, std::span<const std::uint32_t> vertices) const;

  WorldPlacement placement_, volume_placement_;
  glm::mat3 volume_normals_{
      1.0f};  // of a mesh that is placed elsewhere, back to the volume's world
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
