#include "isobrick/extract/surface_mesh.h"

#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {

void ReservedBytes::reserve() {
  if (data_ != nullptr) return;
  void* const at =
      ::mmap(nullptr, bytes_, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at == MAP_FAILED)
    throw Error("no address space for a mesh (" + std::to_string(bytes_ >> 30) +
                " GiB): " + std::strerror(errno) + "; stream the mesh to a file instead");
  ::madvise(at, bytes_, MADV_HUGEPAGE);  // where it is refused, small pages do
  data_ = static_cast<std::byte*>(at);
}

// A quarter more than there is, so that a mesh takes few steps however large it becomes; to the end
// of a huge page.
void ReservedBytes::openFurther(std::size_t bytes) {
  const auto begin = reinterpret_cast<std::uintptr_t>(data_);
  const std::uintptr_t wanted = begin + std::max(bytes, open_bytes_ + open_bytes_ / 4);
  const std::size_t end = std::min((wanted + kStep - 1) / kStep * kStep - begin, bytes_);
  if (::mprotect(data_ + open_bytes_, end - open_bytes_, PROT_READ | PROT_WRITE) != 0)
    throw Error("no memory for a mesh (" + std::to_string(end >> 20) +
                " MiB): " + std::strerror(errno) +
                "; extract a part of it or a coarser level, or stream it to a file");
  open_bytes_ = end;
}

ReservedBytes::ReservedBytes(ReservedBytes&& other) noexcept : bytes_(other.bytes_) {
  *this = std::move(other);
}

ReservedBytes& ReservedBytes::operator=(ReservedBytes&& other) noexcept {
  std::swap(data_, other.data_);
  std::swap(bytes_, other.bytes_);
  std::swap(open_bytes_, other.open_bytes_);
  return *this;
}

void ReservedBytes::release() noexcept {
  if (data_ != nullptr) ::munmap(data_, bytes_);
  data_ = nullptr;
  open_bytes_ = 0;
}

SurfaceMesh::SurfaceMesh()
    : position_bytes_(sizeof(glm::vec3) * (kMostVertices + 1)),
      normal_bytes_(sizeof(glm::vec3) * (kMostVertices + 1)),
      triangle_bytes_(3 * sizeof(std::uint32_t) * kMostTriangles) {}

SurfaceMesh::SurfaceMesh(SurfaceMesh&& other) noexcept : SurfaceMesh() { *this = std::move(other); }

SurfaceMesh& SurfaceMesh::operator=(SurfaceMesh&& other) noexcept {
  if (this == &other) return *this;
  release();
  position_bytes_ = std::move(other.position_bytes_);  // these change places
  normal_bytes_ = std::move(other.normal_bytes_);
  triangle_bytes_ = std::move(other.triangle_bytes_);
  vertices_ = std::exchange(other.vertices_, 0);
  triangles_ = std::exchange(other.triangles_, 0);
  parts_.swap(other.parts_);
  side_numbers_.swap(other.side_numbers_);
  placement_ = other.placement_;
  return *this;
}

void SurfaceMesh::clear(const GridGeometry& geometry) {
  vertices_ = triangles_ = 0;
  parts_.clear();
  placement_ = WorldPlacement(geometry);
  for (ReservedBytes* bytes : {&position_bytes_, &normal_bytes_, &triangle_bytes_})
    bytes->reserve();
}

void SurfaceMesh::openFor(std::uint64_t vertices, std::uint64_t triangles) {
  if (vertices > kMostVertices || triangles > kMostTriangles)
    throw Error(
        "the mesh has more than 4,294,966,272 vertices; extract a part of it or a coarser level, "
        "or stream it to a file");
  // Lanes are stored beyond the last vertex.
  position_bytes_.open((vertices + 1) * sizeof(glm::vec3));
  normal_bytes_.open((vertices + 1) * sizeof(glm::vec3));
  triangle_bytes_.open(triangles * 3 * sizeof(std::uint32_t));
}

const SurfaceMesh::Part& SurfaceMesh::partOfVertex(std::uint64_t vertex) const {
  const auto after = std::upper_bound(
      parts_.begin(), parts_.end(), vertex,
      [](std::uint64_t v, const Part& part) { return v < part.first_vertex + part.vertices; });
  return *after;
}

void SurfaceMesh::release() noexcept {
  vertices_ = triangles_ = 0;
  parts_.clear();
  side_numbers_.clear();
  position_bytes_.release();
  normal_bytes_.release();
  triangle_bytes_.release();
}

}  // namespace isobrick
