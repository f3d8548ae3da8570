// An extracted surface in the form in which pictures are drawn.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "isobrick/viewer/offscreen_renderer.h"
#include "tools/query_options.h"

namespace isobrick {

// How the surfaces look that are drawn; none given: colours of their own, opaque.
struct PictureLooks {
  std::vector<glm::vec3> colors;  // sRGB, of each
  std::vector<double> opacities;  // 0 .. 1, of each
  std::optional<std::uint64_t> keep_largest;
};

// The surfaces of each of `volumes` (queryOfFile()), which share the memory, in one world; the
// lattice is that of the first one. `view` gets all of them, with their isovalues and looks, and
// the first one's sphere of interest. If it colours by components, vertices have the colours of
// their pieces; for that, and for the largest pieces, a surface is extracted twice.
DrawableSurface extractPictureSurface(std::vector<QueryOptions> volumes, const PictureLooks& looks,
                                      ViewState& view);

// From the direction of `camera`, as near as all of the surface is in the picture; if the camera
// `turns`, as far away as all of it needs from any side, so that it turns in its place.
ViewCamera cameraOf(const DrawableSurface& surface, const ViewCamera& camera, double aspect,
                    bool turns);

}  // namespace isobrick
