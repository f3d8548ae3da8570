// glTF 2.0, binary.
#include <cmath>
#include <glm/common.hpp>
#include <limits>
#include <mutex>
#include <string>

#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/numbered_sink.h"
#include "isobrick/extract/sinks/side_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// A header, a chunk of JSON and a chunk with the vertices, attributes side by side, and behind them
// the indices, which wait in a second file. The JSON is padded, as the format allows, and written
// last.
class GlbSink : public NumberedSink {
 public:
  GlbSink(const std::string& path, const MeshFileOptions& options)
      : NumberedSink(path, options), indices_(path, "indices"), cap_indices_(path, "caps") {}

  void begin(const MeshFrame& frame) override {
    NumberedSink::begin(frame);
    if (double_precision_) center_ = gltfCenter(frame_);
  }
  void place(PlacedBatch& placed) override {
    NumberedSink::place(placed);
    if (kBinOffset + binBytes() > kMostGlbBytes) throw glbTooLarge(file_.path(), true);
  }
  void write(PlacedBatch& placed) override {
    writeVertices(placed);
    findNumbers(placed);
    placed.bytes.resize(placed.batch.triangles.size() * sizeof(std::uint32_t));
    BytePointer to(placed.bytes.data());
    for (const std::uint32_t corner : placed.batch.triangles) to.put(placed.numbers[corner]);
    const std::size_t cap_bytes = placed.batch.cap_indices * sizeof(std::uint32_t);
    const std::size_t surface_bytes = placed.bytes.size() - cap_bytes;
    indices_.pwrite(placed.bytes.data(), surface_bytes,
                    (placed.first_triangle - placed.first_cap) * kTriangleBytes);
    cap_indices_.pwrite(placed.bytes.data() + surface_bytes, cap_bytes,
                        placed.first_cap * kTriangleBytes);
  }
  void finish() override {
    file_.continueFrom(kBinOffset + vertices() * vertexBytes());
    indices_.appendTo(file_, (triangles_ - caps_) * kTriangleBytes, options_.cancel);
    cap_indices_.appendTo(file_, caps_ * kTriangleBytes, options_.cancel);
    if (triangles_ == 0) {  // the chunk of data is left out: no buffer may be empty
      file_.continueFrom(kBinOffset - 8);
      file_.cutAfterPosition();
    }
    publish(makeHeader());
  }

 private:
  static constexpr std::size_t kJsonBytes = 2028;
  static constexpr std::size_t kBinOffset = 12 + 8 + kJsonBytes + 8;
  static constexpr std::size_t kTriangleBytes = 12;

  std::size_t vertexBytes() const { return hasAttribute() ? 28 : 24; }
  std::uint64_t binBytes() const {
    return vertices() * vertexBytes() + triangles_ * kTriangleBytes;
  }

  void writeVertices(PlacedBatch& placed) {
    if (newVertices(placed) == 0) return;
    findVertices(placed);
    placed.bytes.resize(placed.world.size() * vertexBytes());
    BytePointer to(placed.bytes.data());
    glm::vec3 least(std::numeric_limits<float>::infinity()), greatest = -least;
    std::size_t i = 0;
    forEachNew(placed, [&](std::size_t v) {
      const glm::vec3 p(placed.world[i] - center_);
      const glm::vec3& n = placed.batch.normals[v];
      least = glm::min(least, p);
      greatest = glm::max(greatest, p);
      to.put(p.x, p.y, p.z, n.x, n.y, n.z);
      // The format forbids NaN.
      if (hasAttribute()) to.put(std::isnan(placed.values[i]) ? 0.0f : placed.values[i]);
      ++i;
    });
    file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                 kBinOffset + placed.first_vertex * vertexBytes());
    const std::lock_guard lock(bounds_mutex_);
    least_ = glm::min(least_, least);
    greatest_ = glm::max(greatest_, greatest);
  }

  // Behind those of the triangles.
  std::string valueAccessor() const { return caps_ > 0 && caps_ < triangles_ ? "4" : "3"; }

  std::string makeHeader() const { return glbHeader(makeJson(), kJsonBytes, binBytes()); }

  std::string makeJson() const {
    const std::string head = joined("{", gltfAsset(frame_), R"(,"scene":0,"scenes":[)");
    if (triangles_ == 0) return joined(head, "{}]}");

    const std::string vertex_bytes = std::to_string(vertices() * vertexBytes());
    const auto attribute = [&](std::size_t offset, const char* type, const std::string& rest) {
      return joined(R"({"bufferView":0,"byteOffset":)", std::to_string(offset),
                    R"(,"componentType":5126,"count":)", std::to_string(vertices()), R"(,"type":")",
                    type, "\"", rest, "}");
    };
    // The surface's triangles, and those of caps, each if there are any.
    std::string primitives, accessors;
    std::size_t next_accessor = 2;
    const auto addTriangles = [&](std::uint64_t first, std::uint64_t count, const char* material) {
      if (count == 0) return;
      const std::string value =
          hasAttribute() ? joined(R"(,")", gltfAttribute(options_), R"(":)", valueAccessor()) : "";
      primitives +=
          joined(primitives.empty() ? "" : ",", R"({"attributes":{"POSITION":0,"NORMAL":1)", value,
                 R"(},"indices":)", std::to_string(next_accessor), R"(,"mode":4,"material":)",
                 material, "}");
      accessors += joined(
          R"(,{"bufferView":1,)",
          first == 0 ? "" : joined(R"("byteOffset":)", std::to_string(first * kTriangleBytes), ","),
          R"("componentType":5125,"count":)", std::to_string(3 * count), R"(,"type":"SCALAR"})");
      ++next_accessor;
    };
    addTriangles(0, triangles_ - caps_, "0");
    addTriangles(triangles_ - caps_, caps_, "1");
    return joined(
        head, gltfNode(center_), R"(,"meshes":[{"primitives":[)", primitives, "]}],",
        gltfMaterials(frame_), R"(,"accessors":[)",
        attribute(0, "VEC3",
                  joined(R"(,"min":)", arrayText(least_), R"(,"max":)", arrayText(greatest_))),
        ",", attribute(12, "VEC3", ""), accessors,
        hasAttribute() ? joined(",", attribute(24, "SCALAR", "")) : "",
        R"(],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":)", vertex_bytes,
        R"(,"byteStride":)", std::to_string(vertexBytes()),
        R"(,"target":34962},{"buffer":0,"byteOffset":)", vertex_bytes, R"(,"byteLength":)",
        std::to_string(triangles_ * kTriangleBytes),
        R"(,"target":34963}],"buffers":[{"byteLength":)", std::to_string(binBytes()), "}]}");
  }

  SideFile indices_, cap_indices_;
  glm::dvec3 center_{0.0};
  std::mutex bounds_mutex_;
  glm::vec3 least_{std::numeric_limits<float>::infinity()};
  glm::vec3 greatest_{-std::numeric_limits<float>::infinity()};
};

}  // namespace

std::unique_ptr<MeshFileSink> makeGlbSink(const std::string& path, const MeshFileOptions& options) {
  if (options.meshopt) return makeMeshoptSink(path, options);
  return std::make_unique<GlbSink>(path, options);
}

}  // namespace isobrick
