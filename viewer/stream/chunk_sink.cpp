#include "isobrick/viewer/stream/chunk_sink.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <limits>

#include "isobrick/extract/pyramid_values.h"
#include "isobrick/storage/voxel_type.h"
#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick {

void ChunkSink::write(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  SurfaceChunk chunk;
  chunk.origin = glm::dvec3(batch.origin);
  chunk.level = batch.level;
  chunk.surface = surface_;
  chunk.cells = batch.cells;
  if (batch.is_uniform) {
    chunk.key = key_;
    chunk.key->level = batch.level;
    chunk.key->brick = {batch.brick.x, batch.brick.y, batch.brick.z};
  }
  chunk.vertices.resize(batch.positions.size());
  chunk.lower = chunk.upper = batch.positions[0];
  for (std::size_t v = 0; v < batch.positions.size(); ++v) {
    chunk.vertices[v] = {batch.positions[v], packNormal(batch.normals[v])};
    chunk.lower = glm::min(chunk.lower, batch.positions[v]);
    chunk.upper = glm::max(chunk.upper, batch.positions[v]);
  }
  if (values_.components) {
    for (std::size_t v = 0; v < chunk.vertices.size(); ++v)
      chunk.vertices[v].value = packComponent(placed.components[v]);
  } else if (values_.of != nullptr) {
    placed.values.resize(batch.positions.size());
    values_.of->evaluate(placed, placed.values);
    for (std::size_t v = 0; v < placed.values.size(); ++v)
      chunk.vertices[v].value = packValue(static_cast<float>(placed.values[v]));
  }
  // Caps come first, so that the transition cells' triangles are the last ones.
  const auto caps = batch.triangles.end() - static_cast<std::ptrdiff_t>(batch.cap_indices);
  chunk.triangles.assign(caps, batch.triangles.end());
  chunk.triangles.insert(chunk.triangles.end(), batch.triangles.begin(), caps);
  chunk.transition_indices = batch.transition_indices;
  take_(static_cast<std::size_t>(placed.first_byte), std::move(chunk));
}

SceneLattice latticeOf(const GridGeometry& geometry) {
  return {geometry.indexToWorldMatrix(), geometry.origin};
}

namespace {

Index3 cellOf(const Lattice& lattice, int level, const glm::dvec3& index) {
  return glm::clamp(Index3(glm::floor(index)) >> std::int64_t{level}, Index3(0),
                    lattice.cells(level) - Index3(1));
}

// A brick's samples as a field over voxel indices.
template <typename T>
class SampleField {
 public:
  SampleField(const BrickSamples& samples, const Lattice& lattice, int level)
      : data_(samples.data<T>()),
        first_(samples.box.first),
        count_(samples.box.count),
        lattice_(lattice),
        level_(level) {}

  // Per voxel: differences over two cells, one-sided at the last samples.
  glm::dvec3 gradient(const glm::dvec3& index) const {
    const glm::dvec3 lower(lattice_.position(level_, first_));
    const glm::dvec3 upper(lattice_.position(level_, first_ + count_ - Index3(1)));
    const double step = std::ldexp(1.0, level_);
    glm::dvec3 result(0.0);
    for (int axis = 0; axis < 3; ++axis) {
      glm::dvec3 a = index, b = index;
      a[axis] = std::max(index[axis] - step, lower[axis]);
      b[axis] = std::min(index[axis] + step, upper[axis]);
      if (b[axis] > a[axis]) result[axis] = (value(b) - value(a)) / (b[axis] - a[axis]);
    }
    return result;
  }

 private:
  double value(const glm::dvec3& index) const {
    const Index3 cell =
        glm::clamp(cellOf(lattice_, level_, index), first_, first_ + count_ - Index3(2));
    const glm::dvec3 low(lattice_.position(level_, cell));
    const glm::dvec3 high(lattice_.position(level_, cell + Index3(1)));
    const glm::dvec3 share = (index - low) / (high - low);
    return trilinear(data_, count_, cell - first_, share);
  }

  const T* data_;
  Index3 first_, count_;  // in samples of the level
  const Lattice& lattice_;
  int level_;
};

class GradientValues : public ChunkValues {
 public:
  explicit GradientValues(const Pyramid& pyramid)
      : pyramid_(pyramid),
        to_world_(glm::transpose(glm::inverse(pyramid.spec().geometry.indexToWorldMatrix()))) {
    const RealRange values = pyramid.realRange();
    greatest_ = (values.max - values.min) / pyramid.spec().geometry.leastSpacing();
  }

  std::array<double, 2> range() const override { return {0.0, greatest_}; }

  void evaluate(PlacedBatch& placed, std::span<double> shares) const override {
    const MeshBatch& batch = placed.batch;
    if (batch.positions.empty()) return;
    const Index3 brick = brickOf(batch);
    const BrickSamples samples = pyramid_.samples(batch.level, brick);
    visitVoxelType(pyramid_.spec().voxel_type, [&](auto tag) {
      const SampleField<typename decltype(tag)::Type> field(samples, pyramid_.lattice(),
                                                            batch.level);
      for (std::size_t v = 0; v < batch.positions.size(); ++v) {
        const glm::dvec3 index = glm::dvec3(batch.origin) + glm::dvec3(batch.positions[v]);
        const double steepness =
            pyramid_.spec().values.scale * glm::length(to_world_ * field.gradient(index));
        shares[v] = greatest_ > 0.0 ? steepness / greatest_ : 0.0;
      }
    });
    pyramid_.throwIfReadsFailed(batch.level, brick);
  }

 private:
  // Vertices lie in the brick's closed box, and not all of them in one of its sides.
  Index3 brickOf(const MeshBatch& batch) const {
    glm::vec3 lower = batch.positions[0], upper = lower;
    for (const glm::vec3& position : batch.positions) {
      lower = glm::min(lower, position);
      upper = glm::max(upper, position);
    }
    const glm::dvec3 middle = 0.5 * (glm::dvec3(lower) + glm::dvec3(upper));
    return cellOf(pyramid_.lattice(), batch.level, glm::dvec3(batch.origin) + middle) /
           pyramid_.layout().brickCells();
  }

  const Pyramid& pyramid_;
  glm::dmat3 to_world_;  // gradients per voxel to gradients per world unit
  double greatest_ = 0.0;
};

class OtherValues : public ChunkValues {
 public:
  OtherValues(const Pyramid& shown, const std::string& path)
      : placement_(shown.spec().geometry), other_(path, shown.budgetBytes()), values_(other_) {}

  std::array<double, 2> range() const override {
    return {other_.realRange().min, other_.realRange().max};
  }

  void evaluate(PlacedBatch& placed, std::span<double> shares) const override {
    placed.world.resize(placed.batch.positions.size());
    for (std::size_t v = 0; v < placed.world.size(); ++v)
      placed.world[v] = placement_.worldPosition(placed.batch, static_cast<std::uint32_t>(v));
    values_.evaluate(placed.world, placed.batch.normals, shares);
    const auto [least, greatest] = range();
    const double span = std::max(greatest - least, std::numeric_limits<double>::min());
    for (double& share : shares) share = (static_cast<float>(share) - least) / span;
  }

 private:
  WorldPlacement placement_;
  Pyramid other_;
  PyramidValues values_;
};

}  // namespace

std::unique_ptr<ChunkValues> gradientValues(const Pyramid& pyramid) {
  return std::make_unique<GradientValues>(pyramid);
}

std::unique_ptr<ChunkValues> otherValues(const Pyramid& shown, const std::string& path) {
  return std::make_unique<OtherValues>(shown, path);
}

}  // namespace isobrick
