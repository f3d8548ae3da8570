// What is fast on a card, or undefined there alone, by the calls that are made: a driver in
// software shows neither.
#include <gtest/gtest.h>

#include <memory>

#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "tests/support/driver_calls.h"
#include "tests/support/gl_test.h"

namespace isobrick {
namespace {

class CardMemoryTest : public test::GlTest {
 protected:
  void setUp() override {
    renderer_ = std::make_unique<GlSceneRenderer>(GlSceneRenderer::Uploads::kStaged);
    frame_.width = 96;
    frame_.height = 64;
    frame_.camera.eye = {0.0, -10.0, 0.0};
    frame_.camera.half_width = frame_.camera.half_height = 0.2;
    frame_.bounds = {glm::dvec3(-4.0), glm::dvec3(4.0)};
    frame_.surfaces = {SurfaceLook{}, SurfaceLook{{0.0f, 0.0f, 1.0f}, 0.5}};
    for (const int surface : {0, 1}) frame_.chunks.push_back(renderer_->upload(square(surface)));
    renderer_->draw(frame_);
    renderer_->picture();
    renderer_->download(frame_.chunks[0]);
  }
  static SurfaceChunk square(int surface) {
    SurfaceChunk chunk;
    chunk.origin = {0.0, 1.0 - surface, 0.0};
    chunk.surface = surface;
    for (const glm::vec3& p :
         {glm::vec3(-1, 0, -1), glm::vec3(1, 0, -1), glm::vec3(1, 0, 1), glm::vec3(-1, 0, 1)})
      chunk.vertices.push_back({p, packNormal({0.0f, -1.0f, 0.0f})});
    chunk.triangles = {0, 1, 2, 0, 2, 3};
    boundChunk(chunk);
    return chunk;
  }

  std::unique_ptr<GlSceneRenderer> renderer_;
  SceneFrame frame_;
};

// A shader that may ask for the shadow has depths to ask; frames without one have another shader.
TEST_F(CardMemoryTest, SamplersThatCompareFindDepths) {
  for (const bool shadow : {false, true, false}) {
    frame_.shadow = shadow;
    frame_.ambient_occlusion = shadow;
    const test::SamplersOfDraws samplers;
    renderer_->draw(frame_);
    EXPECT_EQ(samplers.seen(), shadow ? 2 : 0);  // opaque, and seen through
    EXPECT_TRUE(samplers.undefined().empty()) << samplers.undefined()[0];
  }
}

// A driver may move what is read back to the processor's memory, as NVIDIA's says it does.
TEST_F(CardMemoryTest, TheListsOfLayersAreNotReadBack) {
  const test::ReadsBack reads;
  renderer_->draw(frame_);
  EXPECT_GE(reads.buffers(), 1);  // their length
  EXPECT_EQ(reads.buffersOfCard(), 0);
}

// Whole chunks, and those that come in pieces through the ring.
TEST_F(CardMemoryTest, WhatIsKeptIsWhatWasGiven) {
  const SurfaceChunk given = square(1);
  const ChunkId in_pieces = renderer_->reserve(given);
  const auto bytes = static_cast<std::size_t>(given.bytes());
  ASSERT_TRUE(renderer_->uploadPiece(in_pieces, given, 0, 50));
  ASSERT_TRUE(renderer_->uploadPiece(in_pieces, given, 50, bytes - 50));
  renderer_->endUploads();
  for (const ChunkId id : {frame_.chunks[1], in_pieces}) {
    const SurfaceChunk kept = renderer_->download(id);
    EXPECT_EQ(kept.triangles, given.triangles);
    for (std::size_t v = 0; v < given.vertices.size(); ++v)
      EXPECT_EQ(kept.vertices[v].position, given.vertices[v].position);
  }
}

// A card takes as long for one row of a picture as for many.
TEST_F(CardMemoryTest, APictureIsReadInFewPieces) {
  const test::ReadsBack reads;
  const Image picture = renderer_->picture();
  EXPECT_EQ(reads.pixels(), 1);
  frame_.width = 2000;
  frame_.height = 1000;
  renderer_->draw(frame_);
  const int before = reads.pixels();
  renderer_->picture();
  EXPECT_LE(reads.pixels() - before, 32);
}

}  // namespace
}  // namespace isobrick
