// Binary STL.
#include <algorithm>
#include <cstdio>
#include <glm/geometric.hpp>
#include <limits>
#include <mutex>
#include <string>

#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"
#include "isobrick/storage/atomic_file.h"

namespace isobrick {
namespace {

class StlSink : public MeshFileSink {
 public:
  StlSink(const std::string& path, const MeshFileOptions& options)
      : cancel_(options.cancel), file_(path) {}

  void begin(const MeshFrame& frame) override {
    placement_ = WorldPlacement(frame.geometry);
    voxel_ = frame.geometry.leastSpacing();
    is_far_ = frame.coordinateMagnitudeInVoxels() >= 2048;
    // Must not begin with "solid", by which readers recognise ASCII STL.
    std::string header = "isobrick; units: ";
    header.append(unitText(frame)).append("; space: ").append(spaceText(frame));
    const glm::dvec3 shift = shiftOf(frame);
    if (shift != glm::dvec3(0.0)) header.append("; shift: ").append(shiftText(shift));
    if (header.size() > kHeaderTextBytes)
      throw meshError(file_.path(), "the header of an STL file has no room for the shift " +
                                        shiftText(shift) + "; round it");
    header.resize(kHeaderBytes);
    file_.write(header.data(), header.size());
  }
  void place(PlacedBatch& placed) override {
    placed.first_triangle = triangles_;
    triangles_ += placed.batch.triangles.size() / 3;
    if (triangles_ > std::numeric_limits<std::uint32_t>::max())
      throw meshError(file_.path(),
                      "an STL file holds at most 4,294,967,295 triangles; write .ply instead");
  }
  void write(PlacedBatch& placed) override {
    const MeshBatch& batch = placed.batch;
    placed.bytes.resize(batch.triangles.size() / 3 * kTriangleBytes);
    BytePointer to(placed.bytes.data());
    const auto put = [&](const glm::vec3& v) { to.put(v.x, v.y, v.z); };
    Loss loss;
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
      if (is_far_) loss.add(a, b, c);
    }
    file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                 kHeaderBytes + placed.first_triangle * kTriangleBytes);
    const std::lock_guard lock(loss_mutex_);
    loss_.furthest = std::max(loss_.furthest, loss.furthest);
    loss_.without_area += loss.without_area;
  }
  void finish() override {
    file_.continueFrom(kHeaderBytes + triangles_ * kTriangleBytes);
    const auto count = static_cast<std::uint32_t>(triangles_);
    file_.pwrite(&count, sizeof count, 80);
    file_.commit(cancel_);
  }
  std::uint64_t vertices() const override { return 3 * triangles_; }
  std::string loss() const override {
    if (loss_.furthest < kHarmless * voxel_ && loss_.without_area == 0) return {};
    char text[160];
    std::snprintf(
        text, sizeof text,
        "so far from the origin single precision moves vertices by up to %.3g voxels, and "
        "%llu triangles have no area",
        loss_.furthest / voxel_, static_cast<unsigned long long>(loss_.without_area));
    return text;
  }

 private:
  static constexpr std::size_t kHeaderTextBytes = 80, kHeaderBytes = 84, kTriangleBytes = 50;
  static constexpr double kHarmless = 1e-3;  // voxels

  // Of positions as floats.
  struct Loss {
    double furthest = 0;  // world units
    std::uint64_t without_area = 0;

    void add(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
      for (const glm::dvec3* const place : {&a, &b, &c})
        furthest = std::max(furthest, glm::length(glm::dvec3(glm::vec3(*place)) - *place));
      const glm::dvec3 from{glm::vec3(a)};
      const glm::dvec3 across =
          glm::cross(glm::dvec3(glm::vec3(b)) - from, glm::dvec3(glm::vec3(c)) - from);
      without_area += glm::dot(across, across) > 0 ? 0 : 1;
    }
  };

  const CancelFlag* cancel_;
  AtomicFile file_;
  WorldPlacement placement_;
  double voxel_ = 1;  // the least spacing
  bool is_far_ = false;
  std::uint64_t triangles_ = 0;
  std::mutex loss_mutex_;
  Loss loss_;
};

}  // namespace

std::unique_ptr<MeshFileSink> makeStlSink(const std::string& path, const MeshFileOptions& options) {
  return std::make_unique<StlSink>(path, options);
}

}  // namespace isobrick
