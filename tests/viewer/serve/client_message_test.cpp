// Messages of clients: numbers come within their bounds, and nothing else comes of any bytes.
#include "isobrick/viewer/serve/client_message.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/common.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/serve/volume_answers.h"
#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"

namespace isobrick {
namespace {

ViewVolume volumeOfMessages() {
  ViewVolume volume;
  volume.voxels = {100, 50, 20};
  volume.least_value = -1000.0;
  volume.greatest_value = 3000.0;
  return volume;
}

ClientMessage parsed(const std::string& text) {
  return parseClientMessage(Asked::ofMessage(text), volumeOfMessages());
}

constexpr char kWish[] =
    R"({"type":"wish","wish":7,"surfaces":[{"iso":1324.5},{"iso":9e9,"visible":false}],)"
    R"("focus":[1,-2,300],"radius":1e9,"view":{"eye":[0,-400,60],"pixels_per_radian":1500,)"
    R"("pixels":1.5},"curvature":0.005,"most_triangles":8000000,"most_bytes":null,"x":[{}]})";

TEST(ClientMessage, AWishIsBroughtIntoItsBounds) {
  const ClientMessage message = parsed(kWish);
  const ClientWish& wish = std::get<ClientWish>(message);
  EXPECT_EQ(wish.number, 7);
  ASSERT_EQ(wish.surfaces.surfaces.size(), 2u);
  EXPECT_EQ(wish.surfaces.surfaces[0].isovalue, 1324.5);
  EXPECT_EQ(wish.surfaces.surfaces[1].isovalue, 3000.0);
  EXPECT_FALSE(wish.surfaces.surfaces[1].visible);
  EXPECT_EQ(wish.surfaces.detail.focus, glm::dvec3(1, -2, 300)) << "of a scene";
  EXPECT_EQ(wish.surfaces.radius, volumeOfMessages().diagonal());
  EXPECT_FALSE(wish.surfaces.is_whole);
  EXPECT_EQ(wish.surfaces.detail.view->pixels, 1.5);
  EXPECT_EQ(wish.most_triangles, 8000000u);
  EXPECT_FALSE(wish.most_bytes);
}

TEST(ClientMessage, WithoutAFocusAllIsFine) {
  const auto wish =
      std::get<ClientWish>(parsed(R"({"type":"wish","wish":0,"surfaces":[{"iso":0}]})"));
  EXPECT_TRUE(wish.surfaces.is_whole);
  EXPECT_EQ(wish.surfaces.radius, volumeOfMessages().diagonal());
}

TEST(ClientMessage, AWishHasARegionASideAndCaps) {
  const auto wish = std::get<ClientWish>(parsed(
      R"({"type":"wish","wish":0,"surfaces":[{"iso":0},{"iso":1,"inside":"below"}],"cap":true,)"
      R"("clip":[1,0,0,30, 0,2,0,1e99],"sphere":[1,2,3,4]})"));
  EXPECT_EQ(wish.surfaces.surfaces[0].inside, InsideOf::kAbove);
  EXPECT_EQ(wish.surfaces.surfaces[1].inside, InsideOf::kBelow);
  EXPECT_TRUE(wish.surfaces.detail.capped);
  const ViewRegion& region = wish.surfaces.detail.region;
  ASSERT_EQ(region.half_spaces.size(), 2u);
  EXPECT_EQ(region.half_spaces[0], (HalfSpace{{1, 0, 0}, 30}));
  EXPECT_EQ(region.half_spaces[1].offset, 1e12);
  EXPECT_EQ(region.balls, (std::vector<ViewBall>{{{1, 2, 3}, 4}}));
}

TEST(ClientMessage, AFileHasTheSameWords) {
  const auto queryFor = [](const std::string& words) {
    return surfaceFileOrder(Asked::ofAddress("iso=1" + words), ".ply").query;
  };
  const Query query = queryFor("&clip=1,0,0,30&sphere=1,2,3,4&cap=1&inside=below");
  EXPECT_EQ(query.region.half_spaces, (std::vector<HalfSpace>{{{1, 0, 0}, 30}}));
  EXPECT_EQ(query.region.balls, (std::vector<RegionBall>{{{1, 2, 3}, 4}}));
  EXPECT_TRUE(query.cap);
  EXPECT_EQ(query.inside, InsideOf::kBelow);
  EXPECT_TRUE(queryFor("").region.isEverywhere());
  for (const char* const wrong : {"&clip=1,0,0", "&cap=2", "&inside=1"})
    EXPECT_THROW(queryFor(wrong), Error) << wrong;
}

TEST(ClientMessage, OthersAreUnknownOrRefused) {
  EXPECT_EQ(std::get<ClientShown>(parsed(R"({"type":"shown","pass":3,"seconds":99})")).seconds,
            10.0);
  EXPECT_TRUE(std::holds_alternative<std::monostate>(parsed(R"({"type":"of later"})")));
  for (const char* const wrong :
       {"", "7", "{}", R"({"type":1})", R"({"type":"wish"})", R"({"type":"shown","pass":"1"})",
        R"({"type":"wish","wish":1,"surfaces":{}})", R"({"type":"wish","wish":1,"surfaces":[1]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"focus":[1,2,null],"radius":1})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"focus":[1,2,3]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1,"visible":1}]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"view":{"eye":[0,0,0]}})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1,"inside":"out"}]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"clip":[1,2,3]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"clip":[0,0,0,3]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"clip":[1e-200,0,0,3]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"clip":[]})",
        R"({"type":"wish","wish":1,"surfaces":[{"iso":1}],"sphere":[1,2,3,0]})",
        "{\"type\":\"wish\",\"wish\":1,\"surfaces\":[{\"iso\":1}]}\xff"})
    EXPECT_THROW(parsed(wrong), Error) << wrong;
}

// Copies of values use the stack.
TEST(ClientMessage, WhatIsNestedDeepIsRefused) {
  const std::string deep = std::string(15'000, '[') + std::string(15'000, ']');
  for (const std::string& message :
       {R"({"type":"wish","wish":1,"x":)" + deep + R"(,"surfaces":[{"iso":7}]})",
        R"({"type":"wish","wish":1,"surfaces":)" + deep + "}"})
    EXPECT_THROW(parsed(message), Error);
}

void expectBounded(const ClientWish& wish, const ViewVolume& volume) {
  const SurfaceWish& surfaces = wish.surfaces;
  ASSERT_FALSE(surfaces.surfaces.empty());
  ASSERT_LE(surfaces.surfaces.size(), kMostWishedSurfaces);
  for (const SurfaceWish::Surface& surface : surfaces.surfaces) {
    ASSERT_GE(surface.isovalue, volume.least_value);
    ASSERT_LE(surface.isovalue, volume.greatest_value);
  }
  ASSERT_TRUE(surfaces.radius >= 1.0 && surfaces.radius <= volume.diagonal());
  const glm::dvec3 far(1 << 30);
  ASSERT_EQ(surfaces.detail.focus, glm::clamp(surfaces.detail.focus, -far, far));
  if (const auto& view = surfaces.detail.view) {
    for (int axis = 0; axis < 3; ++axis) ASSERT_LE(std::abs(view->eye[axis]), 1e12);
    ASSERT_TRUE(view->pixels > 0.0 && view->pixels_per_radian > 0.0);
  }
  ASSERT_GE(surfaces.detail.curvature_tolerance.value_or(0.0), 0.0);
}

// Bytes changed, left out, doubled and put together from good messages.
TEST(ClientMessage, RandomBytesAreRefusedOrBounded) {
  const std::vector<std::string> seeds{kWish, R"({"type":"shown","pass":3,"seconds":0.5})",
                                       R"([1e308,-1e308,"\u0000",{"a":[[[[]]]]}])"};
  const std::string pieces[] = {"1e999", "-1e308", "null", "[",   "{",        "\"wish\"", ",",
                                "0.",    "-0",     "true", "\\u", "\xc3\x28", "1e-400",   "}"};
  const ViewVolume volume = volumeOfMessages();
  test::Random random(50);
  int wishes = 0;
  for (int i = 0; i < test::repetitions(40'000); ++i) {
    std::string text = seeds[test::randomBelow(random, seeds.size())];
    for (std::uint64_t edits = test::randomBelow(random, 4); edits > 0 && !text.empty(); --edits) {
      const std::size_t at = test::randomBelow(random, text.size());
      switch (test::randomBelow(random, 4)) {
        case 0:
          text[at] = static_cast<char>(test::randomBelow(random, 256));
          break;
        case 1:
          text.erase(at, test::randomBelow(random, 8));
          break;
        case 2:
          text.insert(at, pieces[test::randomBelow(random, std::size(pieces))]);
          break;
        default:
          text.insert(at, text, 0, test::randomBelow(random, text.size()));
          break;
      }
    }
    try {
      const ClientMessage message = parsed(text);
      if (const auto* const wish = std::get_if<ClientWish>(&message)) {
        ++wishes;
        ASSERT_NO_FATAL_FAILURE(expectBounded(*wish, volume)) << text;
      }
    } catch (const Error& refused) {
      ASSERT_EQ(std::string(refused.what()).find('\n'), std::string::npos);
    }
  }
  EXPECT_GT(wishes, 0);
}

}  // namespace
}  // namespace isobrick
