// Frames drawn by OpenGL without a window: what is cut, capped, seen through and hit.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <memory>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "tests/support/asked_distance.h"
#include "tests/support/driver_complaints.h"
#include "tests/support/driver_faults.h"
#include "tests/support/gl_test.h"

namespace isobrick {
namespace {

// A square of two triangles across y, `half` wide to each side, seen from -y.
SurfaceChunk squareAt(double y, double half, int surface, int level = 0) {
  SurfaceChunk chunk;
  chunk.origin = {0.0, y, 0.0};
  chunk.surface = surface;
  chunk.level = level;
  const auto h = static_cast<float>(half);
  for (const glm::vec3& p :
       {glm::vec3(-h, 0, -h), glm::vec3(h, 0, -h), glm::vec3(h, 0, h), glm::vec3(-h, 0, h)})
    chunk.vertices.push_back({p, packNormal({0.0f, -1.0f, 0.0f})});
  chunk.triangles = {0, 1, 2, 0, 2, 3};
  boundChunk(chunk);
  return chunk;
}

class SceneRendererTest : public test::GlTest {
 protected:
  void setUp() override {
    renderer_ = std::make_unique<GlSceneRenderer>();
    frame_.width = frame_.height = 64;
    frame_.camera.eye = {0.0, -10.0, 0.0};
    frame_.camera.half_width = frame_.camera.half_height = 0.2;  // 2 at the origin
    frame_.bounds = {glm::dvec3(-4.0), glm::dvec3(4.0)};
    frame_.surfaces = {SurfaceLook{{1.0f, 0.0f, 0.0f}, 1.0}, SurfaceLook{{0.0f, 0.0f, 1.0f}, 1.0}};
    frame_.background_top = frame_.background_bottom = glm::vec3(0.0f);
  }

  // What is seen at pixel x, y of the frame.
  glm::vec3 seen(int x, int y) {
    renderer_->draw(frame_);
    const Image image = renderer_->picture();
    const std::size_t at = image.offsetOf(x, y);
    return {image.rgb[at], image.rgb[at + 1], image.rgb[at + 2]};
  }
  std::optional<double> distanceAt(const glm::dvec2& pixel) {
    return test::distanceAt(*renderer_, pixel);
  }
  static bool isRed(const glm::vec3& c) { return c.r > 0.2f && c.b < 0.5f * c.r; }
  static bool isBlue(const glm::vec3& c) { return c.b > 0.2f && c.r < 0.5f * c.b; }
  static bool isBlack(const glm::vec3& c) { return c.r + c.g + c.b < 1e-3f; }

