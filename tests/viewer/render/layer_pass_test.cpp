// What is seen through: fragments are composited by depth, in every pixel, in whatever order they
// were drawn.

#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "isobrick/viewer/render/scene_shaders.h"
#include "isobrick/viewer/render/scene_view.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "tests/support/asked_distance.h"
#include "tests/support/gl_test.h"

namespace isobrick {
namespace {

constexpr int kSize = 128;
constexpr double kHalf = 4.0;  // of the picture, world units

// Part `part` of `parts` of a sphere around the origin: a sector of its longitudes.
SurfaceChunk sphereSector(double radius, int surface, int part, int parts) {
  constexpr int kAround = 192, kAlong = 96;
  SurfaceChunk chunk;
  chunk.surface = surface;
  const int first = part * kAround / parts, last = (part + 1) * kAround / parts;
  for (int i = first; i <= last; ++i) {
    for (int j = 0; j <= kAlong; ++j) {
      const double azimuth = 2.0 * std::numbers::pi * i / kAround;
      const double polar = std::numbers::pi * j / kAlong;
      const glm::vec3 normal(glm::dvec3(std::sin(polar) * std::cos(azimuth),
                                        std::sin(polar) * std::sin(azimuth), std::cos(polar)));
      chunk.vertices.push_back({static_cast<float>(radius) * normal, packNormal(normal)});
    }
  }
  for (int i = 0; i < last - first; ++i) {
    for (int j = 0; j < kAlong; ++j) {
      const auto a = static_cast<std::uint32_t>(i * (kAlong + 1) + j);
      const std::uint32_t b = a + kAlong + 1;
      for (const std::uint32_t v : {a, a + 1, b, b, a + 1, b + 1}) chunk.triangles.push_back(v);
    }
  }
  boundChunk(chunk);
  return chunk;
}

// A square across y, `half` wide to each side, seen from -y, turned about z by `turn`.
SurfaceChunk squareAcross(double y, double half, int surface, double turn = 0.0) {
  SurfaceChunk chunk;
  chunk.origin = {0.0, y, 0.0};
  chunk.surface = surface;
  const auto h = static_cast<float>(half);
  const auto c = static_cast<float>(std::cos(turn)), s = static_cast<float>(std::sin(turn));
  for (const glm::vec2& p :
       {glm::vec2(-h, -h), glm::vec2(h, -h), glm::vec2(h, h), glm::vec2(-h, h)})
    chunk.vertices.push_back({{c * p.x, s * p.x, p.y}, packNormal({s, -c, 0.0f})});
  chunk.triangles = {0, 1, 2, 0, 2, 3};
  boundChunk(chunk);
  return chunk;
}

// While it lives, the first buffer that gets its memory has none.
class FailingStorage {
 public:
  FailingStorage() : storage_before_(epoxy_glNamedBufferStorage), get_before_(epoxy_glGetError) {
    storage_ = this;
    epoxy_glNamedBufferStorage = [](GLuint buffer, auto... rest) {
      storage_->storage_before_(buffer, rest...);
      if (storage_->failures_++ == 0) storage_->is_due_ = true;
    };
    epoxy_glGetError = [] {
      if (!storage_->is_due_) return storage_->get_before_();
      storage_->is_due_ = false;
      return GLenum{GL_OUT_OF_MEMORY};
    };
  }
  ~FailingStorage() {
    epoxy_glNamedBufferStorage = storage_before_;
    epoxy_glGetError = get_before_;
  }
  FailingStorage(const FailingStorage&) = delete;
  FailingStorage& operator=(const FailingStorage&) = delete;

  bool hasFailed() const { return failures_ > 0; }

 private:
  inline static FailingStorage* storage_ = nullptr;
  decltype(epoxy_glNamedBufferStorage) storage_before_;
  decltype(epoxy_glGetError) get_before_;
  int failures_ = 0;
  bool is_due_ = false;
};

class LayerPassTest : public test::GlTest {
 protected:
  void setUp() override {
    renderer_ = std::make_unique<GlSceneRenderer>();
    frame_.width = frame_.height = kSize;
    frame_.camera.eye = {0.0, -10.0, 0.0};
    frame_.camera.orthographic = true;
    frame_.camera.half_width = frame_.camera.half_height = kHalf;
    frame_.bounds = {glm::dvec3(-kHalf), glm::dvec3(kHalf)};
    frame_.headlight = true;
    frame_.background_top = frame_.background_bottom = glm::vec3(0.5f);
  }

