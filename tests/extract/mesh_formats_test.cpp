// Queries that mesh files refuse, and files after a failure. That each format holds what the PLY of
// the same query holds is compared by tests/tools/interchange/mesh_formats.py.
#include "isobrick/extract/sinks/mesh_formats.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/meshopt_chunk.h"
#include "tests/support/cancelled_group.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr const char* kNames[] = {"mesh.ply", "mesh.stl", "mesh.obj",
                                  "mesh.glb", "mesh.vtp", "mesh.3mf"};

class MeshFormatsTest : public ::testing::Test {
 protected:
  template <typename T = float>
  std::string build(const char* name, const Index3& dims, const Field& field,
                    const GridGeometry& geometry = {}) {
    BuildOptions options;
    options.brick_cells = 16;
    return buildField<T>(folder_, dims, field, options, geometry, name);
  }
  std::size_t filesLeft() const {
    const std::filesystem::directory_iterator files(folder_.path()), end;
    return static_cast<std::size_t>(std::distance(files, end));
  }
  // How many times a batch can be placed before the sink refuses it, and with what words.
  static std::uint64_t placesUntilRefused(MeshFileSink& sink, PlacedBatch& placed,
                                          std::string& why) {
    sink.begin({});
    for (std::uint64_t count = 0;; ++count) {
      try {
        sink.place(placed);
      } catch (const Error& error) {
        why = error.what();
        return count;
      }
    }
  }

  const TemporaryFolder folder_;
};

// A group of TBB tasks that is cancelled is no reason to write half a mesh: only the query's flag
// is.
TEST_F(MeshFormatsTest, FilesAreWholeInsideACancelledGroup) {
  const Pyramid pyramid(build("ball.isb", {70, 70, 70}, [](const glm::dvec3& p) {
    return 30 - glm::length(p - glm::dvec3(34.3, 35.1, 33.7));
  }));
  for (const char* name : kNames)
    for (const bool is_packed : {false, true}) {
      const std::string ending = std::string(name).substr(4);
      if (is_packed && ending != ".vtp" && ending != ".glb") continue;
      const auto bytesOf = [&](const char* stem) {
        const std::string path = folder_.file(stem + ending);
        const auto sink = makeMeshFileSink(path, {.zlib = is_packed && ending == ".vtp",
                                                  .meshopt = is_packed && ending == ".glb"});
        extractIsosurface(pyramid, Query{}, *sink);
        return readBytes(path);
      };
      const std::string whole = bytesOf("whole");
      runInCancelledGroup([&] {
        EXPECT_TRUE(bytesOf("inside") == whole) << name << (is_packed ? ", packed" : "");
      });
    }
}

TEST_F(MeshFormatsTest, GlbEndsAtFourGigabytesAndSaysTheWayOut) {
  PlacedBatch placed;
  placed.batch.positions.resize(1000);
  placed.batch.normals.resize(1000);
  placed.batch.triangles.resize(3 << 20);
  std::string why;
  const auto sink = makeMeshFileSink(folder_.file("mesh.glb"));
  const std::uint64_t places = placesUntilRefused(*sink, placed, why);
  constexpr std::uint64_t kBatchBytes = 1000 * 24 + (std::uint64_t{12} << 20);
  EXPECT_EQ(places, std::numeric_limits<std::uint32_t>::max() / kBatchBytes);
  EXPECT_NE(why.find("write .vtp or .ply instead"), std::string::npos) << why;
  EXPECT_EQ(why.find('\n'), std::string::npos);
}

// The same limit of packed files, from one that small meshes reach.
TEST_F(MeshFormatsTest, PackedGlbEndsWhereItsLimitIsAndLeavesNothing) {
  const Pyramid pyramid(build("ball.isb", {40, 40, 40}, [](const glm::dvec3& p) {
    return 15 - glm::length(p - glm::dvec3(19.3, 20.1, 18.7));
  }));
  const auto extract = [&](std::uint64_t most_bytes) {
    const auto sink = makeMeshoptSink(folder_.file("mesh.glb"), {.meshopt = true}, most_bytes);
    extractIsosurface(pyramid, Query{}, *sink);
    return readBytes(folder_.file("mesh.glb")).size();
  };
  const std::uint64_t whole = extract(kMostGlbBytes);
  EXPECT_EQ(extract(whole), whole);
  std::filesystem::remove(folder_.file("mesh.glb"));
  for (const std::uint64_t most : {whole - 1, whole / 2, std::uint64_t{100}}) {
    try {
      extract(most);
      ADD_FAILURE() << most;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("write .vtp or .ply instead"), std::string::npos);
      EXPECT_TRUE(error.remedies().empty()) << error.what();
    }
    EXPECT_EQ(filesLeft(), 1u);
  }
}

