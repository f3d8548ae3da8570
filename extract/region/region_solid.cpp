#include "isobrick/extract/region/region_solid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <utility>

#include "isobrick/extract/crossing_grid.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/region/region_cutter.h"
#include "isobrick/storage/brick_supply.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

class SolidSupply final : public BrickSupply {
 public:
  SolidSupply(const Pyramid& volume, const RegionField& field, const Query& query)
      : volume_(volume),
        field_(field),
        cancel_(query.cancel),
        is_below_(query.inside == InsideOf::kBelow),
        isovalue_(volume.storedIsovalue(query.isovalue)),
        outside_(is_below_ ? isovalue_
                           : std::nextafter(isovalue_, -std::numeric_limits<float>::infinity())) {}

  float outside() const { return outside_; }

  ValueRange range(const Index3& brick) const override {
    return cutRange(volume_.brickRange(0, brick), volume_.layout().brickCellBox(0, brick));
  }

  void copyTileRanges(const Index3& brick, std::byte* out) const override {
    const BrickLayout& layout = volume_.layout();
    const IndexBox cells = layout.brickCellBox(0, brick);
    const Index3 tiles = layout.brickTiles(0, brick);
    std::vector<ValueRange> ranges;
    volume_.tileRanges(0, brick, ranges, cancel_);
    auto* pair = reinterpret_cast<float*>(out);
    forEachIndex(IndexBox{Index3(0), tiles}, [&](const Index3& tile) {
      const Index3 first = cells.first + layout.tileCells() * tile;
      const Index3 count = glm::min(Index3(layout.tileCells()), cells.end() - first);
      const ValueRange cut =
          cutRange(ranges[static_cast<std::size_t>(linearIndex(tile, tiles))], {first, count});
      *pair++ = cut.min;
      *pair++ = cut.max;
    });
  }

  void copySamples(const Index3& brick, std::byte* out) const override {
    const BrickSamples samples = volume_.samples(0, brick, cancel_);
    auto* const values = reinterpret_cast<float*>(out);
    visitVoxelType(volume_.spec().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      std::copy_n(samples.data<T>(), samples.box.size(), values);
    });
    volume_.throwIfReadsFailed(0, brick);
    if (field_.sideOf(samples.box.first, samples.box.end() - Index3(1)) == BoxSide::kInside) return;
    std::vector<MaskReader> readers = field_.readers(cancel_);
    float* value = values;
    forEachIndex(samples.box, [&](const Index3& voxel) {
      const bool is_inside = is_below_ ? *value < isovalue_ : *value >= isovalue_;
      if (is_inside && !field_.has(voxel, readers)) *value = outside_;
      ++value;
    });
    for (const MaskReader& reader : readers) reader.throwIfReadsFailed();
  }

 private:
  // A range that has all values of these cells, and perhaps more.
  ValueRange cutRange(const ValueRange& range, const IndexBox& cells) const {
    const BoxSide side = field_.sideOf(cells.first, cells.end());
    if (side == BoxSide::kInside) return range;
    ValueRange cut = range;
    if (side == BoxSide::kOutside && is_below_) cut.min = std::max(cut.min, outside_);
    if (side == BoxSide::kOutside && !is_below_) cut.max = std::min(cut.max, outside_);
    cut.include(outside_);
    return cut;
  }

  const Pyramid& volume_;
  const RegionField& field_;
  const CancelFlag* const cancel_;
  const bool is_below_;  // the inside, of the isovalue
  const float isovalue_;
  const float outside_;  // nearest to it
};

}  // namespace

std::unique_ptr<const Pyramid> solidPyramid(const Pyramid& volume, const RegionField& field,
                                            const Query& query) {
  PyramidSpec spec = volume.spec();
  spec.voxel_type = VoxelType::kFloat32;
  spec.has_curvature = false;
  const auto supply = std::make_shared<SolidSupply>(volume, field, query);
  ValueRange values = volume.valueRange();
  values.include(supply->outside());
  return std::make_unique<const Pyramid>(volume.path(), spec, values, supply);
}

