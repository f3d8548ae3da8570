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
      : NumberedSink(path, options),
        indices_(path, "indices"),
        cap_indices_(path, "caps"),
        json_bytes_(2028 + extraBytes(192)) {}

  void begin(const MeshFrame& frame) override {
    NumberedSink::begin(frame);
    if (double_precision_) center_ = gltfCenter(frame_);
  }
  void place(PlacedBatch& placed) override {
    NumberedSink::place(placed);
    if (binOffset() + binBytes() > kMostGlbBytes) throw glbTooLarge(file_.path(), true);
  }
  void write(PlacedBatch& placed) override {
    writeVertices(placed);
    findCorners(placed);
    const std::size_t cap_bytes = placed.batch.cap_indices * sizeof(std::uint32_t);
    const std::size_t surface_bytes = placed.bytes.size() - cap_bytes;
    indices_.pwrite(placed.bytes.data(), surface_bytes,
                    (placed.first_triangle - placed.first_cap) * kTriangleBytes);
    cap_indices_.pwrite(placed.bytes.data() + surface_bytes, cap_bytes,
                        placed.first_cap * kTriangleBytes);
  }
  void finish() override {
    file_.continueFrom(binOffset() + vertices() * vertexBytes());
    indices_.appendTo(file_, (triangles_ - caps_) * kTriangleBytes, options_.cancel);
    cap_indices_.appendTo(file_, caps_ * kTriangleBytes, options_.cancel);
    if (triangles_ == 0) {  // the chunk of data is left out: no buffer may be empty
      file_.continueFrom(binOffset() - 8);
      file_.cutAfterPosition();
    }
    publish(makeHeader());
  }

 private:
  static constexpr std::size_t kTriangleBytes = 12;

  std::uint64_t binOffset() const { return glbHeaderBytes(json_bytes_); }
  std::size_t vertexBytes() const {
    return 24 + 4 * attributes().size() + (options_.colors ? sizeof(GltfColor) : 0);
  }
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
      for (std::size_t a = 0; a < attributes().size(); ++a) {
        const double value = valueOf(placed, a, i);
        to.put(std::isnan(value) ? 0.0f : static_cast<float>(value));
      }
      if (options_.colors) to.put(gltfColor(colorOf(placed, i)));
      ++i;
    });
    file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                 binOffset() + placed.first_vertex * vertexBytes());
    const std::lock_guard lock(bounds_mutex_);
    least_ = glm::min(least_, least);
    greatest_ = glm::max(greatest_, greatest);
  }

  std::string makeHeader() const { return glbHeader(makeJson(), json_bytes_, binBytes()); }

  std::string makeJson() const {
    const std::string head = joined("{", gltfAsset(frame_), R"(,"scene":0,"scenes":[)");
    if (triangles_ == 0) return joined(head, "{}]}");

    const std::string vertex_bytes = std::to_string(vertices() * vertexBytes());
    const auto attribute = [&](std::size_t offset, const char* type, const std::string& rest,
                               const char* component = "5126") {
      return joined(R"({"bufferView":0,"byteOffset":)", std::to_string(offset),
                    R"(,"componentType":)", component, R"(,"count":)", std::to_string(vertices()),
                    R"(,"type":")", type, "\"", rest, "}");
    };
    // Accessors 0 and 1 are positions and normals; then come indices of the surface and of caps, if
    // there are any.
    const std::uint64_t surface = triangles_ - caps_;
    std::string names, values;
    std::size_t number = 2 + (surface > 0 ? 1 : 0) + (caps_ > 0 ? 1 : 0), offset = 24;
    for (const VertexAttribute& one : attributes()) {
      names += joined(R"(,")", gltfAttribute(one.name), R"(":)", std::to_string(number++));
      values += joined(",", attribute(offset, "SCALAR", ""));
      offset += 4;
    }
    if (options_.colors) {
      names += joined(R"(,"COLOR_0":)", std::to_string(number));
      values += joined(",", attribute(offset, "VEC4", R"(,"normalized":true)", "5123"));
    }
    std::string primitives, accessors;
    std::size_t next_accessor = 2;
    const auto addTriangles = [&](std::uint64_t first, std::uint64_t count, const char* material) {
      if (count == 0) return;
      primitives +=
          joined(primitives.empty() ? "" : ",", R"({"attributes":{"POSITION":0,"NORMAL":1)", names,
                 R"(},"indices":)", std::to_string(next_accessor), R"(,"mode":4,"material":)",
                 material, "}");
      accessors += joined(
          R"(,{"bufferView":1,)",
          first == 0 ? "" : joined(R"("byteOffset":)", std::to_string(first * kTriangleBytes), ","),
          R"("componentType":5125,"count":)", std::to_string(3 * count), R"(,"type":"SCALAR"})");
      ++next_accessor;
    };
    addTriangles(0, surface, "0");
    addTriangles(surface, caps_, "1");
    return joined(
        head, gltfNode(center_), R"(,"meshes":[{"primitives":[)", primitives, "]}],",
        gltfMaterials(frame_), R"(,"accessors":[)",
        attribute(0, "VEC3",
                  joined(R"(,"min":)", arrayText(least_), R"(,"max":)", arrayText(greatest_))),
        ",", attribute(12, "VEC3", ""), accessors, values,
        R"(],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":)", vertex_bytes,
        R"(,"byteStride":)", std::to_string(vertexBytes()),
        R"(,"target":34962},{"buffer":0,"byteOffset":)", vertex_bytes, R"(,"byteLength":)",
        std::to_string(triangles_ * kTriangleBytes),
        R"(,"target":34963}],"buffers":[{"byteLength":)", std::to_string(binBytes()), "}]}");
  }

  SideFile indices_, cap_indices_;
  const std::size_t json_bytes_;  // a multiple of 4
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
