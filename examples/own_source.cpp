// A source of one's own: an array, a simulation or, here, a formula becomes a pyramid. Its surface
// at 0, a heart, goes to heart.ply.
#include <isobrick/isobrick.h>

#include <cmath>
#include <cstdio>

using namespace isobrick;

// 161 x 121 x 161 voxels, half a unit apart.
class HeartSource : public VolumeSource {
 public:
  HeartSource() {
    info_.voxels = {161, 121, 161};
    info_.voxel_type = VoxelType::kFloat32;
    info_.geometry.spacing = glm::dvec3(0.5);
    info_.geometry.origin = {-40, -30, -40};
    info_.source = "heart";
    info_.format = "formula";
  }
  const VolumeInfo& info() const override { return info_; }

  // Any box, by several threads at once. A file that can only be read in order has readRows().
  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    auto* voxel = static_cast<float*>(out);
    for (std::int64_t z = box.first.z; z < box.end().z; ++z)
      for (std::int64_t y = box.first.y; y < box.end().y; ++y)
        for (std::int64_t x = box.first.x; x < box.end().x; ++x)
          *voxel++ = static_cast<float>(value(info_.geometry.indexToWorld({x, y, z})));
  }
  // Differs for any two sources whose voxels differ: a resumed build compares it.
  std::string identity() const override { return "heart of half units, version 1"; }

 private:
  // Taubin's heart; above 0 inside.
  static double value(const glm::dvec3& world) {
    const glm::dvec3 p = world / 28.0, s = p * p;
    return p.z * std::cbrt(s.x + 0.1125 * s.y) + 1 - (s.x + 2.25 * s.y + s.z);
  }
  VolumeInfo info_;
};

int main() try {
  HeartSource source;
  buildPyramid(source, "heart.isb", {});
  const auto file = makeMeshFileSink("heart.ply");
  const ExtractionReport report = extractIsosurface(Pyramid("heart.isb"), Query(), *file);
  std::printf("%llu triangles\n", static_cast<unsigned long long>(report.triangles));
} catch (const Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
