// Which component of a surface is near a point: for meshes of the same surface that are coarser.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <mutex>
#include <vector>

#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Cuts the volume into blocks of 4 x 4 x 4 cells, and keeps of every component in a block the
// middle of its vertices there: 24 bytes, for some 30 triangles. Made batch by batch; asked by any
// number of threads when it is finished.
class NearComponents {
 public:
  // `level`: of the batches.
  explicit NearComponents(int level);

  // A batch and the components that its vertices have in it (labelComponents()). Thread-safe; the
  // result does not depend on the order.
  void add(const MeshBatch& batch, const std::vector<std::uint32_t>& labels);
  // After the last one. `components`: of the batches.
  void finish(const SurfaceComponents& components);

  // The place in the list of a component near a voxel index, kNoComponent if there is none within
  // `reach` voxels, or a block more; of several about the nearest. The same for the same surface.
  std::uint32_t at(const glm::dvec3& voxel, double reach) const;
  std::uint64_t bytes() const { return middles_.size() * sizeof(Middle); }

 private:
  struct Middle {
    std::uint64_t block = 0;
    glm::vec3 place{0.0f};  // voxels from the block's corner
    std::uint32_t component = 0;
  };
  struct Batch {
    MeshBatch brick;  // without vertices: names the batch
    std::vector<Middle> middles;
  };
  glm::i64vec3 blockOf(const glm::dvec3& voxel) const;
  void search(const glm::i64vec3& block, std::int64_t reach, const glm::dvec3& voxel,
              std::uint32_t& nearest) const;

  const double side_;  // of a block, voxels
  std::mutex mutex_;   // guards the batches
  std::vector<Batch> batches_;
  std::vector<Middle> middles_;  // ascending in block, then component
};

}  // namespace isobrick
