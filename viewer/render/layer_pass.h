// What is seen through: surfaces and slices whose fragments are composited by depth, in each sample
// of a pixel.
#pragma once

#include <cstdint>
#include <functional>

#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// Every fragment that something opaque does not hide goes into a list of its pixel, with colour,
// plane of depth and coverage (the A-buffer of Carpenter 1984; lists as Yang et al. 2010). Then
// each sample of a pixel takes the fragments that cover it from front to back, whatever the order
// in which they were drawn, until less than 1/1024 of the light comes through. So triangles are set
// up once, where peeling would draw all of them again for each layer.
//
// A frame in which nothing is seen through takes no time and no memory of this. Lists have at most
// kMostBytes; a picture with more is drawn in bands of rows.
class LayerPass {
 public:
  static constexpr std::int64_t kMostBytes = std::int64_t{64} << 20;

  explicit LayerPass(GlDevice& device);

  // Draws over these pixels of what the sampled frame of the targets shows. `drawFragments` draws
  // all fragments of a band of them by programs that use() was called for; it may be called several
  // times for the same rows. Writes depth too: that of the nearest surface in a sample. Throws
  // NoGraphicsMemory, and keeps nothing then, and the other errors of the device.
  void draw(const GlTargets& targets, const BufferBox& pixels,
            const std::function<void(const BufferBox&)>& drawFragments);
  // For a program of scene_shaders.h that keeps layers: where, within draw().
  void use(const GlProgram& program) const;
  // Within draw(): the pixels come in more than one band.
  bool isInBands() const { return in_bands_; }
  void release();

  // Of the last draw(): how many bands it took. 0: it had nothing to do.
  int bands() const { return bands_; }
  // That its buffers and textures take on the card.
  std::int64_t bytes() const;

 private:
  void keepOpaqueDepth(const GlTargets& targets);
  void reserve(std::int64_t layers, std::int64_t heads);
  void checkMemory();
  std::uint32_t fillLists(const GlTargets& targets,
                          const std::function<void(const BufferBox&)>& drawFragments);
  void composite(const GlTargets& targets);

  GlDevice& device_;
  const std::int64_t most_bytes_, most_layers_;
  GlProgram program_;
  GlVertexArray empty_array_;
  GlBuffer heads_, layers_;
  GlBuffer count_;                                 // of the layers, to be read back
  std::int64_t kept_heads_ = 0, kept_layers_ = 0;  // that the buffers have room for
  GlTexture depths_;
  GlFramebuffer depth_frame_;
  int width_ = 0, height_ = 0, samples_ = 0;  // of depths_
  GlFence composited_;                        // the last band
  BufferBox band_;                            // of the lists
  bool in_bands_ = false;
  int bands_ = 0;
};

}  // namespace isobrick
