#include "isobrick/extract/sinks/mesh_placement.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

struct MeshUnit {
  const char* symbol;
  const char* name;
  double millimetres;
};
constexpr MeshUnit kMeshUnits[] = {{"nm", "nanometres", 1e-6}, {"um", "micrometres", 1e-3},
                                   {"mm", "millimetres", 1},   {"cm", "centimetres", 10},
                                   {"m", "metres", 1000},      {"inch", "inches", 25.4},
                                   {"ft", "feet", 304.8}};

const MeshUnit& meshUnit(const std::string& symbol) {
  const auto found = std::ranges::find(kMeshUnits, symbol, &MeshUnit::symbol);
  if (found != std::end(kMeshUnits)) return *found;
  std::string all;
  for (const MeshUnit& unit : kMeshUnits)
    all += (all.empty() ? "" : ", ") + std::string(unit.symbol);
  throw Error("'" + symbol + "' is no unit of a mesh; the units are " + all);
}

// A stage before a file.
class PlacedSink : public MeshFileSink {
 public:
  PlacedSink(std::unique_ptr<MeshFileSink> sink, const MeshPlacement& placement)
      : placement_(placement), sink_(std::move(sink)) {}

  void begin(const MeshFrame& frame) override {
    MeshFrame placed = frame;
    placed.geometry = placement_.placed(frame.geometry);
    placed.placed =
        MeshFrame::Placed{nameOfSpace(), nameOfUnit(frame), placement_.shift, frame.geometry};
    const glm::dmat3 turn =
        placed.geometry.indexToWorldMatrix() * glm::inverse(frame.geometry.indexToWorldMatrix());
    const double size = std::cbrt(std::abs(glm::determinant(turn)));
    normals_ = glm::mat3(glm::transpose(glm::inverse(turn / size)));
    turns_normals_ = placement_.space != MeshSpace::kLps;
    is_mirrored_ = glm::determinant(turn) < 0;
    sink_->begin(placed);
  }
  void prepare(PlacedBatch& placed) override {
    MeshBatch& batch = placed.batch;
    if (turns_normals_)
      for (glm::vec3& normal : batch.normals) normal = glm::normalize(normals_ * normal);
    for (std::size_t i = 0; is_mirrored_ && i < batch.triangles.size(); i += 3)
      std::swap(batch.triangles[i + 1], batch.triangles[i + 2]);
    sink_->prepare(placed);
  }
  void place(PlacedBatch& placed) override { sink_->place(placed); }
  void write(PlacedBatch& placed) override { sink_->write(placed); }
  void finish() override { sink_->finish(); }
  void beginObject(const std::string& name) override { sink_->beginObject(name); }
  std::uint64_t vertices() const override { return sink_->vertices(); }
  std::string loss() const override { return sink_->loss(); }
  std::string assumption() const override { return sink_->assumption(); }

 private:
  std::string nameOfSpace() const {
    if (placement_.space == MeshSpace::kRas) return "RAS";
    return placement_.space == MeshSpace::kIndex ? "index" : "LPS";
  }
  std::string nameOfUnit(const MeshFrame& frame) const {
    if (placement_.space == MeshSpace::kIndex) return "voxels";
    return placement_.unit.empty() ? std::string(lengthUnitName(frame.geometry.unit))
                                   : meshUnit(placement_.unit).name;
  }

  const MeshPlacement placement_;
  const std::unique_ptr<MeshFileSink> sink_;
  glm::mat3 normals_{1.0f};
  bool turns_normals_ = false, is_mirrored_ = false;
};

}  // namespace

GridGeometry MeshPlacement::placed(const GridGeometry& volume) const {
  GridGeometry geometry = volume;
  if (space == MeshSpace::kIndex) {
    geometry = {};
    if (!unit.empty()) throw Error("voxel indices have no unit; leave the unit out, or the space");
  }
  if (space == MeshSpace::kRas)
    for (int axis = 0; axis < 2; ++axis) {
      geometry.origin[axis] = -geometry.origin[axis];
      for (int column = 0; column < 3; ++column)
        geometry.direction[column][axis] = -geometry.direction[column][axis];
    }
  if (!unit.empty()) {
    const double millimetres = meshUnit(unit).millimetres;
    if (volume.unit == LengthUnit::kUnknown)
      throw Error("the unit of the volume is unknown, so a mesh in " + unit +
                  " cannot be made of it; leave the unit out");
    geometry.spacing /= millimetres;
    geometry.origin /= millimetres;
  }
  geometry.origin += shift;
  return geometry;
}

std::unique_ptr<MeshFileSink> placedSink(std::unique_ptr<MeshFileSink> sink,
                                         const MeshPlacement& placement) {
  return std::make_unique<PlacedSink>(std::move(sink), placement);
}

std::string spaceText(const MeshFrame& frame) { return frame.placed ? frame.placed->space : "LPS"; }

std::string unitText(const MeshFrame& frame) {
  return frame.placed ? frame.placed->unit : std::string(lengthUnitName(frame.geometry.unit));
}

glm::dvec3 shiftOf(const MeshFrame& frame) {
  return frame.placed ? frame.placed->shift : glm::dvec3(0.0);
}

}  // namespace isobrick
