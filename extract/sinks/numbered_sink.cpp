#include "isobrick/extract/sinks/numbered_sink.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "isobrick/extract/pyramid_values.h"
#include "isobrick/storage/error.h"

namespace isobrick {

void NumberedSink::begin(const MeshFrame& frame) {
  frame_ = frame;
  frame_.geometry.origin += options_.shift;
  double_precision_ = frame_.coordinateMagnitudeInVoxels() >= 2048;
  placement_ = WorldPlacement(frame_.geometry);
}

void NumberedSink::place(PlacedBatch& placed) {
  const bool wants_components = std::ranges::any_of(
      attributes(), [](const VertexAttribute& attribute) { return attribute.values == nullptr; });
  if (wants_components && placed.components.size() != placed.batch.positions.size())
    throw Error("'" + file_.path() +
                    "': the vertices have no numbers of components; put a ComponentFilter or a "
                    "ComponentNumbering before the file",
                {.path = file_.path()});
  numbering_.place(placed);
  if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
    throw Error("'" + file_.path() +
                    "': a mesh file holds at most 4,294,967,295 vertices; extract a part of the "
                    "surface or a coarser level",
                {.path = file_.path()});
  placed.first_triangle = triangles_;
  triangles_ += placed.batch.triangles.size() / 3;
}

void NumberedSink::findVertices(PlacedBatch& placed) const {
  placed.world.clear();
  placed.world.reserve(newVertices(placed));
  std::vector<std::uint32_t> vertices;
  forEachNew(placed, [&](std::size_t v) {
    const auto vertex = static_cast<std::uint32_t>(v);
    placed.world.push_back(placement_.worldPosition(placed.batch, vertex));
    if (!attributes().empty()) vertices.push_back(vertex);
  });
  findValues(placed, vertices);
}

void NumberedSink::findAllVertices(PlacedBatch& placed) const {
  std::vector<std::uint32_t> vertices(placed.batch.positions.size());
  std::iota(vertices.begin(), vertices.end(), 0u);
  placed.world.clear();
  for (const std::uint32_t v : vertices)
    placed.world.push_back(placement_.worldPosition(placed.batch, v));
  findValues(placed, vertices);
}

void NumberedSink::findValues(PlacedBatch& placed, std::span<const std::uint32_t> vertices) const {
  if (attributes().empty()) return;
  const std::size_t count = placed.world.size();
  placed.values.resize(attributes().size() * count);
  std::vector<glm::dvec3> unshifted = placed.world;
  std::vector<glm::vec3> normals;
  for (glm::dvec3& place : unshifted) place -= options_.shift;
  for (const std::uint32_t v : vertices) normals.push_back(placed.batch.normals[v]);
  for (std::size_t a = 0; a < attributes().size(); ++a) {
    const std::span<double> values = std::span(placed.values).subspan(a * count, count);
    if (const VertexValues* const field = attributes()[a].values)
      field->evaluate(unshifted, normals, values);
    else
      std::ranges::transform(vertices, values.begin(),
                             [&](std::uint32_t v) { return placed.components[v]; });
  }
}

void NumberedSink::putValue(BytePointer& to, const VertexAttribute& attribute, double value) const {
  const auto putWhole = [&]<typename Whole>(Whole) {
    if (std::isnan(value)) value = 0;
    const auto whole = static_cast<std::int64_t>(value);
    if (!std::in_range<Whole>(whole) || static_cast<double>(whole) != value)
      throw Error("'" + file_.path() + "': the value " + std::to_string(value) + " of '" +
                      attribute.name + "' is no whole number of 32 bits; give another attribute",
                  {.path = file_.path()});
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

glm::vec3 NumberedSink::colorOf(const PlacedBatch& placed, std::size_t i) const {
  const VertexColors& colors = *options_.colors;
  const double value = valueOf(placed, colors.attribute, i);
  if (std::isnan(value)) return glm::vec3(0.5f);
  if (!colors.map) return componentColor(static_cast<std::size_t>(std::abs(value)));
  return valueColor(*colors.map, (value - colors.low) / (colors.high - colors.low));
}

}  // namespace isobrick
