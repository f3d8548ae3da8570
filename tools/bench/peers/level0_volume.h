// The voxels of a pyramid as a peer takes them: one dense block in memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace isobrick {

class Pyramid;

// Also included as C++17, for VTK's sake. Throws Error where the file is no pyramid or damaged.
class Level0Volume {
 public:
  explicit Level0Volume(const std::string& path);
  ~Level0Volume();

  std::array<std::int64_t, 3> voxels() const;
  std::array<double, 3> spacing() const;
  std::string typeName() const;  // "uint8", ..., as in voxelTypeName()
  std::size_t bytes() const;     // of all voxels
  double leastVoxel() const;

  // All voxels, x fastest, of the volume's own type, to `out` of bytes(). Uses the calling TBB
  // arena.
  void copyTo(void* out) const;

 private:
  std::unique_ptr<Pyramid> pyramid_;
};

}  // namespace isobrick
