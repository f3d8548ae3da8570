// The memory of a mesh that is written in place.
#pragma once

#include <cstddef>
#include <vector>

#include "isobrick/extract/surface_mesh.h"

namespace isobrick {

// Address space for the most elements there may be; a part of it, from the beginning, is open.
// Addresses alone cost nothing, not even if the system promises no more than it has
// (vm.overcommit_memory=2) or bounds the memory of a process (RLIMIT_DATA). Memory comes with the
// first write to an open page, in huge pages if the system grants them, and stays.
class ReservedBytes {
 public:
  explicit ReservedBytes(std::size_t bytes) : bytes_(bytes) {}
  ~ReservedBytes() { release(); }
  ReservedBytes(const ReservedBytes&) = delete;
  ReservedBytes& operator=(const ReservedBytes&) = delete;

  // Takes the addresses, unless it has them. Throws Error if there are none.
  void reserve();
  // The first `bytes` may be read and written from here on; they are reserved. By one thread at a
  // time. Throws Error if the system does not promise the memory.
  void open(std::size_t bytes) {
    if (bytes > open_bytes_) openFurther(bytes);
  }
  // nullptr before reserve().
  std::byte* data() const { return data_; }
  // Gives all memory and addresses back to the system.
  void release() noexcept;

 private:
  // Systems that promise memory count open bytes as used, so open() takes few more than needed.
  static constexpr std::size_t kStep = std::size_t{32} << 20;
  static constexpr std::size_t kHugePageBytes = std::size_t{2} << 20;

  void openFurther(std::size_t bytes);

  void* map_ = nullptr;  // the reserved range
  std::byte* data_ = nullptr;
  const std::size_t bytes_;
  std::size_t open_bytes_ = 0;
};

struct SurfaceMesh::Memory {
  ReservedBytes positions{sizeof(glm::vec3) * (kMostVertices + 1)};
  ReservedBytes normals{sizeof(glm::vec3) * (kMostVertices + 1)};
  ReservedBytes triangles{3 * sizeof(std::uint32_t) * kMostTriangles};
  // Numbers of crossings on the high sides of bricks.
  std::vector<RawVector<std::uint32_t>> side_numbers;
};

}  // namespace isobrick
