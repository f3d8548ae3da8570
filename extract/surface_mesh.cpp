#include "isobrick/extract/surface_mesh.h"

#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {

ReservedBytes::ReservedBytes(std::size_t bytes) : bytes_(bytes) {
  void* const at = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
                          MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at == MAP_FAILED)
    throw Error("no address space for a mesh (" + std::to_string(bytes >> 30) +
                " GiB): " + std::strerror(errno) + "; stream the mesh to a file instead");
  ::madvise(at, bytes, MADV_HUGEPAGE);  // where it is refused, small pages do
  data_ = static_cast<std::byte*>(at);
}

ReservedBytes::~ReservedBytes() {
  if (data_ != nullptr) ::munmap(data_, bytes_);
}

ReservedBytes::ReservedBytes(ReservedBytes&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}

ReservedBytes& ReservedBytes::operator=(ReservedBytes&& other) noexcept {
  std::swap(data_, other.data_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

void ReservedBytes::release() { ::madvise(data_, bytes_, MADV_DONTNEED); }

SurfaceMesh::SurfaceMesh()
    : position_bytes_(sizeof(glm::vec3) * (kMostVertices + 1)),
      normal_bytes_(sizeof(glm::vec3) * (kMostVertices + 1)),
      triangle_bytes_(3 * sizeof(std::uint32_t) * kMostTriangles) {}

SurfaceMesh::SurfaceMesh(SurfaceMesh&& other) : SurfaceMesh() { *this = std::move(other); }

SurfaceMesh& SurfaceMesh::operator=(SurfaceMesh&& other) {
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
}

void SurfaceMesh::refuseTooMany(std::uint64_t vertices, std::uint64_t triangles) {
  if (vertices > kMostVertices || triangles > kMostTriangles)
    throw Error(
        "the mesh has more than 4,294,967,295 vertices; extract a part of it or a coarser level, "
        "or stream it to a file");
}

const SurfaceMesh::Part& SurfaceMesh::partOfVertex(std::uint64_t vertex) const {
  const auto after = std::upper_bound(
      parts_.begin(), parts_.end(), vertex,
      [](std::uint64_t v, const Part& part) { return v < part.first_vertex + part.vertices; });
  return *after;
}

void SurfaceMesh::release() {
  vertices_ = triangles_ = 0;
  parts_.clear();
  side_numbers_.clear();
  position_bytes_.release();
  normal_bytes_.release();
  triangle_bytes_.release();
}

}  // namespace isobrick