SolidCrossings::SolidCrossings(const RegionField& field, const GridGeometry& geometry,
                               const CancelFlag* cancel)
    : field_(field),
      readers_(field.readers(cancel)),
      to_normal_(glm::transpose(glm::inverse(geometry.indexToWorldMatrix()))) {}

void SolidCrossings::move(MeshBatch& batch) {
  if (batch.triangles.empty()) return;
  glm::vec3 lower = batch.positions[0], upper = lower;
  for (const glm::vec3& position : batch.positions) {
    lower = glm::min(lower, position);
    upper = glm::max(upper, position);
  }
  if (field_.sideOf(batch.origin + Index3(glm::floor(lower)),
                    batch.origin + Index3(glm::ceil(upper))) == BoxSide::kInside)
    return;
  is_moved_.resize(batch.positions.size());
  // Where a plane lies in one of the lattice's, crossings in it are on the cut as they are.
  const auto isOnWall = [&](std::uint32_t v) {
    const glm::dvec3 place = glm::dvec3(batch.origin) + glm::dvec3(batch.positions[v]);
    return std::ranges::any_of(field_.walls(), [&](const RegionWall& wall) {
      return std::abs(wall.depth(place)) < RegionCutter::kNear;
    });
  };
  for (std::uint32_t v = 0; v < is_moved_.size(); ++v)
    is_moved_[v] = moveVertex(v, batch) || isOnWall(v);
  putCapsLast(batch);
  for (const MaskReader& reader : readers_) reader.throwIfReadsFailed();
}

void SolidCrossings::putCapsLast(MeshBatch& batch) {
  caps_.clear();
  std::size_t kept = 0;
  const std::size_t end = batch.triangles.size() - batch.cap_indices;
  for (std::size_t i = 0; i < end; i += 3) {
    const std::array corners{batch.triangles[i], batch.triangles[i + 1], batch.triangles[i + 2]};
    const bool is_cap = is_moved_[corners[0]] + is_moved_[corners[1]] + is_moved_[corners[2]] == 3;
    for (const std::uint32_t corner : corners)
      if (is_cap)
        caps_.push_back(corner);
      else
        batch.triangles[kept++] = corner;
  }
  std::copy(caps_.begin(), caps_.end(),
            batch.triangles.begin() + static_cast<std::ptrdiff_t>(kept));
  batch.cap_indices += caps_.size();
}

bool SolidCrossings::moveVertex(std::uint32_t vertex, MeshBatch& batch) {
  const glm::dvec3 place = glm::dvec3(batch.origin) + glm::dvec3(batch.positions[vertex]);
  Index3 inside(glm::floor(place)), outside(glm::ceil(place));
  const bool has_lower = field_.has(inside, readers_);
  if (has_lower && field_.has(outside, readers_)) return false;
  if (!has_lower) std::swap(inside, outside);
  const glm::dvec3 from(inside), to(outside);
  const double at_value = glm::length(place - from);
  double at = at_value;
  glm::dvec3 outward = to - from;  // in voxel indices
  for (const RegionWall& wall : field_.walls()) {
    if (wall.depth(to) >= 0) continue;
    const double at_wall = wall.crossing(from, to);
    if (at_wall >= at) continue;
    at = at_wall;
    outward = -wall.inward(from + at * (to - from));
  }
  if (constexpr double kHalfWay = 0.5; at > kHalfWay && !haveAll(readers_, outside)) {
    at = kHalfWay;
    outward = to - from;
  }
  if (at == at_value) return false;
  constexpr double kSteps = 1 << kCrossingBits, kLeast = static_cast<double>(kLeastCrossing);
  at = std::clamp(std::round(at * kSteps) / kSteps, kLeast, 1 - kLeast);
  batch.positions[vertex] = glm::vec3(from + at * (to - from) - glm::dvec3(batch.origin));
  batch.normals[vertex] = glm::vec3(glm::normalize(to_normal_ * outward));
  return true;
}

}  // namespace isobrick
