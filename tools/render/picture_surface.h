// An extracted surface in the form in which pictures are drawn, also from all around it.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/session/scene_of_view.h"
#include "isobrick/viewer/stream/surface_chunk.h"
#include "tools/query_options.h"
#include "tools/render/picture_surface.h"

namespace isobrick {

struct PictureSurface {
  std::vector<SurfaceChunk> chunks;  // in the order of the extraction
  SceneLattice lattice;
  std::uint64_t triangles = 0;
  double isovalue = 0.0;
  LengthUnit unit = LengthUnit::kUnknown;  // of the world
  ColoredPieces pieces;                    // if it is coloured by them
  // Inside of it everything is of the finest level.
  std::optional<SphereOutline> focus;
};

// `by_component`: vertices have the colours of their pieces, for which it is extracted twice.
PictureSurface extractPictureSurface(QueryOptions options, bool by_component);

// `count` pictures like `options`, to the right in equal steps from its azimuth on. The eye stays
// as far away as all of the surface needs from any side, so that it turns in its place.
std::vector<RenderOptions> turntable(const RenderOptions& options, const PictureSurface& surface,
                                     int count);

}  // namespace isobrick
