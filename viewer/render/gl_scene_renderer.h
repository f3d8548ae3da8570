// Frames drawn with OpenGL 4.5 core, into memory of its own: the same for windows and files.
#pragma once

#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_staging.h"
#include "isobrick/viewer/render/scene_renderer.h"

namespace isobrick {

// Made, used and destroyed on the thread on which its context is current. Draws with 4 samples a
// pixel and half floats of linear light: they hold it without visible steps, and go into an EXR as
// they are. Chunks lie in one buffer each, filled once; their edges are drawn from the same buffer.
class GlSceneRenderer : public SceneRenderer {
 public:
  // How pieces of chunks come to the card: through a ring that stays mapped, or by a copy of the
  // driver's; the copy alone is faster if the card is the processor itself.
  enum class Uploads { kAsSuits, kStaged };
  // Throws Error if the driver refuses the shaders.
  explicit GlSceneRenderer(Uploads uploads = Uploads::kAsSuits);

  ChunkId reserve(const SurfaceChunk& chunk) override;
  bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                   std::size_t bytes) override;
  void endUploads() override;
  ChunkId upload(const SurfaceChunk& chunk) override;
  void release(ChunkId chunk) override;
  SurfaceChunk download(ChunkId chunk) const override;
  SliceId reserveSlice(int width, int height) override;
  void uploadRows(SliceId slice, const SliceImage& image, int first, int count) override;
  void releaseSlice(SliceId slice) override;
  std::uint64_t bytesKept() const override { return bytes_kept_; }
  void draw(const SceneFrame& frame) override;
  std::optional<double> distanceAt(const glm::dvec2& pixel) override;
  Image picture() override;
  std::vector<float> distances() override;

  // The frame drawn last, as sRGB, into a framebuffer of the context (0: its window): a part of the
  // frame's size, with its lower left corner at this pixel from the left and from below.
  void present(GLuint framebuffer, int left, int bottom);

  // In its place the colour of an empty background, for a picture that cannot be drawn.
  void presentNothing(GLuint framebuffer, int width, int height);

  bool isLost() override;
  bool isSoftware() const override { return is_software_; }
  int greatestSize() const override { return greatest_size_; }
  const std::string& deviceName() const override { return device_name_; }

 private:
  struct Chunk {
    GlBuffer buffer;  // vertices, then indices
    std::uint64_t bytes = 0;
    GLsizei indices = 0, transition_indices = 0;
    std::uint32_t index_offset = 0;  // bytes
    glm::dvec3 origin{0.0};
    int level = 0, surface = 0;
  };
  struct Slice {
    GlTexture texture;
    std::uint64_t bytes = 0;
  };
  struct View;  // shared by all draw calls of a frame

  void forgetErrors();
  void checkErrors(const std::string& if_no_memory);
  template <typename F>
  static bool forParts(const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes, F&& f);
  void fill(ChunkId id, const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes);
  void resize(int width, int height);
  void setView(const GlProgram& program, const View& view, int uncut_plane = -1) const;
  void drawBackground(const SceneFrame& frame);
  const GlProgram& useSurfaceProgram(const View& view) const;
  void drawOpaqueSurfaces(const View& view);
  void drawTranslucentSurfaces(const View& view);
  void drawChunks(const View& view, const GlProgram& program, int surface, bool opaque);
  void drawIndices(const Chunk& chunk, GLsizei begin, GLsizei end, bool wireframe,
                   GLint first_place);
  void boundFlight(GLsizei indices);
  void drawOcclusion(const View& view);
  void drawSlices(const View& view, bool blends);
  void drawSegments(const View& view);
  void drawSphere(const View& view);
  void drawRibbon(const std::vector<glm::vec4>& ribbon, const glm::vec3& color, float half_width,
                  float casing);

  std::string device_name_;
  bool is_software_ = false;
  bool is_lost_ = false;
  int greatest_size_ = 0;
  int samples_ = 1;
  int width_ = 0, height_ = 0;  // of the framebuffers
  DepthProjection depth_;       // of the frame drawn last
  bool transparent_ = false;    // likewise

  GlProgram surface_program_, wire_program_, background_program_, line_program_, slice_program_,
      sphere_program_, screen_program_, occlusion_program_, shade_program_;
  GlVertexArray surface_array_, line_array_, empty_array_;
  GlBuffer line_buffer_;
  GlRenderbuffer sampled_color_, sampled_depth_;
  GlTexture resolved_color_, resolved_depth_;
  GlFramebuffer sampled_frame_, resolved_frame_;
  GlTexture openness_;  // of ambient occlusion, if a picture of this size had it
  GlFramebuffer openness_frame_;

  std::optional<GlStaging> staging_;  // none: pieces go without it
  std::unordered_map<ChunkId, Chunk> chunks_;
  std::unordered_map<SliceId, Slice> slices_;
  ChunkId last_chunk_ = 0;
  SliceId last_slice_ = 0;
  std::uint64_t bytes_kept_ = 0;
  GlFence last_flight_;
  GLsizei indices_in_flight_ = 0;  // drawn since then
};

}  // namespace isobrick
