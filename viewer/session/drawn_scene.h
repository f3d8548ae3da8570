// The scene as a renderer drew it last: whether it is still the same, depths under a pixel, its
// mesh.
#pragma once

#include <cstdint>
#include <deque>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/viewer/render/scene_renderer.h"

namespace isobrick {

// A frame that is the one drawn last is not drawn again: chunks and slices with the same numbers
// have the same contents, and the renderer still has its picture. Used by the renderer's thread;
// nobody else draws with it meanwhile, or forget() comes first.
class DrawnScene {
 public:
  // True if it was drawn; `anew`: in any case. Throws as SceneRenderer::draw().
  bool draw(SceneRenderer& renderer, const SceneFrame& frame, bool anew);
  // The renderer's picture is none of these any longer.
  void forget();

  // Asks for the surface under a pixel (from the top left) of the frame drawn last; returns the
  // question's number, or 0 if there is no frame. Never waits: the answer comes by take(), by the
  // camera that drew the frame, whatever was drawn since.
  std::uint64_t ask(DepthReadback& readback, const glm::dvec2& pixel);
  struct Answer {
    std::uint64_t question = 0;
    std::optional<glm::dvec3> point;  // none: there is background
  };
  // The answers that have come; one a call.
  std::optional<Answer> take(DepthReadback& readback);
  // The renderer of these questions is gone: they are not answered.
  void forgetQuestions() { asked_.clear(); }

 private:
  struct Asked {
    std::uint64_t question = 0;
    PlacedCamera camera;
    glm::dvec2 place{0.0};  // normalised device coordinates
  };
  std::optional<SceneFrame> frame_;  // none: none was drawn
  std::deque<Asked> asked_;
};

// Passes the renderer's copies of `chunks` to the sink, chunk by chunk. Positions are the same to
// the bit on both sides of a brick, so vertices in the same place of one surface become one vertex:
// a mesh that has a gap on the screen has one in the sink. `frame`: of the pyramid that the chunks
// are of. Normals have the 16 bits that they are drawn with. Passes on exceptions of the sink.
void takeShownMesh(const SceneReadback& renderer, const std::vector<ChunkId>& chunks,
                   const MeshFrame& frame, TriangleSink& sink);

}  // namespace isobrick