  std::unique_ptr<GlSceneRenderer> renderer_;
  SceneFrame frame_;
};

TEST_F(SceneRendererTest, WhatIsNearerHidesWhatIsBehindAndIsHit) {
  const ChunkId far = renderer_->upload(squareAt(3.0, 1.5, 0));
  const ChunkId near = renderer_->upload(squareAt(-2.0, 0.5, 1));
  for (const bool orthographic : {false, true}) {
    frame_.camera.orthographic = orthographic;
    frame_.camera.half_width = frame_.camera.half_height = orthographic ? 2.0 : 0.2;
    frame_.chunks = {near, far};
    EXPECT_TRUE(isBlue(seen(32, 32)));
    EXPECT_TRUE(isRed(seen(32, 16)));
    EXPECT_TRUE(isBlack(seen(2, 2)));
    EXPECT_NEAR(distanceAt({32.0, 32.0}).value(), 8.0, 1e-4);
    EXPECT_NEAR(distanceAt({32.0, 16.0}).value(), 13.0, 1e-4);
    EXPECT_FALSE(distanceAt({2.0, 2.0}));
    EXPECT_FALSE(distanceAt({-1.0, 2.0}));
    EXPECT_FALSE(distanceAt({32.0, 64.0}));
    frame_.chunks = {far};
    EXPECT_TRUE(isRed(seen(32, 32)));
  }
  EXPECT_EQ(renderer_->bytesKept(), 2 * (4 * 20 + 6 * 4u));
  renderer_->release(near);
  renderer_->release(far);
  EXPECT_EQ(renderer_->bytesKept(), 0u);
}

// Many chunks take a draw call for each surface, and those outside of the picture none.
TEST_F(SceneRendererTest, ChunksShareDrawCallsAndThoseOutsideAreLeftOut) {
  for (int i = 0; i < 40; ++i)
    frame_.chunks.push_back(renderer_->upload(squareAt(0.1 * i, 0.5, i % 2)));
  EXPECT_TRUE(isRed(seen(32, 32)));
  EXPECT_EQ(renderer_->counts().calls, 2u);
  EXPECT_EQ(renderer_->counts().chunks, 40u);
  SurfaceChunk aside = squareAt(0.0, 0.5, 0), behind = squareAt(-30.0, 0.5, 0);
  aside.origin.x += 9.0;
  frame_.chunks.push_back(renderer_->upload(aside));
  frame_.chunks.push_back(renderer_->upload(behind));
  renderer_->draw(frame_);
  EXPECT_EQ(renderer_->counts().calls, 2u);
  EXPECT_EQ(renderer_->counts().chunks, 40u);
  EXPECT_EQ(renderer_->counts().culled, 2u);
  // A clip plane leaves out what it cuts away as a whole.
  frame_.clip_planes = {{{0.0, 1.0, 0.0}, 2.05}};
  EXPECT_TRUE(isBlue(seen(32, 32)));
  EXPECT_EQ(renderer_->counts().chunks, 19u);
}

TEST_F(SceneRendererTest, WhatIsKeptOfAChunkIsWhatWasGiven) {
  const SurfaceChunk given = squareAt(3.0, 0.5, 1, 2);
  const SurfaceChunk kept = renderer_->download(renderer_->upload(given));
  EXPECT_EQ(kept.origin, given.origin);
  EXPECT_EQ(kept.triangles, given.triangles);
  EXPECT_EQ(kept.surface, given.surface);
  EXPECT_EQ(kept.level, given.level);
  ASSERT_EQ(kept.vertices.size(), given.vertices.size());
  for (std::size_t v = 0; v < given.vertices.size(); ++v) {
    EXPECT_EQ(kept.vertices[v].position, given.vertices[v].position);
    EXPECT_EQ(kept.vertices[v].normal, given.vertices[v].normal);
  }
  EXPECT_TRUE(renderer_->download(renderer_->upload({})).vertices.empty());
}

// A preview's level 0 is a coarser one of the volume.
TEST_F(SceneRendererTest, LevelsHaveTheColoursOfTheVolumesOwn) {
  frame_.color_by_level = true;
  frame_.chunks = {renderer_->upload(squareAt(0.0, 1.5, 0, 3))};
  const glm::vec3 own = seen(32, 32);
  frame_.first_level = 2;
  frame_.chunks = {renderer_->upload(squareAt(0.0, 1.5, 0, 1))};
  EXPECT_EQ(seen(32, 32), own);
  frame_.first_level = 0;
  EXPECT_NE(seen(32, 32), own);
}

// In pieces that end anywhere, with and without the ring, of which more is asked than it has.
TEST_F(SceneRendererTest, PiecesOfAChunkComeTogether) {
  using Uploads = GlSceneRenderer::Uploads;
  SurfaceChunk given;
  for (int v = 0; v < 40000; ++v)
    given.vertices.push_back({glm::vec3(static_cast<float>(v), 1.0f, -2.0f), {}});
  for (std::uint32_t i = 0; i < 300000; ++i) given.triangles.push_back(i % 40000);
  const auto whole = static_cast<std::size_t>(given.bytes());
  for (const Uploads uploads : {Uploads::kAsSuits, Uploads::kStaged}) {
    renderer_ = std::make_unique<GlSceneRenderer>(uploads);
    std::vector<ChunkId> ids;
    for (int chunk = 0; chunk < 20; ++chunk) {
      ids.push_back(renderer_->reserve(given));
      for (std::size_t begin = 0; begin < whole;) {
        const std::size_t bytes = std::min(kPieceBytes - 4, whole - begin);
        if (renderer_->uploadPiece(ids.back(), given, begin, bytes))
          begin += bytes;
        else
          renderer_->endUploads();  // the next frame
      }
    }
    renderer_->endUploads();
    for (const ChunkId id : ids) {
      const SurfaceChunk kept = renderer_->download(id);
      EXPECT_EQ(kept.triangles, given.triangles);
      ASSERT_EQ(kept.vertices.size(), given.vertices.size());
      EXPECT_EQ(kept.vertices.back().position, given.vertices.back().position);
      EXPECT_EQ(kept.vertices[20000].position, given.vertices[20000].position);
    }
  }
}

TEST_F(SceneRendererTest, EdgesAreDrawnFromTheSameBuffer) {
  frame_.chunks = {renderer_->upload(squareAt(0.0, 1.0, 0))};
  const glm::vec3 plain_middle = seen(32, 32), plain_side = seen(26, 44);
  frame_.wireframe = true;
  EXPECT_LT(seen(32, 32).r, 0.8f * plain_middle.r);  // the diagonal
  EXPECT_NEAR(seen(26, 44).r, plain_side.r, 1e-3f);
}

TEST_F(SceneRendererTest, ClipPlanesCutAndTheirCapIsNotCut) {
  frame_.chunks = {renderer_->upload(squareAt(0.0, 1.5, 0))};
  frame_.clip_planes = {{{1.0, 0.0, 0.0}, 0.0}};  // what is at x < 0 goes
  EXPECT_TRUE(isBlack(seen(20, 32)));
  EXPECT_TRUE(isRed(seen(44, 32)));
  frame_.clip_planes.push_back({{0.0, 0.0, -1.0}, 0.0});  // and what is at z > 0
  EXPECT_TRUE(isBlack(seen(44, 20)));
  EXPECT_TRUE(isRed(seen(44, 44)));

  // A cap lies in its plane, and shows values above the least one in grey.
  frame_.chunks.clear();
  frame_.clip_planes = {{{0.0, 1.0, 0.0}, 0.0}};
  const float kNone = std::numeric_limits<float>::quiet_NaN();
  SceneSlice cap;
  cap.image =
      renderer_->uploadSlice({4, 2, {10.0f, 10.0f, 90.0f, kNone, 10.0f, 10.0f, 90.0f, kNone}});
  cap.corner = {-1.0, 0.0, -1.0};
  cap.across = {2.0, 0.0, 0.0};
  cap.along = {0.0, 0.0, 2.0};
  cap.least_value = 50.0;
  cap.cap_of = 0;
  cap.white = 100.0;
  frame_.slices = {cap};
  EXPECT_GT(seen(36, 32).g, 0.3f);     // above 50
  EXPECT_TRUE(isBlack(seen(22, 32)));  // below
  EXPECT_TRUE(isBlack(seen(44, 32)));  // no value
  frame_.slices[0].below_value = 20.0;
  EXPECT_FALSE(isBlack(seen(22, 32)));
  frame_.slices[0].least_value.reset();
  EXPECT_TRUE(isBlack(seen(36, 32)));
  frame_.slices[0].below_value.reset();
  EXPECT_FALSE(isBlack(seen(22, 32)));
  EXPECT_TRUE(isBlack(seen(44, 32)));
  renderer_->releaseSlice(cap.image);
  EXPECT_EQ(renderer_->bytesKept(), 4 * 20 + 6 * 4u);  // the square alone
}

// Two planes that meet in a groove along z at x = 0, away from the eye.
SurfaceChunk groove() {
  SurfaceChunk chunk;
  const glm::vec3 left(0.70710678f, -0.70710678f, 0.0f), right(-0.70710678f, -0.70710678f, 0.0f);
  for (const float x : {-1.0f, 0.0f})
    for (const float z : {-1.0f, 1.0f}) chunk.vertices.push_back({{x, x, z}, packNormal(left)});
  for (const float x : {0.0f, 1.0f})
    for (const float z : {-1.0f, 1.0f}) chunk.vertices.push_back({{x, -x, z}, packNormal(right)});
  chunk.triangles = {0, 2, 3, 0, 3, 1, 4, 6, 7, 4, 7, 5};
  boundChunk(chunk);
  return chunk;
}

TEST_F(SceneRendererTest, GroovesLieInTheShadeOfWhatIsAroundThem) {
  frame_.chunks = {renderer_->upload(groove())};
  frame_.width = frame_.height = 192;
  frame_.background_top = frame_.background_bottom = glm::vec3(0.5f);
  frame_.headlight = true;
  for (const bool orthographic : {false, true}) {
    frame_.camera.orthographic = orthographic;
    frame_.camera.half_width = frame_.camera.half_height = orthographic ? 2.0 : 0.2;
    for (const bool transparent : {false, true}) {
      frame_.transparent = transparent;
      frame_.ambient_occlusion = false;
      renderer_->draw(frame_);
      const Image plain = renderer_->picture();
      frame_.ambient_occlusion = true;
      renderer_->draw(frame_);
      const Image shaded = renderer_->picture();
      const auto share = [&](const Image& image, int x) {
        const int times = image.width / 192;
        float sum = 0.0f;
        for (int i = 0; i < times; ++i)
          sum += image.rgb[image.offsetOf(times * x + i, image.height / 2)];
        return sum / static_cast<float>(times) / plain.rgb[plain.offsetOf(x, 96)];
      };
      EXPECT_LT(share(shaded, 97), 0.75f);
      EXPECT_LT(share(shaded, 94), 0.75f);
      EXPECT_LT(share(shaded, 97), share(shaded, 102));
      EXPECT_NEAR(share(shaded, 115), 1.0f, 1e-3f);  // too far away
      EXPECT_EQ(shaded.alpha, plain.alpha);
      // Samples of the background stay as they are, at the edge of the surface too.
      for (std::size_t i = 0; i < plain.rgb.size(); i += 3)
        if (plain.rgb[i] == plain.rgb[0] && plain.rgb[i + 1] == plain.rgb[1]) {
          ASSERT_EQ(shaded.rgb[i], plain.rgb[i]);
        }
      // As wide in a larger picture.
      frame_.width = frame_.height = 384;
      renderer_->draw(frame_);
      const Image large = renderer_->picture();
      frame_.width = frame_.height = 192;
      for (const int x : {80, 90, 94, 98, 101, 104, 120})
        EXPECT_NEAR(share(large, x), share(shaded, x), 0.1f) << x;
    }
  }
  // A colour that stands for a value is nobody's shade, nor is a normal.
  SceneSlice slice;
  slice.image = renderer_->uploadSlice({2, 2, {50.0f, 50.0f, 50.0f, 50.0f}});
  slice.corner = {-1.0, -0.1, -1.0};
  slice.across = {2.0, 0.0, 0.0};
  slice.along = {0.0, 0.0, 2.0};
  slice.white = 100.0;
  frame_.slices = {slice};
  const glm::vec3 with = seen(97, 96);
  frame_.ambient_occlusion = false;
  EXPECT_EQ(with, seen(97, 96));
  frame_.slices.clear();
  frame_.normals = true;
  const glm::vec3 normal = seen(90, 96);
  frame_.ambient_occlusion = true;
  EXPECT_EQ(normal, seen(90, 96));
}

// A small square before a large one: its shadow falls to the right and down, away from the light
// over the viewer's left shoulder, with a soft edge, and is cut with the square.
TEST_F(SceneRendererTest, ASquareThrowsAShadowOnTheOneBehind) {
  frame_.camera.orthographic = true;
  frame_.camera.half_width = frame_.camera.half_height = 2.0;
  frame_.bounds = {glm::dvec3(-2.0), glm::dvec3(2.0)};
  const ChunkId wall = renderer_->upload(squareAt(1.0, 1.9, 0));
  const ChunkId plate = renderer_->upload(squareAt(0.0, 0.4, 1));
  frame_.chunks = {wall};
  const glm::vec3 lit = seen(46, 50);
  frame_.shadow = true;
  // Nothing shades itself.
  for (int y = 4; y < 60; y += 2)
    for (int x = 4; x < 60; x += 2) ASSERT_NEAR(seen(x, y).r, lit.r, 0.02f) << x << " " << y;
  frame_.chunks = {wall, plate};
  // One behind the plate: to the side by 0.55 / 0.60, down by 0.75 / 0.60 (16 pixels are one).
  const glm::vec3 dark = seen(32 + 15, 32 + 20);
  EXPECT_LT(dark.r, 0.55f * lit.r);
  EXPECT_GT(dark.r, 0.05f * lit.r);
  EXPECT_NEAR(seen(12, 12).r, lit.r, 0.02f);
  EXPECT_TRUE(isBlue(seen(32, 32)));
  int between = 0;
  for (int x = 44; x < 60; ++x) {
    const float r = seen(x, 52).r;
    between += r > dark.r + 0.03f && r < lit.r - 0.03f ? 1 : 0;
  }
  EXPECT_GE(between, 1);
  EXPECT_LE(between, 5);
  frame_.clip_planes = {{{0.0, 1.0, 0.0}, 0.5}};  // the plate is cut away
  EXPECT_NEAR(seen(47, 52).r, lit.r, 0.02f);
  frame_.clip_planes.clear();
  frame_.surfaces[1].opacity = 0.5;  // what is seen through throws none
  EXPECT_NEAR(seen(47, 52).r, lit.r, 0.02f);
  frame_.surfaces[1].opacity = 1.0;
  frame_.headlight = true;
  EXPECT_NEAR(seen(47, 52).r, seen(12, 12).r, 1e-3f);
}

// What has the first colour is clear, and what has the last is not.
TEST_F(SceneRendererTest, OpacityFollowsTheValues) {
  SurfaceChunk front = squareAt(-1.0, 1.5, 0);
  const std::array<double, 4> shares{0.0, 1.0, 1.0, 0.0};  // from left to right
  for (std::size_t v = 0; v < 4; ++v) front.vertices[v].value = packValue(shares[v]);
  frame_.chunks = {renderer_->upload(front), renderer_->upload(squareAt(2.0, 1.9, 1))};
  frame_.value_window = {{0.0, 1.0}};
  frame_.color_map = ColorMap::kGrey;
  const glm::vec3 opaque_left = seen(16, 32), opaque_right = seen(47, 32);
  EXPECT_FALSE(isBlue(opaque_left));
  frame_.value_opacity = {0.0, 1.0};
  EXPECT_TRUE(isBlue(seen(10, 32)));
  EXPECT_NEAR(seen(47, 32).r, 0.79f * opaque_right.r, 0.02f);  // at 0.79 of the square
  frame_.value_opacity = {1.0, 1.0};
  EXPECT_EQ(seen(16, 32), opaque_left);
}

TEST_F(SceneRendererTest, WhatIsBehindATranslucentSurfaceIsSeen) {
  frame_.chunks = {renderer_->upload(squareAt(2.0, 1.0, 0)),
                   renderer_->upload(squareAt(-2.0, 1.0, 1))};
  EXPECT_TRUE(isBlue(seen(32, 32)));
  frame_.surfaces[1].opacity = 0.5;
  const glm::vec3 both = seen(32, 32);
  EXPECT_GT(both.r, 0.15f);
  EXPECT_GT(both.b, 0.15f);
  frame_.surfaces[1].opacity = 0.0;
  EXPECT_TRUE(isRed(seen(32, 32)));
}

// A translucent slice shows a square behind it, and a slice behind it, in any order.
TEST_F(SceneRendererTest, TranslucentSlicesAreSeenThrough) {
  const auto sliceAt = [&](double y, float value) {
    SceneSlice slice;
    slice.image = renderer_->uploadSlice({2, 2, {value, value, value, value}});
    slice.corner = {-1.0, y, -1.0};
    slice.across = {2.0, 0.0, 0.0};
    slice.along = {0.0, 0.0, 2.0};
    slice.white = 100.0;
    return slice;
  };
  SceneSlice near = sliceAt(-1.0, 0.0f), far = sliceAt(1.0, 100.0f);
  frame_.slices = {near, far};
  EXPECT_LT(seen(32, 32).g, 0.01f);
  frame_.slices[0].opacity = 0.5;
  const glm::vec3 through = seen(32, 32);
  EXPECT_NEAR(through.g, 0.5f, 0.02f);
  std::swap(frame_.slices[0], frame_.slices[1]);
  EXPECT_EQ(seen(32, 32), through);
  for (SceneSlice& slice : frame_.slices) slice.opacity = 0.5;
  const glm::vec3 both = seen(32, 32);
  std::swap(frame_.slices[0], frame_.slices[1]);
  EXPECT_EQ(seen(32, 32), both);
  frame_.slices = {near};
  frame_.slices[0].opacity = 0.5;
  frame_.chunks = {renderer_->upload(squareAt(2.0, 1.0, 0))};
  EXPECT_TRUE(isRed(seen(32, 32)));
  // An opaque slice behind a translucent surface shines through it.
  frame_.surfaces[0].opacity = 0.2;
  frame_.chunks = {renderer_->upload(squareAt(-2.0, 1.0, 0))};
  frame_.slices = {far};
  EXPECT_GT(seen(32, 32).g, 0.7f);
  // A translucent one has no depth: neither it nor what it stands before is measured wrong.
  frame_.slices[0].opacity = 0.0;
  frame_.chunks = {renderer_->upload(squareAt(2.0, 1.0, 0))};
  frame_.surfaces[0].opacity = 1.0;
  frame_.normals = true;
  const glm::vec3 normal = seen(32, 32);
  EXPECT_NEAR(normal.y, -1.0f, 0.01f);
  EXPECT_NEAR(*distanceAt({32.0, 32.0}), 12.0, 1e-3);
}

TEST_F(SceneRendererTest, SegmentsAreHiddenByWhatIsInFrontOfThem) {
  frame_.segments = {{{-1.5, 1.0, 0.0}, {1.5, 1.0, 0.0}}};
  EXPECT_FALSE(isBlack(seen(32, 32)));
  EXPECT_TRUE(isBlack(seen(32, 40)));
  frame_.chunks = {renderer_->upload(squareAt(0.0, 0.5, 0))};
  EXPECT_TRUE(isRed(seen(32, 32)));
  EXPECT_FALSE(isBlack(seen(50, 32)));
  // One that begins behind the eye is cut.
  frame_.chunks.clear();
  frame_.segments = {{{0.0, -30.0, 0.5}, {0.0, 3.0, 0.5}}};
  EXPECT_FALSE(isBlack(seen(32, 20)));
}

TEST_F(SceneRendererTest, TheSphereIsATranslucentBall) {
  frame_.sphere = SphereOutline{{0.0, 0.0, 0.0}, 1.0};
  EXPECT_TRUE(isBlack(seen(32, 38)));
  frame_.fill_sphere = true;
  const glm::vec3 inside = seen(32, 38);
  EXPECT_FALSE(isBlack(inside));
  EXPECT_LT(inside.r, 0.3f);
  EXPECT_TRUE(isBlack(seen(4, 4)));
  // From within it tints nothing.
  frame_.sphere->radius = 2.0 * glm::distance(frame_.camera.eye, glm::dvec3(0.0));
  EXPECT_TRUE(isBlack(seen(32, 38)));
}

// What is over nothing has the colour that it has over black, premultiplied.
TEST_F(SceneRendererTest, WithoutABackgroundThereIsAlpha) {
  frame_.chunks = {renderer_->upload(squareAt(0.0, 1.0, 0)),
                   renderer_->upload(squareAt(-1.0, 0.4, 1))};
  frame_.surfaces[1].opacity = 0.25;
  frame_.sphere = SphereOutline{{0.0, 0.0, 0.0}, 1.5};
  frame_.background_top = frame_.background_bottom = glm::vec3(0.0f);
  renderer_->draw(frame_);
  const Image over_black = renderer_->picture();
  EXPECT_TRUE(over_black.alpha.empty());
  frame_.transparent = true;
  frame_.background_top = frame_.background_bottom = glm::vec3(1.0f);  // does not count
  renderer_->draw(frame_);
  const Image image = renderer_->picture();
  ASSERT_EQ(image.alpha.size(), 64u * 64u);
  for (std::size_t i = 0; i < image.rgb.size(); ++i)
    ASSERT_NEAR(image.rgb[i], over_black.rgb[i], 2e-3f) << i;
  const auto alphaAt = [&](std::size_t x, std::size_t y) { return image.alpha[64 * y + x]; };
  EXPECT_EQ(alphaAt(2, 2), 0.0f);
  EXPECT_NEAR(alphaAt(44, 32), 1.0f, 1e-3f);
  EXPECT_NEAR(alphaAt(32, 32), 1.0f, 1e-3f);  // translucent over opaque
  frame_.chunks.erase(frame_.chunks.begin());
  frame_.sphere.reset();
  renderer_->draw(frame_);
  EXPECT_NEAR(renderer_->picture().alpha[64 * 32 + 32], 0.25f, 1e-3f);
}

TEST_F(SceneRendererTest, NormalsAndDistancesAreThoseOfTheSurface) {
  frame_.chunks = {renderer_->upload(squareAt(3.0, 1.0, 0))};
  frame_.surfaces[0].opacity = 0.5;
  frame_.segments = {{{-1.5, -1.0, 0.0}, {1.5, -1.0, 0.0}}};
  frame_.normals = true;
  // Seen from another side they stay those of the world.
  for (const bool from_above : {false, true}) {
    if (from_above) {
      frame_.camera.eye = {0.0, -10.0, 10.0};
      frame_.camera.forward = glm::normalize(glm::dvec3(0.0, 1.0, -0.8));
      frame_.camera.up = glm::cross(frame_.camera.right, frame_.camera.forward);
    }
    const glm::vec3 normal = seen(32, 30);
    EXPECT_NEAR(normal.x, 0.0f, 1e-3f);
    EXPECT_NEAR(normal.y, -1.0f, 1e-3f);
    EXPECT_NEAR(normal.z, 0.0f, 1e-3f);
    EXPECT_TRUE(isBlack(seen(2, 2)));
    const std::vector<float> distances = renderer_->drawTile(frame_, {0, 0, 64, 64}, true).depth;
    ASSERT_EQ(distances.size(), 64u * 64u);
    EXPECT_NEAR(distances[64 * 30 + 32], distanceAt({32.0, 30.0}).value(), 1e-4);
    EXPECT_EQ(distances[64 * 2 + 2], std::numeric_limits<float>::infinity());
  }
}

// An error that a panel left behind is none of the surface's.
TEST_F(SceneRendererTest, AStaleErrorIsNoWantOfMemory) {
  const test::ExpectedComplaints complaints;
  glEnable(GL_TRIANGLES);  // no capability
  const ChunkId square = renderer_->upload(squareAt(0.0, 1.0, 0));
  frame_.chunks = {square};
  glEnable(GL_TRIANGLES);
  EXPECT_TRUE(isRed(seen(32, 32)));
  glEnable(GL_TRIANGLES);
  frame_.width = 96;
  EXPECT_TRUE(isRed(seen(48, 32)));
  glEnable(GL_TRIANGLES);
  EXPECT_NO_THROW(renderer_->uploadSlice({1, 1, {1.0f}}));
}

// The driver's words, and not the same for all of them.
TEST_F(SceneRendererTest, FaultsOfTheDriverAreToldApart) {
  const ChunkId square = renderer_->upload(squareAt(0.0, 1.0, 0));
  frame_.chunks = {square};
  seen(32, 32);
  // Beyond what the card draws, which is another error than want of memory.
  const int most = renderer_->greatestSize();
  test::DriverFaults faults;
  const test::ExpectedComplaints complaints;
  EXPECT_THROW(
      try { renderer_->reserveSlice(most * 4, most * 4); } catch (const NoGraphicsMemory&) {
        FAIL() << "a size that is too large is no want of memory";
      },
      Error);
  faults.reset();
  EXPECT_TRUE(renderer_->isLost());
  EXPECT_TRUE(renderer_->isLost());  // a driver reports it once
  EXPECT_THROW(renderer_->draw(frame_), RendererLost);
  EXPECT_THROW(renderer_->upload(squareAt(0.0, 1.0, 0)), RendererLost);
}

TEST_F(SceneRendererTest, TheLegendHasTheColoursOfTheSurface) {
  SurfaceChunk chunk = squareAt(0.0, 1.0, 0);
  frame_.headlight = true;
  for (const ColorMap map : {ColorMap::kViridis, ColorMap::kInferno, ColorMap::kGrey}) {
    frame_.color_map = map;
    for (const double share : {0.0, 0.125, 0.3, 0.6, 1.0}) {
      for (SurfaceVertex& vertex : chunk.vertices) vertex.value = packValue(share);
      const ChunkId valued = renderer_->upload(chunk);
      frame_.chunks = {valued};
      frame_.value_window = {{0.0, 1.0}};
      const glm::vec3 by_value = seen(32, 32);
      frame_.value_window.reset();
      frame_.surfaces[0].color = valueColor(map, share);
      EXPECT_LT(glm::distance(seen(32, 32), by_value), 2e-3f) << share;
    }
  }
}

// Of a surface without values too, and far from the world's origin.
TEST_F(SceneRendererTest, DistancesToAPlaneHaveTheirColours) {
  const glm::dvec3 away(3e5, -2e5, 1e6);
  frame_.camera.eye += away;
  frame_.bounds = {away - 4.0, away + 4.0};
  SurfaceChunk chunk = squareAt(0.0, 2.5, 0);
  chunk.origin += away;
  frame_.chunks = {renderer_->upload(chunk)};
  frame_.headlight = true;
  const glm::dvec3 normal = glm::normalize(glm::dvec3(1.0, 0.0, 1.0));
  frame_.value_plane = SceneClipPlane{normal, glm::dot(normal, away) - 0.5};
  for (const int x : {8, 24, 32, 56}) {
    const glm::dvec3 point = away + glm::dvec3((x + 0.5) / 16.0 - 2.0, 0.0, 2.0 - 40.5 / 16.0);
    const double distance = glm::dot(normal, point) - frame_.value_plane->offset;
    frame_.value_window = {{-2.0, 2.0}};
    const glm::vec3 by_distance = seen(x, 40);
    frame_.value_window.reset();
    frame_.surfaces[0].color = valueColor(frame_.color_map, (distance + 2.0) / 4.0);
    EXPECT_LT(glm::distance(seen(x, 40), by_distance), 1e-2f) << x;
  }
}

}  // namespace
}  // namespace isobrick