  Image drawn() {
    renderer_->draw(frame_);
    return renderer_->picture();
  }
  glm::vec3 seen(int x, int y) {
    const Image image = drawn();
    const std::size_t at = image.offsetOf(x, y);
    return {image.rgb[at], image.rgb[at + 1], image.rgb[at + 2]};
  }
  // As the shader lights it: a normal in eye coordinates that faces the eye.
  glm::vec3 lit(const glm::vec3& color, const glm::vec3& normal, bool is_front) const {
    const glm::vec3 key = keyLightDirection(), to_eye(0.0f, 0.0f, 1.0f);
    const float head = std::max(glm::dot(normal, to_eye), 0.0f);
    const glm::vec3 shaded =
        linearColor(is_front ? color : frame_.back_color) * (0.08f + 0.92f * head);
    if (!is_front) return 0.6f * shaded;
    const float gloss =
        std::pow(std::max(glm::dot(normal, glm::normalize(key + to_eye)), 0.0f), 48.0f);
    return shaded + 0.10f * gloss * std::max(glm::dot(normal, key), 0.0f);
  }

  std::unique_ptr<GlSceneRenderer> renderer_;
  SceneFrame frame_;
};

// Three nested spheres, held against the six hits of every ray; and the same picture, byte for
// byte, for every order of surfaces and chunks.
TEST_F(LayerPassTest, NestedSpheresAreWhatARayMeets) {
  struct Ball {
    double radius;
    SurfaceLook look;
  };
  std::vector<Ball> balls{{1.2, {{0.9f, 0.2f, 0.1f}, 0.7}},
                          {2.3, {{0.1f, 0.8f, 0.2f}, 0.4}},
                          {3.4, {{0.2f, 0.3f, 0.9f}, 0.5}}};
  std::mt19937 random(7);
  std::vector<float> first;
  for (int order = 0; order < 4; ++order) {
    frame_.chunks.clear();
    frame_.surfaces.clear();
    for (std::size_t s = 0; s < balls.size(); ++s) {
      frame_.surfaces.push_back(balls[s].look);
      for (int part = 0; part < 3; ++part)
        frame_.chunks.push_back(
            renderer_->upload(sphereSector(balls[s].radius, static_cast<int>(s), part, 3)));
    }
    std::shuffle(frame_.chunks.begin(), frame_.chunks.end(), random);
    const Image image = drawn();
    if (first.empty()) first = image.rgb;
    EXPECT_EQ(image.rgb, first) << order;
    int compared = 0;
    float worst = 0.0f;
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) {
        const double right = kHalf * (2.0 * (x + 0.5) / kSize - 1.0);
        const double up = kHalf * (1.0 - 2.0 * (y + 0.5) / kSize);
        const double away = std::hypot(right, up);
        bool is_rim = false;
        struct Hit {
          double toward;
          glm::vec3 light;
          double opacity;
        };
        std::vector<Hit> hits;
        for (const auto& [radius, look] : balls) {
          is_rim = is_rim || std::abs(away - radius) < 0.15;
          if (away >= radius) continue;
          const double toward = std::sqrt(radius * radius - away * away);
          const glm::vec3 normal(glm::dvec3(right, up, toward) / radius);
          // The inside of the back faces the eye.
          const glm::vec3 inside = normal * glm::vec3(-1.0f, -1.0f, 1.0f);
          hits.push_back({toward, lit(look.color, normal, true), look.opacity});
          hits.push_back({-toward, lit(look.color, inside, false), look.opacity});
        }
        if (is_rim) continue;
        std::sort(hits.begin(), hits.end(),
                  [](const Hit& a, const Hit& b) { return a.toward > b.toward; });
        glm::vec3 sum(0.0f);
        float through = 1.0f;
        for (const Hit& hit : hits) {
          sum += through * static_cast<float>(hit.opacity) * hit.light;
          through *= 1.0f - static_cast<float>(hit.opacity);
        }
        sum += through * linearColor(glm::vec3(0.5f));
        const std::size_t at = image.offsetOf(x, y);
        for (glm::length_t c = 0; c < 3; ++c)
          worst = std::max(worst, std::abs(image.rgb[at + static_cast<std::size_t>(c)] - sum[c]));
        ++compared;
      }
    }
    EXPECT_GT(compared, kSize * kSize / 2);
    EXPECT_LT(worst, 0.01f) << order;
    for (const ChunkId chunk : frame_.chunks) renderer_->release(chunk);
    std::shuffle(balls.begin(), balls.end(), random);
  }
}

