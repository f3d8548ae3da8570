// The volume that a session shows, as its pyramid has it: all of it, or a preview.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/state/view_state.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// A view counts in voxels of the volume, a pyramid in its own samples, which are fewer in a
// preview.
class ShownVolume {
 public:
  // `isovalues`: that are suggested; `masks`: of views; `is_step`: of several in time, which have
  // one isovalue whether or not it is in their ranges.
  ShownVolume(std::shared_ptr<const Pyramid> pyramid, const std::optional<PreviewOf>& preview_of,
              std::vector<double> isovalues, OpenMasks masks = {}, bool is_step = false);

  const ViewVolume& volume() const { return volume_; }
  const std::shared_ptr<const Pyramid>& pyramid() const { return pyramid_; }
  // Nothing if the volume itself is shown.
  const std::optional<PreviewOf>& previewOf() const { return preview_of_; }

  // Voxels to a sample.
  double step() const { return preview_of_ ? static_cast<double>(preview_of_->step) : 1.0; }
  // The level of the volume that the pyramid's level 0 is.
  int firstLevel() const;
  // How the samples lie in the world.
  SceneLattice lattice() const;
  // The world's box around a box of samples.
  WorldBox boxAround(const std::array<glm::dvec3, 2>& samples) const;

  // A preview is shown as fine as it is.
  double radiusAtRest(const ViewState& state) const;
  // The radius of a pass that is at most as fine as one with `radius`. If surfaces are whole, it is
  // the diagonal over a power of two: over 2^l for one of level l, which has about as many
  // triangles as one with that radius, or half as many again.
  double radiusOfPass(const SurfaceWish& wish, double radius) const;
  // As wishOf(), with the radius at rest of what is shown.
  SurfaceWish wishOf(const ViewState& state, double height) const;
  // The query of a surface, in samples; `radius` is one of these.
  Query queryOf(const SurfaceWish& wish, std::size_t surface, double radius) const;

 private:
  bool isOfOneLevel(const SurfaceWish& wish, double radius) const;
  int levelOf(double radius) const;
  Query wholeQueryOf(const SurfaceWish& wish, std::size_t surface, double radius) const;

  const std::shared_ptr<const Pyramid> pyramid_;
  const std::optional<PreviewOf> preview_of_;
  ViewVolume volume_;
  const OpenMasks masks_;
};

}  // namespace isobrick
