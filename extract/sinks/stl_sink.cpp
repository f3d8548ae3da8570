// Binary STL.
#include <limits>
#include <string>

#include "isobrick/extract/sinks/byte_pointer.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

class StlSink : public MeshFileSink {
 public:
  StlSink(const std::string& path, const MeshFileOptions& options)
      : cancel_(options.cancel), file_(path) {}

  void begin(const MeshFrame& frame) override {
    placement_ = WorldPlacement(frame.geometry);
    // Must not begin with "solid", by which readers recognise ASCII STL.
    std::string header = "isobrick; units: ";
    header += lengthUnitName(frame.geometry.unit);
    header.append("; space: ").append(kMeshSpace).resize(kHeaderBytes);
    file_.write(header.data(), header.size());
  }
  void place(PlacedBatch& placed) override {
    placed.first_triangle = triangles_;
    triangles_ += placed.batch.triangles.size() / 3;
    if (triangles_ > std::numeric_limits<std::uint32_t>::max())
      throw Error("'" + file_.path() +
                      "': an STL file holds at most 4,294,967,295 triangles; write .ply instead",
                  {.path = file_.path()});
  }
  void write(PlacedBatch& placed) override {
    const MeshBatch& batch = placed.batch;
    placed.bytes.resize(batch.triangles.size() / 3 * kTriangleBytes);
    BytePointer to(placed.bytes.data());
    const auto put = [&](const glm::vec3& v) { to.put(v.x, v.y, v.z); };
    for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
      const glm::dvec3 a = placement_.worldPosition(batch, batch.triangles[i]);
      const glm::dvec3 b = placement_.worldPosition(batch, batch.triangles[i + 1]);
      const glm::dvec3 c = placement_.worldPosition(batch, batch.triangles[i + 2]);
      // A triangle without an area has no normal, and zeros say so.
      const glm::dvec3 across = glm::cross(b - a, c - a);
      put(glm::dot(across, across) > 0 ? glm::vec3(glm::normalize(across)) : glm::vec3(0.0f));
      put(glm::vec3(a));
      put(glm::vec3(b));
      put(glm::vec3(c));
      to.put(std::uint16_t{0});
    }
    file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                 kHeaderBytes + placed.first_triangle * kTriangleBytes);
  }
  void finish() override {
    file_.continueFrom(kHeaderBytes + triangles_ * kTriangleBytes);
    const auto count = static_cast<std::uint32_t>(triangles_);
    file_.pwrite(&count, sizeof count, 80);
    file_.commit(cancel_);
  }
  std::uint64_t vertices() const override { return 3 * triangles_; }

 private:
  static constexpr std::size_t kHeaderBytes = 84, kTriangleBytes = 50;

  const CancelFlag* cancel_;
  AtomicFile file_;
  WorldPlacement placement_;
  std::uint64_t triangles_ = 0;
};

}  // namespace

std::unique_ptr<MeshFileSink> makeStlSink(const std::string& path, const MeshFileOptions& options) {
  return std::make_unique<StlSink>(path, options);
}

}  // namespace isobrick
