#include "isobrick/extract/meshing/fans.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <utility>

#include "isobrick/extract/kernels/crossing.h"

namespace isobrick {
namespace {

bool hasFlatTriangle(const glm::dvec3& center, std::span<const std::uint32_t> loop,
                     const MeshBatch& batch) {
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const glm::dvec3 area =
        glm::cross(glm::dvec3(batch.positions[loop[i]]) - center,
                   glm::dvec3(batch.positions[loop[(i + 1) % loop.size()]]) - center);
    if (!(glm::dot(area, area) > 0)) return true;
  }
  return false;
}

// Appends a triangle of vertices of the batch, turned round if the world is mirrored.
void addTriangle(const WorldFrame& frame, std::uint32_t a, std::uint32_t b, std::uint32_t c,
                 MeshBatch& batch) {
  if (frame.mirrored()) std::swap(b, c);
  batch.triangles.insert(batch.triangles.end(), {a, b, c});
}

// The nearest point whose coordinates are ones that crossings of the level may have: exact in float
// from the origin of any brick, so the same point whatever the brick.
glm::dvec3 onCrossingGrid(const glm::dvec3& point, int level) {
  const double steps = std::ldexp(1.0, kCrossingBits - level);
  return glm::floor(point * steps + 0.5) / steps;
}

// Whether the sides from a vertex of the loop to all others lie within the cell, or are the loop's.
bool seesAll(std::span<const std::uint8_t> faces, std::size_t vertex) {
  for (std::size_t step = 2; step + 1 < faces.size(); ++step)
    if ((faces[vertex] & faces[(vertex + step) % faces.size()]) != 0) return false;
  return true;
}

// The centre of gravity, or of the cell.
glm::dvec3 centerOf(const glm::dvec3& cell_center, std::span<const std::uint32_t> loop,
                    const MeshBatch& batch) {
  glm::dvec3 center(0.0);
  for (const std::uint32_t vertex : loop) center += glm::dvec3(batch.positions[vertex]);
  center = onCrossingGrid(center / static_cast<double>(loop.size()), batch.level);
  return hasFlatTriangle(center, loop, batch) ? cell_center : center;
}

// Appends it to the vertices.
std::uint32_t addCenter(const glm::dvec3& cell_center, std::span<const std::uint32_t> loop,
                        MeshBatch& batch) {
  const glm::dvec3 center = centerOf(cell_center, loop, batch);
  glm::dvec3 normal(0.0);
  for (const std::uint32_t vertex : loop) normal += glm::dvec3(batch.normals[vertex]);
  const double norm = std::sqrt(glm::dot(normal, normal));
  const auto number = static_cast<std::uint32_t>(batch.positions.size());
  batch.positions.push_back(glm::vec3(center));
  batch.normals.push_back(norm > 1e-6 ? glm::vec3(normal / norm) : batch.normals[loop[0]]);
  return number;
}

}  // namespace

std::optional<std::size_t> hubOf(const ContourLoop& loop) {
  for (std::size_t vertex = 0; vertex < loop.faces.size(); ++vertex)
    if (seesAll(loop.faces, vertex)) return vertex;
  return std::nullopt;
}

void addFan(const WorldFrame& frame, const ContourLoop& loop, std::size_t hub, MeshBatch& batch) {
  const std::span<const std::uint32_t> vertices = loop.vertices;
  const std::size_t size = vertices.size();
  for (std::size_t step = 1; step + 1 < size; ++step)
    addTriangle(frame, vertices[hub], vertices[(hub + step) % size],
                vertices[(hub + step + 1) % size], batch);
}

void addCenteredFan(const WorldFrame& frame, const glm::dvec3& cell_center, const ContourLoop& loop,
                    MeshBatch& batch) {
  const std::span<const std::uint32_t> vertices = loop.vertices;
  const std::uint32_t center = addCenter(cell_center, vertices, batch);
  for (std::size_t i = 0; i < vertices.size(); ++i)
    addTriangle(frame, center, vertices[i], vertices[(i + 1) % vertices.size()], batch);
}

void SeveralFans::clear() {
  vertices_.clear();
  faces_.clear();
  ends_.clear();
}