TEST_F(MeshFormatsTest, ALatticeReachesAllOfItsVolumeWithTwentyFourBits) {
  for (const std::int64_t voxels : {2, 100, 500, 5000, 1 << 20})
    for (const double far : {0.0, 1e7}) {
      MeshFrame frame;
      frame.voxels = {voxels, 2 + voxels / 3, 2};
      frame.geometry.spacing = {0.7, 0.4, 1.5};
      frame.geometry.origin = {-far, 3, 2 * far};
      const double s = std::sqrt(0.5);
      frame.geometry.direction = glm::dmat3(s, s, 0, -s, s, 0, 0, 0, -1);
      const PositionLattice lattice = PositionLattice::of(frame);
      if (voxels <= 500) {
        EXPECT_LE(lattice.step(), 0.4 / 8192);
      }
      for (int corner = 0; corner < 8; ++corner) {
        const glm::dvec3 at(corner & 1, corner >> 1 & 1, corner >> 2);
        const glm::dvec3 world =
            frame.geometry.indexToWorld(at * glm::dvec3(frame.voxels - Index3(1)));
        const glm::i32vec3 point = lattice.nearest(world);
        for (int axis = 0; axis < 3; ++axis) {
          EXPECT_LT(std::abs(point[axis]), (1 << 23) - 1);
          const double back = lattice.center[axis] + point[axis] * lattice.step();
          EXPECT_NEAR(back, world[axis], 0.501 * lattice.step()) << voxels << " " << far;
        }
      }
    }
}

TEST_F(MeshFormatsTest, NumbersOfVerticesHaveThirtyTwoBits) {
  PlacedBatch placed;
  placed.batch.positions.resize(1 << 20);
  for (const char* name : {"mesh.ply", "mesh.obj", "mesh.vtp"}) {
    std::string why;
    const auto sink = makeMeshFileSink(folder_.file(name));
    EXPECT_EQ(placesUntilRefused(*sink, placed, why), 4095u) << name;
    EXPECT_NE(why.find("coarser level"), std::string::npos) << why;
  }
}

// The wide form of the same mesh, from a limit that small meshes reach.
TEST_F(MeshFormatsTest, VtpTurnsToWideIndicesWhereNarrowOnesEnd) {
  const Pyramid pyramid(build("ball.isb", {40, 40, 40}, [](const glm::dvec3& p) {
    return 15 - glm::length(p - glm::dvec3(19.3, 20.1, 18.7));
  }));
  const auto extract = [&](std::uint64_t most_narrow, bool zlib) {
    const auto sink = makeVtpSink(folder_.file("mesh.vtp"), {.zlib = zlib}, most_narrow);
    const ExtractionReport report = extractIsosurface(pyramid, Query{}, *sink);
    EXPECT_GT(report.triangles, 1000u);
    return std::pair(readBytes(folder_.file("mesh.vtp")), report.triangles);
  };
  const auto [narrow, triangles] = extract(1 << 30, false);
  const auto [wide, same] = extract(3 * triangles - 1, false);
  EXPECT_EQ(extract(3 * triangles, false).first, narrow);
  EXPECT_EQ(extract(100, false).first, wide);
  // Where an array begins, behind its size.
  const auto arrayOf = [](const std::string& file, const std::string& name) {
    const std::size_t named = file.find("Name=\"" + name + "\"");
    const std::size_t offset = file.find("offset=\"", named) + 8;
    return file.find("<AppendedData encoding=\"raw\">\n_") + 31 + std::stoull(file.substr(offset)) +
           8;
  };
  EXPECT_EQ(narrow.find("\"Int64\""), std::string::npos);
  EXPECT_EQ(wide.find("\"Int32\""), std::string::npos);
  EXPECT_EQ(wide.size() - narrow.size(), 16 * triangles);
  for (const char* name : {"connectivity", "offsets"}) {
    const std::size_t in_narrow = arrayOf(narrow, name), in_wide = arrayOf(wide, name);
    for (std::uint64_t i = 0; i < triangles; ++i) {
      std::int32_t small = 0;
      std::int64_t large = 0;
      std::memcpy(&small, narrow.data() + in_narrow + i * sizeof small, sizeof small);
      std::memcpy(&large, wide.data() + in_wide + i * sizeof large, sizeof large);
      ASSERT_EQ(small, large) << name << " " << i;
    }
  }
  EXPECT_LT(extract(100, true).first.size(), wide.size() / 2);
}

