#include "isobrick/extract/region/region_cutter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "isobrick/extract/crossing_grid.h"
#include "isobrick/extract/sinks/batch_components.h"

namespace isobrick {
namespace {

glm::dvec3 voxelOf(const MeshBatch& batch, std::uint32_t vertex) {
  return glm::dvec3(batch.origin) + glm::dvec3(batch.positions[vertex]);
}

// Calls visit(voxel) for the voxels beside a place: the corners of the cube, face or edge between
// voxels in which it lies. False as soon as one of the calls is.
template <typename Visit>
bool allVoxelsBeside(const glm::dvec3& place, Visit&& visit) {
  const Index3 lower(glm::floor(place)), upper(glm::ceil(place));
  for (std::int64_t z = lower.z; z <= upper.z; ++z)
    for (std::int64_t y = lower.y; y <= upper.y; ++y)
      for (std::int64_t x = lower.x; x <= upper.x; ++x)
        if (!visit(Index3(x, y, z))) return false;
  return true;
}

// All bits depend on all bits (the end of splitmix64).
std::uint64_t mixed(std::uint64_t bits) {
  bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9u;
  bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBu;
  return bits ^ (bits >> 31);
}

// The key of the vertex that a wall makes on the side between two shared vertices. Keys of edges
// have no bit 63. Two of a million such vertices of a mesh have the same key with a chance of
// 1e-7.
EdgeKey keyOfCut(EdgeKey inside, EdgeKey outside, std::uint64_t wall) {
  const EdgeKey key = mixed(mixed(inside + wall) ^ outside) | EdgeKey{1} << 63;
  return key == kNoEdge ? key - 1 : key;
}

bool hasArea(const MeshBatch& batch, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  const glm::dvec3 from(batch.positions[a]);
  return glm::cross(glm::dvec3(batch.positions[b]) - from, glm::dvec3(batch.positions[c]) - from) !=
         glm::dvec3(0.0);
}

}  // namespace

bool RegionCutter::cut(MeshBatch& batch) {
  if (batch.triangles.empty()) return false;
  const auto depthInMasks = [&](const glm::dvec3& place) {
    const bool stays =
        allVoxelsBeside(place, [&](const Index3& voxel) { return haveAll(readers_, voxel); });
    return stays ? 1.0 : -1.0;
  };
  std::uint64_t number = 0;
  bool is_cut = !readers_.empty() && cutAt(depthInMasks, nullptr, number, batch);
  for (const RegionWall& wall : field_.walls()) {
    const auto depth = [&](const glm::dvec3& place) { return wall.depth(place); };
    if (cutAt(depth, &wall, ++number, batch)) is_cut = true;
  }
  if (!is_cut) return false;
  dropUnusedVertices(batch, numbers_);
  batch.is_uniform = false;
  return true;
}

template <typename Depth>
bool RegionCutter::cutAt(const Depth& depth, const RegionWall* wall, std::uint64_t number,
                         MeshBatch& batch) {
  depths_.resize(batch.positions.size());
  for (std::uint32_t v = 0; v < depths_.size(); ++v) depths_[v] = depth(voxelOf(batch, v));
  if (std::ranges::all_of(depths_, [](double one) { return one >= -kNear; })) return false;
  keys_.assign(batch.positions.size(), kNoEdge);
  for (const MeshBatch::SharedVertex& shared : batch.shared) keys_[shared.vertex] = shared.key;
  made_.clear();
  triangles_.clear();
  const std::size_t plain = batch.triangles.size() - batch.transition_indices;
  std::size_t kept_plain = 0;
  const auto isIn = [&](std::uint32_t v) { return depths_[v] > kNear; };
  const auto isOut = [&](std::uint32_t v) { return depths_[v] < -kNear; };
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    if (i == plain) kept_plain = triangles_.size();
    std::array<std::uint32_t, 4> corners{};  // of the part that stays
    std::size_t count = 0;
    bool has_in = false, has_out = false;
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const std::uint32_t a = batch.triangles[i + corner];
      const std::uint32_t b = batch.triangles[i + (corner + 1) % 3];
      has_in = has_in || isIn(a);
      has_out = has_out || isOut(a);
      if (!isOut(a)) corners[count++] = a;
      if (wall == nullptr) continue;
      if (isIn(a) && isOut(b)) corners[count++] = vertexBetween(*wall, number, a, b, batch);
      if (isOut(a) && isIn(b)) corners[count++] = vertexBetween(*wall, number, b, a, batch);
    }
    if (has_out && (!has_in || wall == nullptr)) continue;
    for (std::size_t corner = 2; corner < count; ++corner) {
      if (has_out && !hasArea(batch, corners[0], corners[corner - 1], corners[corner])) continue;
      triangles_.push_back(corners[0]);
      triangles_.push_back(corners[corner - 1]);
      triangles_.push_back(corners[corner]);
    }
  }
  batch.transition_indices = batch.transition_indices == 0 ? 0 : triangles_.size() - kept_plain;
  batch.triangles.swap(triangles_);
  return true;
}

std::uint32_t RegionCutter::vertexBetween(const RegionWall& wall, std::uint64_t number,
                                          std::uint32_t inside, std::uint32_t outside,
                                          MeshBatch& batch) {
  const auto vertex = static_cast<std::uint32_t>(batch.positions.size());
  const auto [found, is_new] = made_.try_emplace(std::uint64_t{inside} << 32 | outside, vertex);
  if (!is_new) return found->second;
  const glm::dvec3 from = voxelOf(batch, inside), to = voxelOf(batch, outside);
  const double t = wall.crossing(from, to);
  const double step = std::ldexp(1.0, batch.level - kCrossingBits);
  const glm::dvec3 place = glm::clamp(glm::round((from + t * (to - from)) / step) * step,
                                      glm::min(from, to), glm::max(from, to));
  batch.positions.emplace_back(place - glm::dvec3(batch.origin));
  const glm::dvec3 normal =
      (1 - t) * glm::dvec3(batch.normals[inside]) + t * glm::dvec3(batch.normals[outside]);
  const double length = glm::length(normal);
  batch.normals.push_back(length > 0 ? glm::vec3(normal / length) : batch.normals[inside]);
  // A side of two shared vertices may lie between two bricks.
  if (keys_[inside] != kNoEdge && keys_[outside] != kNoEdge)
    batch.shared.push_back({vertex, 2, keyOfCut(keys_[inside], keys_[outside], number)});
  return vertex;
}

}  // namespace isobrick
