#include "isobrick/viewer/stream/near_components.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <span>
#include <tuple>
#include <utility>

#include "isobrick/extract/sinks/edge_vertex_map.h"

namespace isobrick {
namespace {

constexpr double kBlockCells = 4.0;
constexpr std::int64_t kMostBlocks = 8;  // that a search goes to each side

// As a brick's place; x runs fastest.
std::uint64_t blockKey(const glm::i64vec3& block) {
  return static_cast<std::uint64_t>((block.z << 20 | block.y) << 20 | block.x);
}

}  // namespace

NearComponents::NearComponents(int level) : side_(std::ldexp(kBlockCells, level)) {}

// No voxel of the volume is below 0.
glm::i64vec3 NearComponents::blockOf(const glm::dvec3& voxel) const {
  return glm::i64vec3(voxel / side_);
}

void NearComponents::add(const MeshBatch& batch, const std::vector<std::uint32_t>& labels) {
  struct Sum {
    std::uint64_t block = 0;
    std::uint32_t label = 0;
    glm::vec3 places{0.0f};
    float count = 0.0f;
  };
  std::vector<Sum> sums;
  EdgeVertexMap<std::uint32_t> sum_of;  // by block of the brick and label
  const glm::i64vec3 first = blockOf(glm::dvec3(batch.origin));
  for (std::size_t v = 0; v < batch.positions.size(); ++v) {
    const glm::dvec3 voxel = glm::dvec3(batch.origin) + glm::dvec3(batch.positions[v]);
    const glm::i64vec3 block = blockOf(voxel), in_brick = block - first;
    const auto place = static_cast<std::uint64_t>((in_brick.z << 8 | in_brick.y) << 8 | in_brick.x);
    bool is_new = false;
    const std::uint32_t number = sum_of.findOrInsert(
        std::uint64_t{labels[v]} << 24 | place, static_cast<std::uint32_t>(sums.size()), &is_new);
    if (is_new) sums.push_back({blockKey(block), labels[v]});
    sums[number].places += glm::vec3(voxel - side_ * glm::dvec3(block));
    sums[number].count += 1.0f;
  }
  Batch kept;
  kept.brick.level = batch.level;
  kept.brick.brick = batch.brick;
  kept.middles.reserve(sums.size());
  for (const Sum& sum : sums)
    kept.middles.push_back({sum.block, sum.places / sum.count, sum.label});
  const std::lock_guard lock(mutex_);
  batches_.push_back(std::move(kept));
}

void NearComponents::finish(const SurfaceComponents& components) {
  for (Batch& batch : batches_) {
    const std::span<const std::uint32_t> places = components.ofBatch(batch.brick);
    for (Middle& middle : batch.middles) {
      middle.component = places[middle.component];
      middles_.push_back(middle);
    }
    batch = {};
  }
  batches_.clear();
  std::ranges::sort(middles_, {}, [](const Middle& middle) {
    const glm::vec3& place = middle.place;
    return std::tuple(middle.block, middle.component, place.x, place.y, place.z);
  });
}

// Of the blocks up to `reach` away along each axis.
void NearComponents::search(const glm::i64vec3& block, std::int64_t reach, const glm::dvec3& voxel,
                            std::uint32_t& nearest) const {
  double least = std::numeric_limits<double>::infinity();
  const glm::i64vec3 first = glm::max(block - reach, glm::i64vec3(0));
  for (std::int64_t z = first.z; z <= block.z + reach; ++z)
    for (std::int64_t y = first.y; y <= block.y + reach; ++y) {
      const std::uint64_t end = blockKey({block.x + reach, y, z});
      auto middle =
          std::ranges::lower_bound(middles_, blockKey({first.x, y, z}), {}, &Middle::block);
      for (; middle != middles_.end() && middle->block <= end; ++middle) {
        const glm::i64vec3 at(static_cast<std::int64_t>(middle->block & 0xfffff), y, z);
        const glm::dvec3 away = side_ * glm::dvec3(at) + glm::dvec3(middle->place) - voxel;
        const double distance = glm::dot(away, away);
        if (distance >= least) continue;
        least = distance;
        nearest = middle->component;
      }
    }
}

std::uint32_t NearComponents::at(const glm::dvec3& voxel, double reach) const {
  std::uint32_t nearest = kNoComponent;
  const glm::i64vec3 block = blockOf(voxel);
  const std::int64_t most =
      std::clamp(static_cast<std::int64_t>(reach / side_) + 1, std::int64_t{1}, kMostBlocks);
  for (std::int64_t blocks = 1; nearest == kNoComponent; blocks = std::min(2 * blocks, most)) {
    search(block, blocks, voxel, nearest);
    if (blocks == most) break;
  }
  return nearest;
}

}  // namespace isobrick
