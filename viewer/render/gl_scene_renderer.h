// Frames drawn with OpenGL 4.5 core, into memory of its own: the same for windows and files.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_slices.h"
#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/layer_pass.h"
#include "isobrick/viewer/render/line_pass.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/render/shade_pass.h"
#include "isobrick/viewer/render/surface_pass.h"

namespace isobrick {

// Made, used and destroyed on the thread on which its context is current. Draws with 4 samples a
// pixel and half floats of linear light: they hold it without visible steps, and go into an EXR as
// they are. Chunks lie in a few large buffers, filled once; their edges are drawn from the same.
class GlSceneRenderer : public SceneRenderer {
 public:
  // How pieces of chunks come to the card: through a ring that stays mapped, or by a copy of the
  // driver's; the copy alone is faster if the card is the processor itself.
  enum class Uploads { kAsSuits, kStaged };
  // With the limits of the card, or with others, which narrow what it uses of the card. Throws
  // Error if the driver refuses the shaders, or if a limit does not suffice.
  explicit GlSceneRenderer(Uploads uploads = Uploads::kAsSuits,
                           const std::optional<GlLimits>& limits = std::nullopt);

  ChunkId reserve(const SurfaceChunk& chunk) override { return chunks_.reserve(chunk); }
  bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                   std::size_t bytes) override {
    return chunks_.uploadPiece(id, chunk, begin, bytes);
  }
  void endUploads() override { chunks_.endUploads(); }
  ChunkId upload(const SurfaceChunk& chunk) override { return chunks_.upload(chunk); }
  void release(ChunkId chunk) noexcept override { chunks_.release(chunk); }
  SurfaceChunk download(ChunkId chunk) const override { return chunks_.download(chunk); }
  SliceId reserveSlice(int width, int height) override { return slices_.reserve(width, height); }
  void uploadRows(SliceId slice, const SliceImage& image, int first, int count) override {
    slices_.uploadRows(slice, image, first, count);
  }
  int greatestSlice() const override { return device_.limits().sliceSize(); }
  void releaseSlice(SliceId slice) override { slices_.release(slice); }
  std::uint64_t bytesKept() const override { return chunks_.bytesKept() + slices_.bytesKept(); }
  void draw(const SceneFrame& frame) override;
  std::uint64_t askDistance(const glm::dvec2& pixel) override {
    return depth_reads_.ask(frame_.targets, pixel, depth_);
  }
  std::optional<DistanceAnswer> takeDistance() override { return depth_reads_.take(); }
  Image picture() override { return frame_.targets.picture(frame_.targets.all(), transparent_); }
  Image drawTile(const SceneFrame& frame, const PixelBox& tile, bool depth) override;
  void endTiles() override { tile_.reset(); }
  int neighbourhoodOf(const SceneFrame& frame) const override;

  // The frame drawn last, as sRGB, into a framebuffer of the context (0: its window): a part of the
  // frame's size, with its lower left corner at this pixel from the left and from below.
  void present(GLuint framebuffer, int left, int bottom);

  // In its place the colour of an empty background, for a picture that cannot be drawn.
  void presentNothing(GLuint framebuffer, int width, int height);

  bool isLost() override { return device_.isLost(); }
  bool isSoftware() const override { return device_.isSoftware(); }
  int greatestSize() const override { return frame_.targets.greatestSize(); }
  const std::string& deviceName() const override { return device_.name(); }

  const GlDevice& device() const { return device_; }
  const LayerPass& layers() const { return layers_; }

  const DrawCounts& counts() const { return surfaces_.counts(); }
  const GlArenas& arenas() const { return chunks_.arenas(); }

 private:
  // The memory of a picture, or of a tile, and what is drawn in memory of its size.
  struct Buffers {
    explicit Buffers(GlDevice& device)
        : targets(device), shadow(device), occlusion(device.isSoftware()) {}
    GlTargets targets;
    ShadowPass shadow;
    OcclusionPass occlusion;
  };
  bool drawsEdges() const;
  void paint(const SceneView& view, Buffers& buffers);
  void drawBackground(const SceneView& view);
  void drawLayers(const SceneView& view, const GlTargets& targets);

  GlDevice device_;
  Buffers frame_;
  std::optional<Buffers> tile_;  // while tiles are drawn
  GlChunks chunks_;
  GlSlices slices_;
  SurfacePass surfaces_;
  LayerPass layers_;
  LinePass lines_;
  GlDepthReads depth_reads_;
  GlProgram background_program_, screen_program_;
  GlVertexArray empty_array_;
  DepthProjection depth_;     // of the frame drawn last
  bool transparent_ = false;  // likewise
};

}  // namespace isobrick