// Where two squares cross, each is before the other one in half of the picture.
TEST_F(LayerPassTest, SurfacesMayCross) {
  frame_.surfaces = {{{1.0f, 0.0f, 0.0f}, 0.6}, {{0.0f, 0.0f, 1.0f}, 0.6}};
  frame_.chunks = {renderer_->upload(squareAcross(0.0, 2.0, 0, 0.5)),
                   renderer_->upload(squareAcross(0.0, 2.0, 1, -0.5))};
  const glm::vec3 left = seen(48, 64), right = seen(80, 64);
  EXPECT_GT(left.r, 1.5f * left.b);  // its left side comes towards the eye
  EXPECT_GT(right.b, 1.5f * right.r);
  EXPECT_NEAR(left.r, right.b, 1e-3f);
}

// As many as there are; what is opaque ends them.
TEST_F(LayerPassTest, ManyLayersAndAnOpaqueOneBetween) {
  frame_.surfaces = {{{1.0f, 1.0f, 1.0f}, 0.1}, {{0.0f, 0.0f, 0.0f}, 1.0}};
  frame_.back_color = glm::vec3(1.0f);
  for (int i = 0; i < 24; ++i)
    frame_.chunks.push_back(renderer_->upload(squareAcross(-3.0 + 0.25 * i, 2.0, 0)));
  frame_.background_top = frame_.background_bottom = glm::vec3(0.0f);
  const float one = lit(glm::vec3(1.0f), {0.0f, 0.0f, 1.0f}, true).r;
  const auto share = [](int layers) { return static_cast<float>(1.0 - std::pow(0.9, layers)); };
  EXPECT_NEAR(seen(64, 64).r, share(24) * one, 2e-3f);
  EXPECT_NEAR(*test::distanceAt(*renderer_, {64.0, 64.0}), 7.0, 1e-3);  // the nearest of them
  frame_.chunks.push_back(renderer_->upload(squareAcross(-0.1, 1.0, 1)));
  const float black = lit(glm::vec3(0.0f), {0.0f, 0.0f, 1.0f}, true).r;
  EXPECT_NEAR(seen(64, 64).r, share(12) * one + (1.0f - share(12)) * black, 2e-3f);
  // The same within each sample: at the edge of the opaque one both are seen.
  const float inside = seen(64, 64).r, outside = seen(64, 40).r;
  EXPECT_GT(outside, inside);
  frame_.clip_planes = {{{0.0, 1.0, 0.0}, -1.6}};  // the first six are cut away
  EXPECT_NEAR(seen(64, 40).r, share(18) * one, 2e-3f);
  EXPECT_NEAR(*test::distanceAt(*renderer_, {64.0, 40.0}), 8.5, 1e-3);
}

