// A sink of one's own: takes triangles as they are made, holds none of them, and draws the view
// from above the volume into sphere.pgm; it measures the surface on the way.
#include <isobrick/isobrick.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <glm/geometric.hpp>

using namespace isobrick;

constexpr int kSize = 128;  // voxels along each axis, and pixels

class Drawing : public TriangleSink {
 public:
  void begin(const MeshFrame& frame) override { placement_ = WorldPlacement(frame.geometry); }
  // Batch after batch, never two at the same time.
  void accept(const MeshBatch& batch) override {
    for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
      glm::dvec3 at[3];
      for (std::size_t k = 0; k < 3; ++k)
        at[k] = placement_.worldPosition(batch, batch.triangles[i + k]);
      area += glm::length(glm::cross(at[1] - at[0], at[2] - at[0])) / 2;
      volume += glm::dot(at[0], glm::cross(at[1], at[2])) / 6;
      const glm::dvec3 middle = (at[0] + at[1] + at[2]) / 3.0;
      drawPixel(middle, batch.normals[batch.triangles[i]].z);
    }
  }
  void finish() override {  // not after an error
    std::ofstream file("sphere.pgm");
    file << "P2\n" << kSize << " " << kSize << "\n255\n";
    for (const int shade : shades_) file << shade << "\n";
  }
  double area = 0, volume = 0;

 private:
  void drawPixel(const glm::dvec3& at, float light) {
    const int x = static_cast<int>(std::lround(at.x)), y = static_cast<int>(std::lround(at.y));
    const auto pixel = static_cast<std::size_t>(y * kSize + x);
    if (at.z <= heights_[pixel]) return;
    heights_[pixel] = at.z;
    shades_[pixel] = 55 + static_cast<int>(200 * std::max(light, 0.0F));
  }
  WorldPlacement placement_;
  std::vector<double> heights_ = std::vector<double>(kSize * kSize, -1.0);
  std::vector<int> shades_ = std::vector<int>(kSize * kSize);
};

int main() try {
  buildPyramid(*makePhantomSource({.name = "sphere", .size = kSize}), "sphere.isb", {});
  Query query;  // isovalue 0; without a focus the finest level everywhere
  Drawing drawing;
  extractIsosurface(Pyramid("sphere.isb"), query, drawing);
  std::printf("area %.1f, volume %.1f\n", drawing.area, drawing.volume);
} catch (const Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
