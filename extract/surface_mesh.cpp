#include "isobrick/extract/surface_mesh.h"

#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include "isobrick/extract/session/surface_memory.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// From a huge page on: bytes before the first whole one come in small pages.
void ReservedBytes::reserve() {
  if (data_ != nullptr) return;
  map_ = ::mmap(nullptr, bytes_ + kHugePageBytes, PROT_NONE,
                MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (map_ == MAP_FAILED)
    throw Error("no address space for a mesh (" + std::to_string(bytes_ >> 30) +
                " GiB): " + std::strerror(errno) + "; stream the mesh to a file instead");
  data_ = static_cast<std::byte*>(map_);
  data_ += -reinterpret_cast<std::uintptr_t>(data_) % kHugePageBytes;
  ::madvise(data_, bytes_, MADV_HUGEPAGE);  // if it is refused, small pages do
}

// A quarter more than there is, so that a mesh takes few steps however large it becomes; to the end
// of a huge page.
void ReservedBytes::openFurther(std::size_t bytes) {
  const std::size_t wanted = std::max(bytes, open_bytes_ + open_bytes_ / 4);
  const std::size_t end = std::min((wanted + kStep - 1) / kStep * kStep, bytes_);
  if (::mprotect(data_ + open_bytes_, end - open_bytes_, PROT_READ | PROT_WRITE) != 0)
    throw Error("no memory for a mesh (" + std::to_string(end >> 20) +
                " MiB): " + std::strerror(errno) +
                "; extract a part of it or a coarser level, or stream it to a file");
  open_bytes_ = end;
}

void ReservedBytes::release() noexcept {
  if (data_ != nullptr) ::munmap(map_, bytes_ + kHugePageBytes);
  data_ = nullptr;
  open_bytes_ = 0;
}

SurfaceMesh::SurfaceMesh() = default;
SurfaceMesh::~SurfaceMesh() = default;

SurfaceMesh::SurfaceMesh(SurfaceMesh&& other) noexcept { *this = std::move(other); }

SurfaceMesh& SurfaceMesh::operator=(SurfaceMesh&& other) noexcept {
  if (this == &other) return *this;
  release();
  memory_.swap(other.memory_);
  vertices_ = std::exchange(other.vertices_, 0);
  triangles_ = std::exchange(other.triangles_, 0);
  parts_.swap(other.parts_);
  placement_ = other.placement_;
  return *this;
}

glm::vec3* SurfaceMesh::positionData() const {
  return memory_ ? reinterpret_cast<glm::vec3*>(memory_->positions.data()) : nullptr;
}
glm::vec3* SurfaceMesh::normalData() const {
  return memory_ ? reinterpret_cast<glm::vec3*>(memory_->normals.data()) : nullptr;
}
std::uint32_t* SurfaceMesh::triangleData() const {
  return memory_ ? reinterpret_cast<std::uint32_t*>(memory_->triangles.data()) : nullptr;
}

void SurfaceMesh::clear(const GridGeometry& geometry) {
  vertices_ = triangles_ = 0;
  parts_.clear();
  placement_ = WorldPlacement(geometry);
  if (!memory_) memory_ = std::make_unique<Memory>();
  for (ReservedBytes* bytes : {&memory_->positions, &memory_->normals, &memory_->triangles})
    bytes->reserve();
}

void SurfaceMesh::openFor(std::uint64_t vertices, std::uint64_t triangles) {
  if (vertices > kMostVertices || triangles > kMostTriangles)
    throw Error(
        "the mesh has more than 4,294,966,272 vertices; extract a part of it or a coarser level, "
        "or stream it to a file");
  // Lanes are stored beyond the last vertex.
  memory_->positions.open((vertices + 1) * sizeof(glm::vec3));
  memory_->normals.open((vertices + 1) * sizeof(glm::vec3));
  memory_->triangles.open(triangles * 3 * sizeof(std::uint32_t));
}

const SurfaceMesh::Part& SurfaceMesh::partOfVertex(std::uint64_t vertex) const {
  const auto after = std::upper_bound(
      parts_.begin(), parts_.end(), vertex,
      [](std::uint64_t v, const Part& part) { return v < part.first_vertex + part.vertices; });
  return *after;
}

void SurfaceMesh::keep(std::span<const std::uint8_t> is_kept) {
  constexpr std::uint32_t kDropped = ~std::uint32_t{0};
  std::vector<std::uint32_t> number(vertices_, kDropped);
  std::uint32_t* const corners = triangleData();
  for (std::uint64_t corner = 0; corner < 3 * triangles_; ++corner)
    if (is_kept[corner / 3] != 0) number[corners[corner]] = 0;
  std::uint64_t vertices = 0, triangles = 0;
  for (Part& part : parts_) {
    const Part before =
        std::exchange(part, {vertices, 0, triangles, 0, part.origin, part.level, 0});
    for (std::uint64_t v = before.first_vertex; v < before.first_vertex + before.vertices; ++v) {
      if (number[v] == kDropped) continue;
      positionData()[vertices] = positionData()[v];
      normalData()[vertices] = normalData()[v];
      number[v] = static_cast<std::uint32_t>(vertices++);
    }
    const std::uint64_t end = before.first_triangle + before.triangles;
    for (std::uint64_t t = before.first_triangle; t < end; ++t) {
      if (is_kept[t] == 0) continue;
      for (std::uint64_t corner = 0; corner < 3; ++corner)
        corners[3 * triangles + corner] = number[corners[3 * t + corner]];
      ++triangles;
      part.caps += t >= end - before.caps ? 1 : 0;
    }
    part.vertices = vertices - part.first_vertex;
    part.triangles = triangles - part.first_triangle;
  }
  std::erase_if(parts_, [](const Part& part) { return part.vertices + part.triangles == 0; });
  vertices_ = vertices;
  triangles_ = triangles;
}

void SurfaceMesh::release() noexcept {
  vertices_ = triangles_ = 0;
  parts_.clear();
  memory_.reset();
}

}  // namespace isobrick
