// A further volume in the world of the one that a session shows: its surfaces, in the lattice of
// that one's scene.
#pragma once

#include "isobrick/viewer/session/session_status.h"
#include "isobrick/viewer/session/shown_volume.h"
#include "isobrick/viewer/session/surface_requests.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/stream/value_histogram.h"

namespace isobrick {

// Shares the thread and the time of its session. Surfaces keep their numbers in the view; those of
// other volumes are none of its business. It has no slices, caps and pieces.
class BesideVolume {
 public:
  // `number`: ViewSurface::volume of its surfaces; `scene`: the lattice that their chunks come in;
  // the rest is as SurfaceRequests takes it.
  BesideVolume(const OpenedVolume& opened, int number, const SceneLattice& scene,
               const OpenMasks& masks, ChunkStore& store, const ChunkBudget& budget, int threads);

  const ShownVolume& shown() const { return shown_; }
  const ViewVolume& volume() const { return shown_.volume(); }
  const ValueHistogram& histogram() const { return histogram_; }
  SurfaceRequests& requests() { return requests_; }
  const SurfaceRequests& requests() const { return requests_; }

  // The view of it, whose focus counts in voxels of `first`. `height`: of the picture, pixels.
  SurfaceWish wishOf(const ViewState& state, const ViewVolume& first, double height) const;
  // Brings the isovalues of its surfaces into their range.
  void bound(ViewState& state) const;
  void addTo(SessionStatus& status) const;

 private:
  const int number_;
  const ShownVolume shown_;
  const ValueHistogram histogram_;
  SurfaceRequests requests_;  // last: its threads use the pyramid
};

}  // namespace isobrick
