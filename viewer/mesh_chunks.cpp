#include "isobrick/viewer/mesh_chunks.h"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <numeric>

#include "isobrick/viewer/render_camera.h"

namespace isobrick {
namespace {

constexpr std::size_t kMostTriangles = std::size_t{1} << 18;

// Cuts a mesh into chunks; holds a number for each of its vertices.
class MeshCutter {
 public:
  MeshCutter(const RenderMesh& mesh, const glm::dvec3& origin)
      : mesh_(mesh), origin_(origin), numbers_(mesh.positions.size(), kNone) {}

  void add(std::size_t triangle, SurfaceChunk& chunk) {
    const std::uint32_t* const corners = mesh_.triangles.data() + 3 * triangle;
    for (int k = 0; k < 3; ++k) {
      assert(corners[k] < mesh_.positions.size());
      chunk.triangles.push_back(mesh_.normals.empty() ? addCorner(corners[k], chunk)
                                                      : sharedCorner(corners[k], chunk));
    }
    if (mesh_.normals.empty()) giveFacetNormal(chunk);
  }
  // The next chunk has vertices of its own.
  void endChunk() {
    for (const std::uint32_t vertex : used_) numbers_[vertex] = kNone;
    used_.clear();
  }

 private:
  static constexpr std::uint32_t kNone = ~0u;

  std::uint32_t addCorner(std::uint32_t vertex, SurfaceChunk& chunk) const {
    SurfaceVertex result;
    result.position = glm::vec3(glm::dvec3(mesh_.positions[vertex]) - origin_);
    if (!mesh_.normals.empty()) result.normal = packNormal(mesh_.normals[vertex]);
    chunk.vertices.push_back(result);
    return static_cast<std::uint32_t>(chunk.vertices.size() - 1);
  }
  std::uint32_t sharedCorner(std::uint32_t vertex, SurfaceChunk& chunk) {
    if (numbers_[vertex] == kNone) {
      numbers_[vertex] = addCorner(vertex, chunk);
      used_.push_back(vertex);
    }
    return numbers_[vertex];
  }
  static void giveFacetNormal(SurfaceChunk& chunk) {
    SurfaceVertex* const corners = chunk.vertices.data() + chunk.vertices.size() - 3;
    const glm::vec3 facet = glm::cross(corners[1].position - corners[0].position,
                                       corners[2].position - corners[0].position);
    const float area = glm::length(facet);
    const auto normal = packNormal(area > 0.0f ? facet / area : glm::vec3(0.0f));
    for (int k = 0; k < 3; ++k) corners[k].normal = normal;
  }

  const RenderMesh& mesh_;
  glm::dvec3 origin_;
  std::vector<std::uint32_t> numbers_;  // of the mesh's vertices in the current chunk
  std::vector<std::uint32_t> used_;
};

glm::dvec3 originOf(const RenderMesh& mesh) {
  const RenderBox box = boundsOf(mesh.positions);
  return glm::round(0.5 * (glm::dvec3(box.lower) + glm::dvec3(box.upper)));
}

}  // namespace

std::vector<SurfaceChunk> chunksOf(const RenderMesh& mesh, bool with_levels) {
  const std::size_t count = mesh.triangles.size() / 3;
  if (count == 0) return {};
  const bool sorted = with_levels && !mesh.triangle_levels.empty();
  std::vector<std::size_t> order;
  if (sorted) {
    order.resize(count);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return mesh.triangle_levels[a] < mesh.triangle_levels[b];
    });
  }
  std::vector<SurfaceChunk> chunks;
  const glm::dvec3 origin = originOf(mesh);
  MeshCutter cutter(mesh, origin);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t triangle = sorted ? order[i] : i;
    const int level = sorted ? mesh.triangle_levels[triangle] : 0;
    if (chunks.empty() || chunks.back().level != level ||
        chunks.back().triangles.size() == 3 * kMostTriangles) {
      cutter.endChunk();
      chunks.emplace_back();
      chunks.back().origin = origin;
      chunks.back().level = level;
    }
    cutter.add(triangle, chunks.back());
  }
  for (SurfaceChunk& chunk : chunks) boundChunk(chunk);
  return chunks;
}

}  // namespace isobrick
