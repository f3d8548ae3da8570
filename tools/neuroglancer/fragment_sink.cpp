#include "tools/neuroglancer/fragment_sink.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "isobrick/storage/error.h"
#include "tools/neuroglancer/draco_fragment.h"

namespace isobrick {
namespace {

bool comesBefore(const MeshFragment& a, const MeshFragment& b) {
  return mortonCode(a.brick) < mortonCode(b.brick);
}

}  // namespace

std::uint64_t mortonCode(const Index3& brick) {
  std::uint64_t code = 0;
  for (int bit = 0; bit < 21; ++bit)
    for (int axis = 0; axis < 3; ++axis)
      code |= (static_cast<std::uint64_t>(brick[axis]) >> bit & 1) << (3 * bit + axis);
  return code;
}

glm::ivec3 fragmentPosition(const glm::dvec3& position, const Index3& low, std::int64_t edge) {
  constexpr double kMost = (1 << kFragmentBits) - 1;
  const glm::dvec3 share = (position - glm::dvec3(low)) / static_cast<double>(edge);
  return glm::ivec3(glm::clamp(glm::floor(share * kMost + 0.5), 0.0, kMost));
}

void FragmentSink::prepare(PlacedBatch& placed) {
  auto& triangles = placed.batch.triangles;
  for (std::size_t t = 0; is_mirrored_ && t < triangles.size(); t += 3)
    std::swap(triangles[t], triangles[t + 1]);
}

void FragmentSink::write(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  if (batch.triangles.empty()) return;
  std::vector<glm::ivec3> positions;
  positions.reserve(batch.positions.size());
  for (const glm::vec3& position : batch.positions)
    positions.push_back(fragmentPosition(glm::dvec3(batch.origin) + glm::dvec3(position),
                                         batch.brick * edge_, edge_));
  const std::vector<char> packed = packFragment(positions, batch.triangles);
  if (packed.size() > std::numeric_limits<std::uint32_t>::max())
    throw Error("a fragment of the mesh is larger than 4 GiB; build the pyramid with --brick 64");
  MeshFragment fragment{batch.brick, static_cast<std::uint32_t>(packed.size()),
                        end_.fetch_add(packed.size()), batch.triangles.size() / 3};
  spool_.pwrite(packed.data(), packed.size(), fragment.offset);
  const std::lock_guard lock(mutex_);
  fragments_.push_back(fragment);
}

std::vector<MeshFragment> FragmentSink::takeFragments() {
  std::sort(fragments_.begin(), fragments_.end(), comesBefore);
  return std::move(fragments_);
}

void addMissingParents(std::span<const MeshFragment> finer, std::vector<MeshFragment>& coarser) {
  std::vector<MeshFragment> missing;
  auto at = coarser.cbegin();
  for (const MeshFragment& child : finer) {  // so are their parents in order
    MeshFragment parent;
    parent.brick = child.brick / Index3(2);
    if (!missing.empty() && missing.back().brick == parent.brick) continue;
    at = std::lower_bound(at, coarser.cend(), parent, comesBefore);
    if (at == coarser.cend() || at->brick != parent.brick) missing.push_back(parent);
  }
  coarser.insert(coarser.end(), missing.begin(), missing.end());
  std::sort(coarser.begin(), coarser.end(), comesBefore);
}

}  // namespace isobrick