TEST_F(MeshFormatsTest, WhatFailsLeavesNothing) {
  struct FailingValues : VertexValues {
    void evaluate(std::span<const glm::dvec3>, std::span<const glm::vec3>,
                  std::span<double>) const override {
      throw Error("no values today");
    }
  };
  const FailingValues failing;
  const Pyramid pyramid(build("ball.isb", {20, 20, 20},
                              [](const glm::dvec3& p) { return 7 - glm::length(p - 9.5); }));
  for (const char* name : kNames) {
    { const auto sink = makeMeshFileSink(folder_.file(name)); }
    {
      const auto sink = makeMeshFileSink(folder_.file(name));
      sink->begin({});
    }
    MeshFileOptions options{.attributes = {{.values = &failing}}};
    const std::string end = std::filesystem::path(name).extension();
    if (end == ".stl" || end == ".obj" || end == ".3mf") {
      EXPECT_THROW(makeMeshFileSink(folder_.file(name), options), Error);
      continue;
    }
    for (const bool meshopt : {false, true}) {
      options.meshopt = meshopt;
      if (meshopt && end != ".glb") {
        EXPECT_THROW(makeMeshFileSink(folder_.file(name), options), Error);
        continue;
      }
      const auto sink = makeMeshFileSink(folder_.file(name), options);
      EXPECT_THROW(extractIsosurface(pyramid, Query{}, *sink), Error) << name;
    }
  }
  EXPECT_EQ(filesLeft(), 1u);
  EXPECT_THROW(makeMeshFileSink(folder_.file("mesh.glb"), {.zlib = true}), Error);
  EXPECT_THROW(makeMeshFileSink(folder_.file("none/mesh.glb")), Error);
}

// Against the same formula on the array itself, through a turned and mirrored geometry.
TEST_F(MeshFormatsTest, ValuesAreInterpolatedWhereThePyramidIs) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 2, 1.25};
  geometry.origin = {-100, 50, 7};
  geometry.direction = glm::dmat3(0, 1, 0, -1, 0, 0, 0, 0, -1);
  const Index3 dims(37, 20, 18);
  const auto field = [](const glm::dvec3& p) {
    return std::fmod(13 * p.x + 29 * p.y + 71 * p.z, 101) - 50;
  };
  const Pyramid pyramid(build<std::int16_t>("other.isb", dims, field, geometry));
  const PyramidValues values(pyramid);
  std::vector<glm::dvec3> world;
  std::vector<double> expected;
  for (std::int64_t i = 0; i < 4000; ++i) {
    const double s = static_cast<double>(i);
    // Halves of voxels and sixteenths, on both sides of every border.
    const glm::dvec3 index(std::fmod(s * 7 / 16, 41) - 2, std::fmod(s * 11 / 8, 24) - 2,
                           std::fmod(s * 3 / 4, 22) - 2);
    world.push_back(geometry.indexToWorld(index));
    const glm::dvec3 inside = glm::clamp(index, glm::dvec3(0), glm::dvec3(dims - Index3(1)));
    const glm::dvec3 away = glm::abs(index - inside);
    if (std::max({away.x, away.y, away.z}) > 0.5) {
      expected.push_back(std::nan(""));
      continue;
    }
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      double weight = 1;
      glm::dvec3 at;
      for (int axis = 0; axis < 3; ++axis) {
        const double low = std::min(std::floor(inside[axis]), static_cast<double>(dims[axis] - 2));
        const double t = inside[axis] - low;
        at[axis] = low + (corner >> axis & 1);
        weight *= (corner >> axis & 1) != 0 ? t : 1 - t;
      }
      sum += weight * std::trunc(field(at));
    }
    expected.push_back(sum);
  }
  std::vector<double> found(world.size());
  values.evaluate(world, {}, found);
  std::uint64_t outside = 0;
  for (std::size_t i = 0; i < world.size(); ++i) {
    ASSERT_EQ(std::isnan(found[i]), std::isnan(expected[i])) << i;
    if (std::isnan(expected[i]))
      ++outside;
    else
      ASSERT_NEAR(found[i], expected[i], 1e-3) << i;
  }
  EXPECT_EQ(values.outside(), outside);
  EXPECT_GT(outside, 100u);
  EXPECT_LT(outside, 2000u);
}

// A vertex that is no number, or far out of all ranges, has no value and does no harm.
TEST_F(MeshFormatsTest, PlacesThatAreNowhereHaveNoValue) {
  const Pyramid pyramid(build("other.isb", {4, 5, 6}, [](const glm::dvec3& p) { return p.x; }));
  const PyramidValues values(pyramid);
  const double infinity = std::numeric_limits<double>::infinity();
  const glm::dvec3 world[] = {{std::nan(""), 1, 1}, {1, infinity, 1}, {1, 1, -infinity},
                              {1e300, 1, 1},        {1, -1e300, 1},   {1, 1, 1}};
  double found[6];
  values.evaluate(world, {}, found);
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(std::isnan(found[i])) << i;
  EXPECT_EQ(found[5], 1);
}

}  // namespace
}  // namespace isobrick::test
