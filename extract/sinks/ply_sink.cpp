// Binary PLY.
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/numbered_sink.h"
#include "isobrick/extract/sinks/side_file.h"

namespace isobrick {
namespace {

// All vertices come before the first face, so faces wait in a second file.
class PlySink : public NumberedSink {
 public:
  PlySink(const std::string& path, const MeshFileOptions& options)
      : NumberedSink(path, options), faces_(path, "faces") {}

  void write(PlacedBatch& placed) override {
    writeVertices(placed);
    writeFaces(placed);
  }
  void finish() override {
    file_.continueFrom(kHeaderBytes + vertices() * vertexBytes());
    faces_.appendTo(file_, triangles_ * faceBytes(), options_.cancel);
    publish(makeHeader());
  }

 private:
  static constexpr std::size_t kHeaderBytes = 512;

  std::size_t faceBytes() const { return frame_.has_caps ? 15 : 14; }
  std::size_t vertexBytes() const {
    return (double_precision_ ? 36u : 24u) + (hasAttribute() ? 4u : 0u);
  }

  void writeVertices(PlacedBatch& placed) {
    if (newVertices(placed) == 0) return;
    findVertices(placed);
    placed.bytes.resize(placed.world.size() * vertexBytes());
    BytePointer to(placed.bytes.data());
    std::size_t i = 0;
    forEachNew(placed, [&](std::size_t v) {
      const glm::dvec3& p = placed.world[i];
      const glm::vec3& n = placed.batch.normals[v];
      if (double_precision_)
        to.put(p.x, p.y, p.z, n.x, n.y, n.z);
      else
        to.put(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z), n.x, n.y,
               n.z);
      if (options_.components)
        to.put(placed.components[v]);
      else if (options_.values != nullptr)
        to.put(placed.values[i]);
      ++i;
    });
    file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                 kHeaderBytes + placed.first_vertex * vertexBytes());
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

  // Always kHeaderBytes long: a comment fills the rest.
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
    if (options_.components)
      rest += "property uint component\n";
    else if (options_.values != nullptr)
      rest += "property float value\n";
    rest += "element face " + std::to_string(triangles_) +
            "\nproperty list uchar uint vertex_indices\nproperty uchar level\n" +
            (frame_.has_caps ? "property uchar cap\n" : "") + "end_header\n";
    const std::string prefix = "comment ";
    const std::size_t fill = kHeaderBytes - head.size() - rest.size() - prefix.size() - 1;
    return head + prefix + std::string(fill, '.') + "\n" + rest;
  }

  SideFile faces_;
};

}  // namespace

std::unique_ptr<MeshFileSink> makePlySink(const std::string& path, const MeshFileOptions& options) {
  return std::make_unique<PlySink>(path, options);
}

}  // namespace isobrick
