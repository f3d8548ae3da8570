// What is drawn by a card that can do less than usual.
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "tests/support/gl_test.h"

namespace isobrick {
namespace {

class GlLimitsTest : public test::GlTest {
 protected:
  void setUp() override { limits_ = GlLimits::read(); }

  std::unique_ptr<GlSceneRenderer> rendererWithin(const GlLimits& limits) {
    return std::make_unique<GlSceneRenderer>(GlSceneRenderer::Uploads::kAsSuits, limits);
  }
  // A square of two triangles that fills three quarters of the picture's width.
  static SceneFrame frameOf(GlSceneRenderer& renderer) {
    SurfaceChunk chunk;
    for (const glm::vec3& p : {glm::vec3(-1.5, 0, -1.5), glm::vec3(1.5, 0, -1.5),
                               glm::vec3(1.5, 0, 1.5), glm::vec3(-1.5, 0, 1.5)})
      chunk.vertices.push_back({p, packNormal({0.0f, -1.0f, 0.0f})});
    chunk.triangles = {0, 1, 2, 0, 2, 3};
    boundChunk(chunk);
    SceneFrame frame;
    frame.width = frame.height = 64;
    frame.camera.eye = {0.0, -10.0, 0.0};
    frame.camera.half_width = frame.camera.half_height = 0.2;
    frame.bounds = {glm::dvec3(-4.0), glm::dvec3(4.0)};
    frame.chunks = {renderer.upload(chunk)};
    return frame;
  }

  GlLimits limits_;
};

TEST_F(GlLimitsTest, AreReadFromTheCard) {
  EXPECT_NO_THROW(limits_.require("this card"));
  EXPECT_GE(limits_.texture_size, 16384);  // as OpenGL 4.5 promises
  EXPECT_GE(limits_.clip_distances, 8);
  EXPECT_GE(limits_.storage_block_bytes, std::int64_t{1} << 27);
  for (const GlLimits::Row& row : limits_.rows()) EXPECT_GT(row.value, -1) << row.name;
}

TEST_F(GlLimitsTest, PicturesAndSamplesAreFewer) {
  limits_.texture_size = 96;
  limits_.samples = 2;
  const auto renderer = rendererWithin(limits_);
  EXPECT_EQ(renderer->greatestSize(), 96);
  EXPECT_EQ(renderer->greatestSlice(), 96);
  SceneFrame frame = frameOf(*renderer);
  frame.shadow = true;  // its picture of depths has to be smaller than usual
  EXPECT_NO_THROW(renderer->draw(frame));
  const Image picture = renderer->picture();
  EXPECT_GT(picture.rgb[picture.offsetOf(32, 32)], 0.3f);
  EXPECT_EQ(limits_.consequences().size(), 2u);
  limits_.samples = 0;  // what a driver says that has no multisampling
  EXPECT_EQ(limits_.pictureSamples(), 1);
  const auto plain = rendererWithin(limits_);
  EXPECT_NO_THROW(plain->draw(frameOf(*plain)));
}

TEST_F(GlLimitsTest, WithoutBuffersInVertexShadersThereAreNoEdges) {
  const auto middleOf = [&](GlSceneRenderer& renderer, bool wireframe) {
    SceneFrame frame = frameOf(renderer);
    frame.wireframe = wireframe;
    renderer.draw(frame);
    const Image picture = renderer.picture();
    return picture.rgb[picture.offsetOf(32, 32)];
  };
  const auto usual = rendererWithin(limits_);
  const float plain = middleOf(*usual, false);
  EXPECT_LT(middleOf(*usual, true), 0.8f * plain);  // the diagonal
  GlLimits without = limits_;
  without.vertex_storage_blocks = 0;
  EXPECT_EQ(middleOf(*rendererWithin(without), true), plain);
  // Buffers of chunks are small, so that their edges are drawn; one chunk may be larger.
  GlLimits small = limits_;
  small.storage_block_bytes = 1 << 16;
  const auto bounded = rendererWithin(small);
  EXPECT_LT(middleOf(*bounded, true), 0.8f * plain);
  EXPECT_LE(bounded->arenas().greatestBytes(), std::size_t{1} << 16);
  SurfaceChunk large;
  large.vertices.resize(5000);
  large.triangles = {0, 1, 2};
  boundChunk(large);
  bounded->upload(large);
  EXPECT_GT(bounded->arenas().greatestBytes(), std::size_t{1} << 16);
  EXPECT_EQ(middleOf(*bounded, true), plain);
}

TEST_F(GlLimitsTest, TooLittleIsOneClearError) {
  GlLimits few_planes = limits_, few_pixels = limits_;
  few_planes.clip_distances = 4;
  few_pixels.renderbuffer_size = 32;
  for (const auto& [limits, name] : {std::pair(few_planes, "GL_MAX_CLIP_DISTANCES"),
                                     std::pair(few_pixels, "GL_MAX_RENDERBUFFER_SIZE")}) {
    try {
      rendererWithin(limits);
      FAIL() << name;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace isobrick
