#include "isobrick/extract/simplify/batch_group.h"

#include <glm/vec3.hpp>
#include <utility>

namespace isobrick {
namespace {

constexpr std::uint32_t kNoNumber = ~std::uint32_t{0};

}  // namespace

BatchGroup::BatchGroup(const Index3& cube) { placed.batch.origin = kCells * cube; }

void BatchGroup::add(const PlacedBatch& brick) {
  const MeshBatch& from = brick.batch;
  MeshBatch& to = placed.batch;
  if (to.positions.empty()) to.brick = from.brick;
  to.fraction_done = from.fraction_done;
  to.cells += from.cells;

  std::vector<std::uint32_t>& numbers = placed.numbers;
  numbers.assign(from.positions.size(), kNoNumber);
  auto next = static_cast<std::uint32_t>(to.positions.size());
  for (const MeshBatch::SharedVertex& shared : from.shared) {
    const auto [at, is_new] = shared_.try_emplace(shared.key, Shared{kNoNumber, shared.batches, 0});
    ++at->second.seen;
    numbers[shared.vertex] = at->second.vertex;
    if (is_new) continue;
    const SimplifyRemains::Vertex& own = brick.remains->vertices[shared.vertex];
    SimplifyRemains::Vertex& sum = remains.vertices[at->second.vertex];
    sum.quadric += own.quadric;
    sum.normal_sum += own.normal_sum;
  }
  const glm::vec3 offset(from.origin - to.origin);
  for (std::uint32_t v = 0; v < numbers.size(); ++v) {
    if (numbers[v] != kNoNumber) continue;
    numbers[v] = next++;
    to.positions.push_back(from.positions[v] + offset);
    to.normals.push_back(from.normals[v]);
    remains.vertices.push_back(brick.remains->vertices[v]);
  }
  for (const MeshBatch::SharedVertex& shared : from.shared)
    shared_.find(shared.key)->second.vertex = numbers[shared.vertex];
  const std::size_t first_cap = from.triangles.size() - from.cap_indices;
  for (std::size_t i = 0; i < from.triangles.size(); ++i)
    (i < first_cap ? to.triangles : caps_).push_back(numbers[from.triangles[i]]);
  for (std::size_t t = 0; t < brick.remains->triangles.size(); ++t)
    (3 * t < first_cap ? remains.triangles : cap_deviations_)
        .push_back(brick.remains->triangles[t]);
}

void BatchGroup::close() {
  MeshBatch& batch = placed.batch;
  batch.cap_indices = caps_.size();
  batch.triangles.insert(batch.triangles.end(), caps_.begin(), caps_.end());
  remains.triangles.insert(remains.triangles.end(), cap_deviations_.begin(), cap_deviations_.end());
  caps_.clear();
  cap_deviations_.clear();
  is_seam.assign(batch.positions.size(), 0);
  for (const auto& [key, shared] : shared_) {
    is_seam[shared.vertex] = 1;
    if (shared.seen == shared.batches) continue;
    const std::uint32_t left = shared.batches == 0 ? 0 : shared.batches - shared.seen + 1;
    batch.shared.push_back({shared.vertex, static_cast<std::uint8_t>(left), key});
  }
  std::ranges::sort(batch.shared, {}, &MeshBatch::SharedVertex::vertex);
  shared_.clear();
}

std::uint64_t BatchGroup::bytes() const {
  constexpr std::uint64_t kBytesOfShared = 48;  // with its node and bucket
  return placed.batch.bytes() + remains.vertices.size() * sizeof(SimplifyRemains::Vertex) +
         remains.triangles.size() * sizeof(Deviation) + shared_.size() * kBytesOfShared +
         caps_.size() * (sizeof(std::uint32_t) + sizeof(Deviation) / 3);
}

bool simplifiesGroups(const Query& query) {
  return query.simplify && query.isOfLevelZero() && query.region.isEverywhere() &&
         !query.has_brick && !query.is_progressive;
}

GroupSorter::Groups GroupSorter::add(const PlacedBatch& brick) {
  Groups closed;
  const Index3& at = brick.batch.brick;
  while (!open_.empty() && open_.begin()->first < Place{at.z, at.y, at.x})
    close(open_.begin(), closed);
  const Index3 cube = at / Index3(bricks_), last = (cube + Index3(1)) * bricks_ - Index3(1);
  const auto group = open_.try_emplace(Place{last.z, last.y, last.x}).first;
  if (group->second == nullptr) group->second = std::make_unique<BatchGroup>(cube);
  open_bytes_ -= group->second->bytes();
  group->second->add(brick);
  open_bytes_ += group->second->bytes();
  if (group->second->triangles() > kMostTriangles) close(group, closed);
  while (open_bytes_ > kMostOpenBytes) close(open_.begin(), closed);
  return closed;
}

GroupSorter::Groups GroupSorter::takeRest() {
  Groups closed;
  while (!open_.empty()) close(open_.begin(), closed);
  return closed;
}

void GroupSorter::close(OpenGroups::iterator group, Groups& closed) {
  open_bytes_ -= group->second->bytes();
  group->second->close();
  closed.push_back(std::move(group->second));
  open_.erase(group);
}

}  // namespace isobrick
