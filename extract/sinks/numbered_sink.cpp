#include "isobrick/extract/sinks/numbered_sink.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <numeric>
#include <utility>

#include "isobrick/extract/pyramid_values.h"

namespace isobrick {

void NumberedMesh::begin(const MeshFrame& frame) {
  frame_ = frame;
  double_precision_ = frame_.coordinateMagnitudeInVoxels() >= 2048;
  placement_ = WorldPlacement(frame_.geometry);
  if (!frame_.placed) return;
  volume_placement_ = WorldPlacement(frame_.placed->volume);
  const glm::dmat3 moved = frame_.geometry.indexToWorldMatrix() *
                           glm::inverse(frame_.placed->volume.indexToWorldMatrix());
  volume_normals_ = glm::mat3(glm::transpose(moved));
}

void NumberedMesh::place(PlacedBatch& placed) {
  const bool wants_components = std::ranges::any_of(
      attributes(), [](const VertexAttribute& attribute) { return attribute.values == nullptr; });
  if (wants_components && placed.components.size() != placed.batch.positions.size())
    throw meshError(path_,
                    "the vertices have no numbers of components; put a ComponentFilter or a "
                    "ComponentNumbering before the file");
  numbering_.place(placed);
  if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
    throw meshError(path_,
                    "a mesh file holds at most 4,294,967,295 vertices; extract a part of the "
                    "surface or a coarser level");
  placed.first_triangle = triangles_;
  placed.first_cap = caps_;
  triangles_ += placed.batch.triangles.size() / 3;
  caps_ += placed.batch.cap_indices / 3;
}

void NumberedMesh::findVertices(PlacedBatch& placed, bool all) const {
  std::vector<std::uint32_t> vertices;
  if (all) {
    vertices.resize(placed.batch.positions.size());
    std::iota(vertices.begin(), vertices.end(), 0u);
  } else {
    forEachNew(placed, [&](std::size_t v) { vertices.push_back(static_cast<std::uint32_t>(v)); });
  }
  const auto find = [&](const WorldPlacement& placement) {
    placed.world.clear();
    for (const std::uint32_t v : vertices)
      placed.world.push_back(placement.worldPosition(placed.batch, v));
  };
  find(frame_.placed ? volume_placement_ : placement_);
  findValues(placed, vertices);
  if (frame_.placed) find(placement_);
}

void NumberedMesh::findValues(PlacedBatch& placed, std::span<const std::uint32_t> vertices) const {
  if (attributes().empty()) return;
  const std::size_t count = placed.world.size();
  placed.values.resize(attributes().size() * count);
  std::vector<glm::vec3> normals;
  for (const std::uint32_t v : vertices) {
    const glm::vec3& normal = placed.batch.normals[v];
    normals.push_back(frame_.placed ? glm::normalize(volume_normals_ * normal) : normal);
  }
  for (std::size_t a = 0; a < attributes().size(); ++a) {
    const std::span<double> values = std::span(placed.values).subspan(a * count, count);
    if (const VertexValues* const field = attributes()[a].values)
      field->evaluate(placed.world, normals, values);
    else
      std::ranges::transform(vertices, values.begin(),
                             [&](std::uint32_t v) { return placed.components[v]; });
  }
}

void NumberedMesh::putValue(BytePointer& to, const VertexAttribute& attribute, double value) const {
  const auto putWhole = [&]<typename Whole>(Whole) {
    if (std::isnan(value)) value = 0;
    const auto whole = static_cast<std::int64_t>(value);
    if (!std::in_range<Whole>(whole) || static_cast<double>(whole) != value)
      throw meshError(path_, "the value " + std::to_string(value) + " of '" + attribute.name +
                                 "' is no whole number of 32 bits; give another attribute");
    to.put(static_cast<Whole>(whole));
  };
  switch (attribute.type) {
    case AttributeType::kFloat32:
      return to.put(static_cast<float>(value));
    case AttributeType::kFloat64:
      return to.put(value);
    case AttributeType::kInt32:
      return putWhole(std::int32_t{});
    case AttributeType::kUint32:
      return putWhole(std::uint32_t{});
  }
}

glm::vec3 NumberedMesh::colorOf(const PlacedBatch& placed, std::size_t i) const {
  const VertexColors& colors = *options_.colors;
  const double value = valueOf(placed, colors.attribute, i);
  if (std::isnan(value)) return glm::vec3(0.5f);
  if (!colors.map) return componentColor(static_cast<std::size_t>(std::abs(value)));
  return valueColor(*colors.map, (value - colors.low) / (colors.high - colors.low));
}

}  // namespace isobrick
