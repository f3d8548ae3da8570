#include "tools/bench/surface_distance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <limits>
#include <random>

#include "isobrick/extract/sinks/nearest_parts.h"
#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

using test::TemporaryFolder;

constexpr DistanceOptions kOptions{2'000'000, Index3(100)};

// The square [10, 90]^2 at height z, in count^2 squares of two triangles.
PlainMesh square(float z, std::uint32_t count, float end = 90) {
  PlainMesh mesh;
  const float step = (end - 10) / static_cast<float>(count);
  for (std::uint32_t j = 0; j <= count; ++j)
    for (std::uint32_t i = 0; i <= count; ++i)
      mesh.positions.push_back(
          {10 + step * static_cast<float>(i), 10 + step * static_cast<float>(j), z});
  for (std::uint32_t j = 0; j < count; ++j)
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::uint32_t at = j * (count + 1) + i;
      mesh.triangles.push_back({at, at + 1, at + count + 2});
      mesh.triangles.push_back({at, at + count + 2, at + count + 1});
    }
  return mesh;
}

TEST(SurfaceDistance, ParallelPlanesHoweverTheyAreCut) {
  const PlainMesh coarse = square(20, 1), fine = square(20.25f, 73);
  for (const OneWayDistance d :
       {distanceFrom(coarse, fine, kOptions), distanceFrom(fine, coarse, kOptions)}) {
    EXPECT_DOUBLE_EQ(d.mean, 0.25);
    EXPECT_DOUBLE_EQ(d.p99, 0.25);
    EXPECT_DOUBLE_EQ(d.max, 0.25);
    EXPECT_GT(d.points, 6400u) << "a coarse mesh is looked at as closely as a fine one";
  }
}

TEST(SurfaceDistance, WhatOneLacksIsSeenFromTheOther) {
  const PlainMesh whole = square(20, 16), half = square(20, 16, 50);
  EXPECT_LT(distanceFrom(half, whole, kOptions).max, 1e-6);
  const OneWayDistance d = distanceFrom(whole, half, kOptions);
  EXPECT_NEAR(d.max, 40 * std::sqrt(2.0), 1e-4);  // the far corner
  // A quarter at 0, two at 20 in the mean, one at its points' distance from a corner: 40 * 0.7652.
  EXPECT_NEAR(d.mean, (20 + 20 + 40 * 0.765196) / 4, 0.02);
  EXPECT_GT(d.p99, 45);
  EXPECT_LT(d.p99, d.max);
}

TEST(SurfaceDistance, ATinyBadSpotMovesTheMaximumOnly) {
  PlainMesh mesh = square(20, 80);
  mesh.positions[40 * 81 + 40][2] = 30;  // a spike of 6 triangles of 12800
  const OneWayDistance d = distanceFrom(mesh, square(20, 3), kOptions);
  EXPECT_DOUBLE_EQ(d.max, 10);
  EXPECT_LT(d.mean, 0.2);
}

TEST(SurfaceDistance, TheVolumesBorderDoesNotCount) {
  DistanceOptions options = kOptions;
  options.voxels = Index3(100, 100, 22);
  const PlainMesh low = square(20, 4), high = square(20.5f, 4);
  EXPECT_EQ(distanceFrom(low, high, options).max, 0.5);
  EXPECT_EQ(distanceFrom(high, low, options).points, 0u);
}

TEST(SurfaceDistance, FewerPointsSayTheSame) {
  DistanceOptions few = kOptions;
  few.most_points = 1000;
  const OneWayDistance d = distanceFrom(square(20, 1), square(21, 1), few);
  EXPECT_LE(d.points, 1001u);
  EXPECT_GT(d.points, 300u);
  EXPECT_DOUBLE_EQ(d.mean, 1);
}

TEST(SurfaceDistance, NothingIsInfinitelyFarAway) {
  EXPECT_EQ(distanceFrom(square(20, 2), {}, kOptions).max, std::numeric_limits<double>::infinity());
  const OneWayDistance none = distanceFrom({}, square(20, 2), kOptions);
  EXPECT_EQ(none.max, 0);
  EXPECT_EQ(none.points, 0u);
}

TEST(SurfaceDistance, FindsWhatLookingAtAllOfThemFinds) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> place(10, 80), offset(-3, 3);
  for (const std::uint32_t count : {1u, 3u, 4u, 5u, 8u, 9u, 17u, 500u}) {
    PlainMesh soup;
    for (std::uint32_t t = 0; t < count; ++t) {
      const std::array<float, 3> middle = {place(random), place(random), place(random)};
      for (int corner = 0; corner < 3; ++corner)
        soup.positions.push_back(
            {middle[0] + offset(random), middle[1] + offset(random), middle[2] + offset(random)});
      soup.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
    }
    const auto corner = [&](std::uint32_t vertex) { return glm::dvec3(soup.positions[vertex]); };
    for (int i = 0; i < 100; ++i) {
      const PlainMesh point = {{{place(random), place(random), place(random)}}, {}};
      const glm::dvec3 at(point.positions[0]);
      double nearest = std::numeric_limits<double>::infinity();
      for (const auto& [a, b, c] : soup.triangles)
        nearest = std::min(nearest, squaredDistance(at, corner(a), corner(b), corner(c)));
      ASSERT_DOUBLE_EQ(distanceFrom(point, soup, kOptions).max, std::sqrt(nearest))
          << count << " triangles, " << i;
    }
  }
}

TEST(PlainMeshFile, ComesBackAndIsCheckedAgainstItsSize) {
  const TemporaryFolder folder;
  const std::string path = folder.file("mesh");
  const PlainMesh mesh = square(20, 3);
  writePlainMesh(mesh, path);
  EXPECT_EQ(readPlainMesh(path).positions, mesh.positions);
  EXPECT_EQ(readPlainMesh(path).triangles, mesh.triangles);

  const std::string whole = test::readBytes(path);
  for (const std::size_t length :
       {std::size_t{0}, std::size_t{15}, std::size_t{16}, whole.size() - 1}) {
    std::ofstream(path, std::ios::binary) << whole.substr(0, length);
    EXPECT_THROW(readPlainMesh(path), Error) << length;
  }
  std::string wild = whole;
  wild[wild.size() - 1] = 1;  // the last number of a vertex
  std::ofstream(path, std::ios::binary) << wild;
  EXPECT_THROW(readPlainMesh(path), Error);
  wild = whole;
  wild[7] = '\x7f';  // an enormous count
  std::ofstream(path, std::ios::binary) << wild;
  EXPECT_THROW(readPlainMesh(path), Error);
  EXPECT_THROW(readPlainMesh(folder.file("missing")), Error);
  EXPECT_THROW(writePlainMesh(mesh, folder.file("no/folder")), Error);
}

}  // namespace
}  // namespace isobrick