// A slice that is seen through stands at its place among surfaces that are.
TEST_F(LayerPassTest, SlicesAreLayersToo) {
  SceneSlice slice;
  slice.image = renderer_->uploadSlice({2, 2, {100.0f, 100.0f, 100.0f, 100.0f}});
  slice.corner = {-2.0, 0.0, -2.0};
  slice.across = {4.0, 0.0, 0.0};
  slice.along = {0.0, 0.0, 4.0};
  slice.white = 100.0;
  slice.opacity = 0.5;
  frame_.slices = {slice};
  frame_.surfaces = {{{1.0f, 0.0f, 0.0f}, 0.5}};
  const glm::vec3 red = lit({1.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 1.0f}, true);
  const glm::vec3 ground = linearColor(glm::vec3(0.5f));
  const ChunkId before = renderer_->upload(squareAcross(-1.0, 1.0, 0));
  const ChunkId behind = renderer_->upload(squareAcross(1.0, 1.0, 0));
  frame_.chunks = {before};
  glm::vec3 expected = 0.5f * red + 0.25f * glm::vec3(1.0f) + 0.25f * ground;
  EXPECT_LT(glm::distance(seen(64, 64), expected), 2e-3f);
  EXPECT_NEAR(*test::distanceAt(*renderer_, {64.0, 64.0}), 9.0, 1e-3);
  frame_.chunks = {behind};
  expected = 0.5f * glm::vec3(1.0f) + 0.25f * red + 0.25f * ground;
  EXPECT_LT(glm::distance(seen(64, 64), expected), 2e-3f);
  EXPECT_NEAR(*test::distanceAt(*renderer_, {64.0, 64.0}), 11.0, 1e-3);  // a slice has no depth
  EXPECT_FALSE(test::distanceAt(*renderer_, {64.0, 36.0}));              // beside the square
}

// Where values make a surface clear, it has neither a colour nor a depth.
TEST_F(LayerPassTest, WhatIsClearIsNotHit) {
  SurfaceChunk front = squareAcross(-1.0, 2.0, 0);
  for (SurfaceVertex& vertex : front.vertices) vertex.value = packValue(0.0);
  frame_.chunks = {renderer_->upload(front), renderer_->upload(squareAcross(1.0, 2.0, 1))};
  frame_.surfaces = {{{1.0f, 0.0f, 0.0f}, 1.0}, {{0.0f, 0.0f, 1.0f}, 1.0}};
  frame_.value_window = {{0.0, 1.0}};
  frame_.value_opacity = {0.0, 1.0};
  drawn();
  EXPECT_NEAR(*test::distanceAt(*renderer_, {64.0, 64.0}), 11.0, 1e-3);
  frame_.value_opacity = {0.25, 1.0};
  drawn();
  EXPECT_NEAR(*test::distanceAt(*renderer_, {64.0, 64.0}), 9.0, 1e-3);
}

// Lists have an end: a picture with more fragments is drawn in bands, and is the same one.
TEST_F(LayerPassTest, APictureInBandsIsTheSame) {
  GlLimits limits = renderer_->device().limits();
  const auto drawnWithin = [&](std::int64_t bytes) {
    limits.storage_block_bytes = bytes;
    renderer_ = std::make_unique<GlSceneRenderer>(GlSceneRenderer::Uploads::kAsSuits, limits);
    frame_.surfaces = {{{0.9f, 0.2f, 0.1f}, 0.3}, {{0.1f, 0.8f, 0.2f}, 0.4}};
    frame_.chunks.clear();
    for (int part = 0; part < 8; ++part)
      for (const int surface : {0, 1})
        frame_.chunks.push_back(
            renderer_->upload(sphereSector(1.5 + 1.2 * surface, surface, part, 8)));
    return drawn().rgb;
  };
  const std::vector<float> whole = drawnWithin(std::int64_t{64} << 20);
  EXPECT_EQ(renderer_->layers().bands(), 1);
  const std::vector<float> banded = drawnWithin(1 << 18);
  EXPECT_GT(renderer_->layers().bands(), 3);
  EXPECT_EQ(banded, whole);
}

// A frame without anything that is seen through pays nothing for it.
TEST_F(LayerPassTest, OpaqueFramesHaveNone) {
  frame_.surfaces = {{{1.0f, 0.0f, 0.0f}, 1.0}};
  frame_.chunks = {renderer_->upload(squareAcross(0.0, 2.0, 0))};
  const Image before = drawn();
  EXPECT_EQ(renderer_->layers().bands(), 0);
  EXPECT_EQ(renderer_->layers().bytes(), 0);
  frame_.surfaces[0].opacity = 0.5;
  drawn();
  EXPECT_EQ(renderer_->layers().bands(), 1);
  EXPECT_GT(renderer_->layers().bytes(), 0);
  frame_.surfaces[0].opacity = 1.0;
  EXPECT_EQ(drawn().rgb, before.rgb);
  EXPECT_EQ(renderer_->layers().bytes(), 0);
  EXPECT_EQ(renderer_->layers().bands(), 0);
}