void SeveralFans::add(const ContourLoop& loop) {
  vertices_.insert(vertices_.end(), loop.vertices.begin(), loop.vertices.end());
  faces_.insert(faces_.end(), loop.faces.begin(), loop.faces.end());
  ends_.push_back(vertices_.size());
}

ContourLoop SeveralFans::loop(std::size_t number) const {
  const std::size_t begin = number == 0 ? 0 : ends_[number - 1], size = ends_[number] - begin;
  return {std::span(vertices_).subspan(begin, size), std::span(faces_).subspan(begin, size)};
}

void SeveralFans::append(const WorldFrame& frame, const glm::dvec3& cell_corner,
                         const glm::dvec3& cell_center, MeshBatch& batch) {
  choices_.assign(loops(), {});
  for (std::size_t i = 0; i < loops(); ++i) {
    const ContourLoop loop = this->loop(i);
    for (std::size_t vertex = 0; vertex < loop.faces.size(); ++vertex)
      if (seesAll(loop.faces, vertex)) choices_[i].hubs.push_back(vertex);
    choices_[i].center = centerOf(cell_center, loop.vertices, batch);
  }
  bool is_apart = !doCross(cell_corner, batch);
  for (std::size_t centers = 0; !is_apart && centers <= loops(); ++centers)
    is_apart = chooseApart(centers, cell_corner, batch);
  for (std::size_t i = 0; i < loops(); ++i)
    if (choices_[i].isCentered())
      addCenteredFan(frame, cell_center, loop(i), batch);
    else
      addFan(frame, loop(i), choices_[i].hubs[choices_[i].chosen], batch);
}

// Tries one choice after the other, that of the first loop fastest. If it finds none, the choice is
// the first again.
bool SeveralFans::chooseApart(std::size_t most_centers, const glm::dvec3& cell_corner,
                              const MeshBatch& batch) {
  const auto takesCenter = [](const Choices& c) { return c.isCentered() && !c.hubs.empty(); };
  const auto next = [](Choices& c) {
    return (c.chosen = (c.chosen + 1) % (c.hubs.size() + 1)) > 0;
  };
  do {
    const auto centers = std::count_if(choices_.begin(), choices_.end(), takesCenter);
    if (static_cast<std::size_t>(centers) <= most_centers && !doCross(cell_corner, batch))
      return true;
  } while (std::any_of(choices_.begin(), choices_.end(), next));
  return false;
}

// Whether two triangles of the chosen fans do, in whole numbers: coordinates of crossings and
// centres are multiples of a step.
bool SeveralFans::doCross(const glm::dvec3& cell_corner, const MeshBatch& batch) {
  // Of a voxel: a cell at the volume's end may be as long as any number of voxels.
  constexpr int kMostBits = 25;
  static_assert(1 << kMostBits == SelfCrossings::kMostCoordinate);
  const double steps = std::ldexp(1.0, std::min(kCrossingBits + 1, kMostBits - batch.level));
  const auto put = [&](const glm::dvec3& position) {
    positions_.push_back(glm::ivec3((position - cell_corner) * steps));
    return static_cast<std::uint32_t>(positions_.size() - 1);
  };
  positions_.clear();
  triangles_.clear();
  for (const std::uint32_t vertex : vertices_) put(glm::dvec3(batch.positions[vertex]));
  for (std::size_t i = 0; i < loops(); ++i) {
    const auto first = static_cast<std::uint32_t>(i == 0 ? 0 : ends_[i - 1]);
    const auto size = static_cast<std::uint32_t>(ends_[i]) - first;
    const Choices& choices = choices_[i];
    if (choices.isCentered()) {
      const std::uint32_t center = put(choices.center);
      for (std::uint32_t k = 0; k < size; ++k)
        triangles_.push_back({center, first + k, first + (k + 1) % size});
      continue;
    }
    const auto hub = static_cast<std::uint32_t>(choices.hubs[choices.chosen]);
    for (std::uint32_t step = 1; step + 1 < size; ++step)
      triangles_.push_back(
          {first + hub, first + (hub + step) % size, first + (hub + step + 1) % size});
  }
  return !crossings_.find(positions_, triangles_).empty();
}

}  // namespace isobrick
