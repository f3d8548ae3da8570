// Binary PLY.
#include <glm/common.hpp>

#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/numbered_sink.h"
#include "isobrick/extract/sinks/side_file.h"

namespace isobrick {
namespace {

// All vertices come before the first face, so faces wait in a second file.
class PlySink : public NumberedSink {
 public:
  PlySink(const std::string& path, const MeshFileOptions& options)
      : NumberedSink(path, options), faces_(path, "faces"), header_bytes_(512 + extraBytes(64)) {}

  void write(PlacedBatch& placed) override {
    writeVertices(placed);
    writeFaces(placed);
  }
  void finish() override {
    file_.continueFrom(header_bytes_ + vertices() * vertexBytes());
    faces_.appendTo(file_, triangles_ * faceBytes(), options_.cancel);
    publish(makeHeader());
  }

 private:
  std::size_t faceBytes() const { return frame_.has_caps ? 15 : 14; }
  std::size_t vertexBytes() const {
    std::size_t bytes = (double_precision_ ? 36u : 24u) + (options_.colors ? 3u : 0u);
    for (const VertexAttribute& attribute : attributes()) bytes += infoOf(attribute.type).bytes;
    return bytes;
  }

  void writeVertices(PlacedBatch& placed) {
    if (newVertices(placed) == 0) return;
    findVertices(placed);
    placed.bytes.resize(placed.world.size() * vertexBytes());
    BytePointer to(placed.bytes.data());
    std::size_t i = 0;
    forEachNew(placed, [&](std::size_t v) {
      const glm::vec3& n = placed.batch.normals[v];
      putPosition(to, placed.world[i]);
      to.put(n.x, n.y, n.z);
      for (std::size_t a = 0; a < attributes().size(); ++a)
        putValue(to, attributes()[a], valueOf(placed, a, i));
      if (options_.colors) {
        const glm::vec3 color = glm::round(255.0f * colorOf(placed, i));
        to.put(static_cast<std::uint8_t>(color.r), static_cast<std::uint8_t>(color.g),
               static_cast<std::uint8_t>(color.b));
      }
      ++i;
    });
    file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                 header_bytes_ + placed.first_vertex * vertexBytes());
  }
  void writeFaces(PlacedBatch& placed) {
    const MeshBatch& batch = placed.batch;
    findNumbers(placed);
    placed.bytes.resize(batch.triangles.size() / 3 * faceBytes());
    BytePointer to(placed.bytes.data());
    for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
      to.put(std::uint8_t{3}, placed.numbers[batch.triangles[i]],
             placed.numbers[batch.triangles[i + 1]], placed.numbers[batch.triangles[i + 2]],
             static_cast<std::uint8_t>(batch.level));
      if (frame_.has_caps) to.put(static_cast<std::uint8_t>(i >= firstCapIndex(batch) ? 1 : 0));
    }
    faces_.pwrite(placed.bytes.data(), placed.bytes.size(), placed.first_triangle * faceBytes());
  }

  // Always header_bytes_ long: a comment fills the rest.
  std::string makeHeader() const {
    const std::string real = double_precision_ ? "double" : "float";
    const std::string head =
        "ply\nformat binary_little_endian 1.0\ncomment isobrick\ncomment units: " +
        unitText(frame_) + "\ncomment space: " + spaceText(frame_) + "\n" +
        shiftLine("comment shift: ", "\n");
    std::string rest = "element vertex " + std::to_string(vertices()) + "\n";
    for (const char* name : {"x", "y", "z"}) rest += "property " + real + " " + name + "\n";
    for (const char* name : {"nx", "ny", "nz"})
      rest += std::string("property float ") + name + "\n";
    for (const VertexAttribute& attribute : attributes())
      rest += joined("property ", infoOf(attribute.type).ply, " ", attribute.name, "\n");
    if (options_.colors)
      for (const char* name : {"red", "green", "blue"})
        rest += joined("property uchar ", name, "\n");
    rest += "element face " + std::to_string(triangles_) +
            "\nproperty list uchar uint vertex_indices\nproperty uchar level\n" +
            (frame_.has_caps ? "property uchar cap\n" : "") + "end_header\n";
    const std::string prefix = "comment ";
    const std::size_t fill = header_bytes_ - head.size() - rest.size() - prefix.size() - 1;
    return head + prefix + std::string(fill, '.') + "\n" + rest;
  }

  SideFile faces_;
  const std::size_t header_bytes_;
};

}  // namespace

std::unique_ptr<MeshFileSink> makePlySink(const std::string& path, const MeshFileOptions& options) {
  return std::make_unique<PlySink>(path, options);
}

}  // namespace isobrick
