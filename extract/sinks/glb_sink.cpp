// glTF 2.0, binary.
#include <charconv>
#include <cmath>
#include <glm/common.hpp>
#include <limits>
#include <mutex>
#include <string>

#include "isobrick/extract/sinks/byte_pointer.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/numbered_sink.h"
#include "isobrick/extract/sinks/side_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Digits that read back as the same number.
std::string numberText(double number) {
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, number).ptr};
}

// The nearest number that a float holds. Not by conversion there and back, which GCC 12 leaves out
// where it makes vectors of it.
double roundToSingle(double number) {
  int exponent = 0;
  const double fraction = std::frexp(number, &exponent);
  return std::ldexp(std::round(std::ldexp(fraction, 24)), exponent - 24);
}

// Puts parts of a text together.
template <typename... Parts>
std::string joined(const Parts&... parts) {
  std::string text;
  (text.append(parts), ...);
  return text;
}

std::string arrayText(const glm::dvec3& v) {
  return joined("[", numberText(v.x), ",", numberText(v.y), ",", numberText(v.z), "]");
}

// A header, a chunk of JSON and a chunk with the vertices, attributes side by side, and behind them
// the indices, which wait in a second file. The JSON is padded, as the format allows, and written
// last.
class GlbSink : public NumberedSink {
 public:
  GlbSink(const std::string& path, const MeshFileOptions& options)
      : NumberedSink(path, options), indices_(path, "indices") {}

  void begin(const MeshFrame& frame) override {
    NumberedSink::begin(frame);
    // Exact as a float too, since that is what many readers make of it.
    if (double_precision_) {
      center_ = frame.geometry.indexToWorld(glm::dvec3(frame.voxels - Index3(1)) / 2.0);
      for (int axis = 0; axis < 3; ++axis) center_[axis] = roundToSingle(center_[axis]);
    }
  }
  void place(PlacedBatch& placed) override {
    NumberedSink::place(placed);
    if (kBinOffset + binBytes() > std::numeric_limits<std::uint32_t>::max())
      throw Error("'" + file_.path() +
                      "': a glTF binary file holds at most 4 GiB; write .vtp or .ply instead, or "
                      "extract a part of the surface or a coarser level",
                  {.path = file_.path()});
  }
  void write(PlacedBatch& placed) override {
    writeVertices(placed);
    findNumbers(placed);
    placed.bytes.resize(placed.batch.triangles.size() * sizeof(std::uint32_t));
    BytePointer to(placed.bytes.data());
    for (const std::uint32_t corner : placed.batch.triangles) to.put(placed.numbers[corner]);
    indices_.pwrite(placed.bytes.data(), placed.bytes.size(),
                    placed.first_triangle * kTriangleBytes);
  }
  void finish() override {
    file_.continueFrom(kBinOffset + vertices() * vertexBytes());
    indices_.appendTo(file_, triangles_ * kTriangleBytes, options_.cancel);
    if (triangles_ == 0) {  // the chunk of data is left out: no buffer may be empty
      file_.continueFrom(kBinOffset - 8);
      file_.cutAfterPosition();
    }
    const std::string header = makeHeader();
    file_.pwrite(header.data(), header.size(), 0);
    file_.commit(options_.cancel);
  }

 private:
  static constexpr std::size_t kJsonBytes = 2028;
  static constexpr std::size_t kBinOffset = 12 + 8 + kJsonBytes + 8;
  static constexpr std::size_t kTriangleBytes = 12;

  std::size_t vertexBytes() const { return options_.values != nullptr ? 28 : 24; }
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
      // The format forbids what is not a number.
      if (options_.values != nullptr)
        to.put(std::isnan(placed.values[i]) ? 0.0f : placed.values[i]);
      ++i;
    });
    file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                 kBinOffset + placed.first_vertex * vertexBytes());
    const std::lock_guard lock(bounds_mutex_);
    least_ = glm::min(least_, least);
    greatest_ = glm::max(greatest_, greatest);
  }

  std::string makeHeader() const {
    const std::string json = makeJson();
    std::string header(triangles_ == 0 ? kBinOffset - 8 : kBinOffset, ' ');
    BytePointer to(reinterpret_cast<std::byte*>(header.data()));
    const auto bytes = [](std::uint64_t count) { return static_cast<std::uint32_t>(count); };
    to.put(std::uint32_t{0x46546C67}, std::uint32_t{2}, bytes(header.size() + binBytes()));
    to.put(bytes(kJsonBytes), std::uint32_t{0x4E4F534A});
    header.replace(20, json.size(), json);
    if (triangles_ > 0) {
      BytePointer bin(reinterpret_cast<std::byte*>(header.data()) + kBinOffset - 8);
      bin.put(bytes(binBytes()), std::uint32_t{0x004E4942});
    }
    return header;
  }

  std::string makeJson() const {
    const std::string head =
        joined(R"({"asset":{"version":"2.0","generator":"isobrick","extras":{"units":")",
               kMeshUnits, R"(","space":")", kMeshSpace, R"("}},"scene":0,"scenes":[)");
    if (triangles_ == 0) return joined(head, "{}]}");

    const bool has_values = options_.values != nullptr;
    const bool is_moved = center_ != glm::dvec3(0.0);
    const std::string vertex_bytes = std::to_string(vertices() * vertexBytes());
    const auto attribute = [&](std::size_t offset, const char* type, const std::string& rest) {
      return joined(R"({"bufferView":0,"byteOffset":)", std::to_string(offset),
                    R"(,"componentType":5126,"count":)", std::to_string(vertices()), R"(,"type":")",
                    type, "\"", rest, "}");
    };
    return joined(
        head, R"({"nodes":[0]}],"nodes":[{"mesh":0)",
        is_moved ? joined(R"(,"translation":)", arrayText(center_)) : "",
        R"(}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1)",
        has_values ? R"(,"_VALUE":3)" : "", R"(},"indices":2,"mode":4,"material":0}]}],)",
        R"("materials":[{"doubleSided":true,"pbrMetallicRoughness":)",
        R"({"metallicFactor":0,"roughnessFactor":0.8}}],"accessors":[)",
        attribute(0, "VEC3",
                  joined(R"(,"min":)", arrayText(least_), R"(,"max":)", arrayText(greatest_))),
        ",", attribute(12, "VEC3", ""), R"(,{"bufferView":1,"componentType":5125,"count":)",
        std::to_string(3 * triangles_), R"(,"type":"SCALAR"})",
        has_values ? joined(",", attribute(24, "SCALAR", "")) : "",
        R"(],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":)", vertex_bytes,
        R"(,"byteStride":)", std::to_string(vertexBytes()),
        R"(,"target":34962},{"buffer":0,"byteOffset":)", vertex_bytes, R"(,"byteLength":)",
        std::to_string(triangles_ * kTriangleBytes),
        R"(,"target":34963}],"buffers":[{"byteLength":)", std::to_string(binBytes()), "}]}");
  }

  SideFile indices_;
  glm::dvec3 center_{0.0};
  std::mutex bounds_mutex_;
  glm::vec3 least_{std::numeric_limits<float>::infinity()};
  glm::vec3 greatest_{-std::numeric_limits<float>::infinity()};
};

}  // namespace

std::unique_ptr<MeshFileSink> makeGlbSink(const std::string& path, const MeshFileOptions& options) {
  return std::make_unique<GlbSink>(path, options);
}

}  // namespace isobrick