// The part of the picture that may have layers is found by boxes: from beside, near and within.
TEST_F(LayerPassTest, EveryPixelThatIsCoveredHasItsLayer) {
  frame_.transparent = true;
  frame_.camera.orthographic = false;
  for (int part = 0; part < 8; ++part)
    frame_.chunks.push_back(renderer_->upload(sphereSector(1.0, 0, part, 8)));
  for (const glm::dvec3& eye :
       {glm::dvec3(0.0, -10.0, 0.0), glm::dvec3(1.8, -4.0, -1.5), glm::dvec3(0.4, -1.2, 0.3),
        glm::dvec3(0.3, 0.2, -0.1), glm::dvec3(-6.0, -3.0, 0.0)}) {
    frame_.camera.eye = eye;
    frame_.camera.half_width = frame_.camera.half_height = 0.5;
    frame_.surfaces = {{{1.0f, 0.0f, 0.0f}, 1.0}};
    const Image opaque = drawn();
    frame_.surfaces[0].opacity = 0.5;
    const Image through = drawn();
    int covered = 0;
    for (std::size_t i = 0; i < opaque.alpha.size(); ++i) {
      ASSERT_EQ(opaque.alpha[i] > 0.0f, through.alpha[i] > 0.0f) << i % kSize << " " << i / kSize;
      covered += opaque.alpha[i] > 0.0f ? 1 : 0;
    }
    if (eye.x > -1.0) {
      EXPECT_GT(covered, 100);
    }
  }
}

// A card without room for the lists says so, and the next frame has them again.
TEST_F(LayerPassTest, WantOfMemoryIsSaid) {
  frame_.surfaces = {{{1.0f, 0.0f, 0.0f}, 0.5}};
  frame_.chunks = {renderer_->upload(squareAcross(0.0, 2.0, 0))};
  const Image before = drawn();
  frame_.surfaces[0].opacity = 1.0;
  drawn();  // which gives the memory back
  frame_.surfaces[0].opacity = 0.5;
  {
    FailingStorage none;
    EXPECT_THROW(drawn(), NoGraphicsMemory);
    EXPECT_TRUE(none.hasFailed());
    EXPECT_EQ(renderer_->layers().bytes(), 0);
  }
  EXPECT_EQ(drawn().rgb, before.rgb);
}

// Edges of triangles, and what is around: lines before and behind, alpha.
TEST_F(LayerPassTest, EdgesAndAlphaAreKept) {
  frame_.surfaces = {{{1.0f, 0.0f, 0.0f}, 0.5}};
  frame_.chunks = {renderer_->upload(squareAcross(0.0, 2.0, 0)),
                   renderer_->upload(squareAcross(1.0, 2.0, 0))};
  frame_.transparent = true;
  const Image image = drawn();
  EXPECT_NEAR(image.alpha[64 * kSize + 64], 0.75f, 1e-3f);
  EXPECT_EQ(image.alpha[4 * kSize + 4], 0.0f);
  // At the border, half a pixel of which is covered.
  frame_.camera.half_width = frame_.camera.half_height = 4.03;
  const Image moved = drawn();
  int partly = 0;
  for (int x = 0; x < kSize; ++x) {
    const float alpha = moved.alpha[64 * kSize + static_cast<std::size_t>(x)];
    partly += alpha > 0.1f && alpha < 0.7f ? 1 : 0;
  }
  EXPECT_EQ(partly, 2);
  const float plain = moved.rgb[moved.offsetOf(64, 64)];
  frame_.wireframe = true;
  const Image wired = drawn();
  EXPECT_LT(wired.rgb[wired.offsetOf(64, 64)], 0.9f * plain);  // the diagonal
}

}  // namespace
}  // namespace isobrick
