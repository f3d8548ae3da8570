// The slices that a card keeps, and drawing them.
#pragma once

#include <cstdint>
#include <unordered_map>

#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/layer_pass.h"
#include "isobrick/viewer/render/scene_view.h"
#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {

// SceneRenderer's functions have its meaning here.
class GlSlices {
 public:
  explicit GlSlices(GlDevice& device);

  SliceId reserve(int width, int height);
  void uploadRows(SliceId slice, const SliceImage& image, int first, int count);
  void release(SliceId slice);
  std::uint64_t bytesKept() const { return bytes_kept_; }

  // Those of the frame that are opaque. They only hide the normals of surfaces.
  void drawOpaque(const SceneView& view) const;
  // Where those that are seen through may be in the picture; nowhere: there are none.
  static BufferBox layerPixels(const SceneView& view);
  // The fragments of these, for LayerPass.
  void drawLayers(const SceneView& view, const LayerPass& layers);

 private:
  struct Slice {
    GlTexture texture;
    std::uint64_t bytes = 0;
  };
  void draw(const GlProgram& program, const SceneView& view, const SceneSlice& slice) const;

  GlDevice& device_;
  GlProgram program_, layers_program_;  // the latter made when it is first needed
  GlVertexArray empty_array_;
  std::unordered_map<SliceId, Slice> slices_;
  SliceId last_ = 0;
  std::uint64_t bytes_kept_ = 0;
};

}  // namespace isobrick
