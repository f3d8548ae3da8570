// The sanity of the test oracle itself: the reference mesher's meshes obey rule 11 on random
// volumes and queries, analytic fields come out right, and the mesh checker finds planted faults.
//
// ISOBRICK_REFERENCE_CASES sets the number of random cases, ISOBRICK_REFERENCE_SEED the first seed.

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <glm/geometric.hpp>
#include <numbers>
#include <set>
#include <sstream>
#include <string>

#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/ply_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/reference_mesher.h"
#include "tests/support/reference_pyramid.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

template <typename F>
std::vector<float> sampleField(const Index3& dims, F&& field) {
  std::vector<float> voxels;
  for (std::int64_t z = 0; z < dims.z; ++z) {
    for (std::int64_t y = 0; y < dims.y; ++y) {
      for (std::int64_t x = 0; x < dims.x; ++x) {
        voxels.push_back(static_cast<float>(field(glm::dvec3(x, y, z))));
      }
    }
  }
  return voxels;
}

// ---- Random cases -------------------------------------------------------------------------------

struct ReferenceCase {
  ReferencePyramid pyramid;
  ReferenceQuery query;
  LeafLevels leaves;  // of the query, or random ones
  std::string description;
};

template <typename T>
std::vector<T> randomIntegers(Random& random, std::size_t count, std::int64_t spread) {
  const std::int64_t least = std::numeric_limits<T>::min();
  const std::int64_t most = std::numeric_limits<T>::max();
  const std::int64_t low = randomInt(random, least, std::max(least, most - spread));
  std::vector<T> voxels(count);
  for (T& voxel : voxels) {
    voxel = static_cast<T>(randomInt(random, low, std::min(low + spread, most)));
  }
  return voxels;
}

// Values that stress different rules: few values (plateaus, exact hits of the isovalue), floats a
// few units in the last place apart (means are rounded), infinities and NaN, smooth fields, noise.
ReferencePyramid randomPyramid(Random& random, const Index3& dims, std::ostream& description) {
  const auto count = static_cast<std::size_t>(elementCount(dims));
  const auto filter =
      randomInt(random, 0, 3) == 0 ? ReferenceFilter::kSubsample : ReferenceFilter::kAverage;
  const std::int64_t spread =
      randomInt(random, 0, 1) == 0 ? randomInt(random, 1, 4) : randomInt(random, 5, 70000);
  const std::int64_t kind = randomInt(random, 0, 8);
  description << " kind " << kind << " spread " << spread
              << (filter == ReferenceFilter::kSubsample ? " subsampled" : "");
  if (kind == 0) {
    const auto v = randomIntegers<std::uint8_t>(random, count, spread);
    return buildReferencePyramid<std::uint8_t>(dims, v, filter);
  }
  if (kind == 1) {
    const auto v = randomIntegers<std::int8_t>(random, count, spread);
    return buildReferencePyramid<std::int8_t>(dims, v, filter);
  }
  if (kind == 2) {
    const auto v = randomIntegers<std::uint16_t>(random, count, spread);
    return buildReferencePyramid<std::uint16_t>(dims, v, filter);
  }
  if (kind == 3) {
    const auto v = randomIntegers<std::int16_t>(random, count, spread);
    return buildReferencePyramid<std::int16_t>(dims, v, filter);
  }

  std::vector<float> v(count);
  if (kind == 4) {
    const float base = static_cast<float>(randomReal(random, 0.5, 2.0));
    for (float& voxel : v) {
      const auto steps =
          static_cast<std::uint32_t>(randomInt(random, 0, std::min<std::int64_t>(spread, 9)));
      voxel = std::bit_cast<float>(std::bit_cast<std::uint32_t>(base) + steps);
    }
  } else if (kind == 5) {
    for (float& voxel : v) voxel = static_cast<float>(randomReal(random, -1, 1));
  } else if (kind == 6) {
    for (float& voxel : v) voxel = static_cast<float>(randomInt(random, 0, 2));
  } else if (kind == 7) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    const float choices[] = {-kInfinity,
                             kInfinity,
                             std::nanf(""),
                             0,
                             1,
                             -1,
                             std::numeric_limits<float>::max(),
                             std::numeric_limits<float>::lowest()};
    const std::int64_t rare = randomInt(random, 0, 3);
    for (float& voxel : v) {
      voxel = randomInt(random, 0, rare) == 0 ? choices[randomInt(random, 0, 7)]
                                              : static_cast<float>(randomInt(random, 0, 2));
    }
  } else {
    const glm::dvec3 wave(randomReal(random, -2, 2), randomReal(random, -2, 2),
                          randomReal(random, -2, 2));
    const double shift = randomReal(random, 0, 6);
    v = sampleField(dims, [&](const glm::dvec3& p) {
      return std::sin(wave.x * p.x) * std::cos(wave.y * p.y + shift) + std::sin(wave.z * p.z);
    });
  }
  return buildReferencePyramid<float>(dims, v, filter);
}

// Any octree whose touching leaves differ by at most one level: what some further oracle may yield.
// More than focus and flatness do, it has neighbours that are finer only across an edge or corner.
LeafLevels randomBalancedLeaves(Random& random, const Lattice& lattice) {
  LeafLevels leaves{lattice.cells(0), {}};
  leaves.levels.assign(static_cast<std::size_t>(elementCount(leaves.cells)),
                       static_cast<std::int8_t>(lattice.levels() - 1));
  const auto split = [&](const Index3& leaf, int level) {
    const Index3 lower = lattice.position(level, leaf);
    const Index3 upper = lattice.position(level, leaf + Index3(1));
    for (std::int64_t z = lower.z; z < upper.z; ++z) {
      for (std::int64_t y = lower.y; y < upper.y; ++y) {
        for (std::int64_t x = lower.x; x < upper.x; ++x) {
          leaves.levels[static_cast<std::size_t>((z * leaves.cells.y + y) * leaves.cells.x + x)] =
              static_cast<std::int8_t>(level - 1);
        }
      }
    }
  };
  for (std::int64_t i = randomInt(random, 1, 12); i > 0; --i) {
    Index3 cell;
    for (int axis = 0; axis < 3; ++axis) {
      cell[axis] = randomInt(random, 0, leaves.cells[axis] - 1);
    }
    const int wanted = static_cast<int>(randomInt(random, 0, 2));
    for (int level = leaves.leafLevelAt(cell); level > wanted; --level) {
      split(cell >> Index3(level), level);
    }
  }
  for (auto conflicts = auditLeafLevels(leaves); !conflicts.empty();
       conflicts = auditLeafLevels(leaves)) {
    for (const LeafConflict& conflict : conflicts) {
      // An earlier conflict of this round may have split it already.
      if (leaves.leafLevelAt(lattice.position(conflict.level_a, conflict.cell_a)) ==
          conflict.level_a) {
        split(conflict.cell_a, conflict.level_a);
      }
    }
  }
  return leaves;
}

ReferenceCase referenceCase(std::uint64_t seed) {
  Random random(seed);
  std::ostringstream description;
  const std::int64_t most_dim = randomInt(random, 0, 9) == 0 ? 33 : randomInt(random, 3, 20);
  Index3 dims;
  for (int axis = 0; axis < 3; ++axis) dims[axis] = randomInt(random, 2, most_dim);
  description << "seed " << seed << " dims " << dims.x << "x" << dims.y << "x" << dims.z;

  ReferenceCase result;
  result.pyramid = randomPyramid(random, dims, description);
  const Lattice& lattice = result.pyramid.lattice;

  ReferenceQuery& query = result.query;
  if (randomInt(random, 0, 1) == 0) {
    const auto& level =
        result.pyramid.levels[static_cast<std::size_t>(randomInt(random, 0, lattice.levels() - 1))];
    query.iso = static_cast<double>(level[static_cast<std::size_t>(
        randomInt(random, 0, static_cast<std::int64_t>(level.size()) - 1))]);
  } else {
    const auto& level = result.pyramid.levels[0];
    const auto [low, high] = std::minmax_element(level.begin(), level.end());
    query.iso = std::isfinite(*low) && std::isfinite(*high) && *high - *low < 1e6f
                    ? randomReal(random, static_cast<double>(*low), static_cast<double>(*high))
                    : randomReal(random, -1, 2);
    if (randomInt(random, 0, 2) == 0) query.iso = std::floor(query.iso) + 0.5;
  }
  const std::int64_t mode = randomInt(random, 0, 9);
  if (mode == 0) {
    query.level = static_cast<int>(randomInt(random, 0, lattice.levels()));
  } else if (mode > 1) {
    glm::dvec3 focus;
    for (int axis = 0; axis < 3; ++axis) {
      focus[axis] = randomReal(random, -4, static_cast<double>(dims[axis]) + 3);
      if (randomInt(random, 0, 1) == 0) focus[axis] = std::round(focus[axis]);
    }
    query.focus = focus;
    query.radius = randomReal(random, 0, 1) * randomReal(random, 0, static_cast<double>(most_dim));
    if (randomInt(random, 0, 9) == 0) query.radius = -query.radius;
    if (randomInt(random, 0, 3) == 0) query.radius = 0;
  }
  if (randomInt(random, 0, 1) == 0) {
    const auto salt = static_cast<std::uint64_t>(randomInt(random, 0, 1 << 30));
    const auto quarters = static_cast<std::uint64_t>(randomInt(random, 1, 3));
    query.flat = [salt, quarters](const Index3& c) {
      auto h = salt + static_cast<std::uint64_t>(c.x * 73856093 + c.y * 19349663 + c.z * 83492791);
      h = (h ^ (h >> 33)) * 0xff51afd7ed558ccdull;
      return (h ^ (h >> 33)) % 4 < quarters;
    };
  }
  if (randomInt(random, 0, 2) == 0) {
    description << " random leaves instead of";
    result.leaves = randomBalancedLeaves(random, lattice);
  } else {
    result.leaves = referenceLeafLevels(lattice, query);
  }
  description.precision(17);
  description << " iso " << query.iso << " level " << query.level;
  if (query.focus) {
    description << " focus " << query.focus->x << "," << query.focus->y << "," << query.focus->z
                << " radius " << query.radius;
  }
  description << (query.flat ? " flat" : "");
  result.description = description.str();
  return result;
}

// The reference's counts agree with its lists.
void expectConsistent(const ReferenceMesh& mesh) {
  EXPECT_TRUE(std::is_sorted(mesh.crossings.begin(), mesh.crossings.end()));
  std::int64_t triangles = 0;
  for (const ReferenceLevelCounts& counts : mesh.level_counts) {
    triangles += counts.triangles;
    EXPECT_LE(counts.transition_cells, counts.cells);
    EXPECT_LE(counts.cells, counts.leaves);
  }
  EXPECT_EQ(triangles, mesh.triangleCount());
  EXPECT_EQ(mesh.triangle_levels.size() * 3, mesh.triangles.size());
  for (const ReferenceCrossing& crossing : mesh.crossings) {
    EXPECT_NEAR(glm::length(crossing.normal), 1.0, 3e-7);
  }
}

TEST(ReferenceMesher, RandomMeshesAreClosedOrientedManifolds) {
  const int cases = repetitions(2000);
  const int first = environmentOr("ISOBRICK_REFERENCE_SEED", 1);
  std::int64_t transition_cells = 0, centres = 0, triangles = 0, duplicates = 0;
  double smallest_area = 1;
  int failures = 0;
  for (int seed = first; seed < first + cases && failures < 5; ++seed) {
    const ReferenceCase c = referenceCase(static_cast<std::uint64_t>(seed));
    SCOPED_TRACE(c.description);
    try {
      EXPECT_TRUE(auditLeafLevels(c.leaves).empty());
      const ReferenceMesh mesh = referenceMesh(c.pyramid, c.leaves, c.query.iso);
      expectConsistent(mesh);
      const MeshReport report =
          checkMesh(mesh.positions, mesh.triangles, indexOptions(c.pyramid.lattice.voxels()));
      EXPECT_TRUE(report.ok()) << report.summary();
      failures += !report.ok();
      const std::vector<glm::vec3> floats(mesh.positions.begin(), mesh.positions.end());
      const MeshReport float_report =
          checkMesh(floats, mesh.triangles, indexOptions(c.pyramid.lattice.voxels()));
      EXPECT_TRUE(float_report.ok()) << "as floats: " << float_report.summary();
      failures += !float_report.ok();
      transition_cells += mesh.transitionCellCount();
      centres += mesh.centreCount();
      triangles += mesh.triangleCount();
      duplicates += report.duplicate_positions;
      if (mesh.triangleCount() > 0) smallest_area = std::min(smallest_area, report.smallest_area);
    } catch (const std::exception& e) {
      ADD_FAILURE() << e.what();
      ++failures;
    }
  }
  RecordProperty("triangles", std::to_string(triangles));
  std::cout << triangles << " triangles, " << transition_cells << " cells with fans, " << centres
            << " of these around centres, smallest area " << smallest_area << ", " << duplicates
            << " duplicate positions\n";
  if (cases > 100) {
    EXPECT_GT(transition_cells, cases);
    EXPECT_GT(centres, cases / 20);
  }
}

// ---- Pyramid ------------------------------------------------------------------------------------

TEST(ReferencePyramid, RoundsOnceAndLeavesBordersAlone) {
  // 5 x 2 x 2: only x has samples with two neighbours.
  std::vector<std::int8_t> voxels;
  for (int row = 0; row < 4; ++row) {
    for (const int v : {-3, 0, -1, 1, 7}) voxels.push_back(static_cast<std::int8_t>(v));
  }
  const auto pyramid = buildReferencePyramid<std::int8_t>({5, 2, 2}, voxels);
  ASSERT_EQ(pyramid.lattice.levels(), 3);
  ASSERT_EQ(pyramid.levels[1].size(), 12u);
  EXPECT_EQ(pyramid.sampleAt(1, {0, 0, 0}), -3);
  EXPECT_EQ(pyramid.sampleAt(1, {1, 0, 0}), 0);  // (0 - 2 + 1) / 4 = -0.25
  EXPECT_EQ(pyramid.sampleAt(1, {2, 0, 0}), 7);
  EXPECT_EQ(pyramid.sampleAt(2, {1, 1, 1}), 7);

  const std::vector<std::int8_t> halves = {0, -1, 0, 0, -1, 0, 0, -1, 0, 0, -1, 0};
  const auto half = buildReferencePyramid<std::int8_t>({3, 2, 2}, halves);
  EXPECT_EQ(half.sampleAt(1, {0, 0, 0}), 0);
  const std::vector<std::int8_t> up = {0, 0, -2, -2, -2, 0, 0, 0, -2, -2, -2, 0,
                                       0, 0, -2, -2, -2, 0, 0, 0, -2, -2, -2, 0};
  // Sample 2 of 6: (0 - 4 - 2) / 4 = -1.5 rounds up to -1.
  EXPECT_EQ(buildReferencePyramid<std::int8_t>({6, 2, 2}, up).sampleAt(1, {1, 0, 0}), -1);
}

TEST(ReferencePyramid, ClampedNeighbourIsNotFiltered) {
  // 8 voxels: level 1 sits at 0 2 4 6 7; its sample 3 has a clamped right neighbour, so level 2's
  // samples at 4 (neighbours 2 and 6) is filtered, and the one at 7 is the last voxel.
  std::vector<std::uint8_t> voxels;
  for (int row = 0; row < 4; ++row) {
    for (const int v : {0, 0, 0, 0, 100, 0, 0, 60}) voxels.push_back(static_cast<std::uint8_t>(v));
  }
  const auto pyramid = buildReferencePyramid<std::uint8_t>({8, 2, 2}, voxels);
  EXPECT_EQ(pyramid.sampleAt(1, {2, 0, 0}), 50);
  EXPECT_EQ(pyramid.sampleAt(1, {3, 0, 0}), 15);  // (0 + 0 + 60) / 4
  EXPECT_EQ(pyramid.sampleAt(1, {4, 0, 0}), 60);
  EXPECT_EQ(pyramid.sampleAt(2, {1, 0, 0}), 29);  // (0 + 100 + 15) / 4 = 28.75
  EXPECT_EQ(pyramid.sampleAt(2, {2, 0, 0}), 60);
}

TEST(ReferencePyramid, LinearFieldsAreExactOnAllLevels) {
  for (const Index3 dims : {Index3(17, 9, 5), Index3(18, 7, 2), Index3(11, 13, 20)}) {
    const auto field = [](const glm::dvec3& p) { return 3.0 + 2.0 * p.x - 5.0 * p.y + 0.5 * p.z; };
    const auto pyramid = buildReferencePyramid<float>(dims, sampleField(dims, field));
    for (int level = 0; level < pyramid.lattice.levels(); ++level) {
      const Index3 samples = pyramid.lattice.samples(level);
      for (std::int64_t z = 0; z < samples.z; ++z) {
        for (std::int64_t y = 0; y < samples.y; ++y) {
          for (std::int64_t x = 0; x < samples.x; ++x) {
            const glm::dvec3 p(pyramid.lattice.position(level, Index3(x, y, z)));
            ASSERT_EQ(pyramid.sampleAt(level, {x, y, z}), static_cast<float>(field(p)));
          }
        }
      }
    }
  }
}

// ---- Leaves -------------------------------------------------------------------------------------

TEST(ReferenceLeaves, AuditFindsAJumpAcrossACorner) {
  const Lattice lattice({9, 9, 9});
  ReferenceQuery query;
  query.level = 1;
  LeafLevels leaves = referenceLeafLevels(lattice, query);
  EXPECT_TRUE(auditLeafLevels(leaves).empty());
  // One level-2 leaf at the origin and one level-0 cell that touches only its corner (4,4,4).
  auto set = [&](const Index3& c, std::int8_t level) {
    leaves.levels[static_cast<std::size_t>((c.z * 8 + c.y) * 8 + c.x)] = level;
  };
  for (int i = 0; i < 64; ++i) set({i % 4, i / 4 % 4, i / 16}, 2);
  EXPECT_TRUE(auditLeafLevels(leaves).empty());
  for (int i = 0; i < 8; ++i) set({4 + i % 2, 4 + i / 2 % 2, 4 + i / 4}, 0);
  const auto conflicts = auditLeafLevels(leaves);
  ASSERT_EQ(conflicts.size(), 1u);
  EXPECT_EQ(conflicts[0].level_a, 2);
  EXPECT_EQ(conflicts[0].cell_b, Index3(4, 4, 4));
}

TEST(ReferenceLeaves, NoFocusIsFinestAndUniformLevelIsUniform) {
  const Lattice lattice({20, 11, 6});
  ReferenceQuery query;
  for (const std::int8_t level : referenceLeafLevels(lattice, query).levels) ASSERT_EQ(level, 0);
  query.level = 3;
  for (const std::int8_t level : referenceLeafLevels(lattice, query).levels) ASSERT_EQ(level, 3);
  query.level = 99;
  for (const std::int8_t level : referenceLeafLevels(lattice, query).levels) ASSERT_EQ(level, 5);
}

TEST(ReferenceLeaves, FocusRefinesExactlyWhereTheProfileIsBelowTheLevel) {
  const Lattice lattice({40, 40, 40});
  ReferenceQuery query;
  query.focus = glm::dvec3(12.3, 20.1, 17.7);
  query.radius = 3.5;
  const LeafLevels leaves = referenceLeafLevels(lattice, query);
  std::set<int> seen;
  for (std::int64_t i = 0; i < 39 * 39 * 39; ++i) {
    const Index3 cell(i % 39, i / 39 % 39, i / (39 * 39));
    const int level = leaves.leafLevelAt(cell);
    seen.insert(level);
    // f of the leaf and of its parent, as the paper states it.
    auto f = [&](int l) {
      const glm::dvec3 centre = (glm::dvec3(cell >> Index3(l)) + 0.5) * std::ldexp(1.0, l);
      const double d = std::numbers::sqrt3;
      const double s = std::max(glm::distance(centre, *query.focus) - query.radius, -d);
      return std::max(0.0, 1.0 + std::log2((s + d) / (3 * d)));
    };
    if (level > 0) {
      ASSERT_GE(f(level), level - 1e-5);
    }
    if (level + 1 < lattice.levels()) {
      ASSERT_LT(f(level + 1), level + 1 + 1e-5);
    }
  }
  EXPECT_EQ(*seen.begin(), 0);
  EXPECT_GE(seen.size(), 3u);
}

// ---- Analytic fields ----------------------------------------------------------------------------

TEST(ReferenceMesher, SphereHasItsVolumeAreaAndTopology) {
  const Index3 dims(33, 33, 33);
  const glm::dvec3 centre(16.1, 15.8, 16.3);
  const auto field = [&](const glm::dvec3& p) { return -glm::distance(p, centre); };
  const auto pyramid = buildReferencePyramid<float>(dims, sampleField(dims, field));
  const double r = 11.3;
  for (const bool adaptive : {false, true}) {
    ReferenceQuery query;
    query.iso = -r;
    if (adaptive) {
      query.focus = glm::dvec3(27, 16, 16);
      query.radius = 10;
    }
    const ReferenceMesh mesh = referenceMesh(pyramid, query);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(dims));
    ASSERT_TRUE(report.ok()) << report.summary();
    EXPECT_EQ(report.border_edges, 0);
    EXPECT_EQ(report.genus, 0);
    EXPECT_EQ(report.components, 1);
    const double volume = 4.0 / 3.0 * std::numbers::pi * r * r * r;
    const double area = 4.0 * std::numbers::pi * r * r;
    EXPECT_NEAR(report.volume / volume, 1.0, adaptive ? 0.08 : 0.01);
    EXPECT_NEAR(report.area / area, 1.0, adaptive ? 0.06 : 0.01);
    EXPECT_EQ(mesh.transitionCellCount() > 0, adaptive);
    for (const ReferenceCrossing& crossing : mesh.crossings) {
      const glm::dvec3 outward = glm::normalize(crossing.point() - centre);
      ASSERT_GT(glm::dot(crossing.normal, outward), adaptive ? 0.8 : 0.99);
    }
  }
}

TEST(ReferenceMesher, TorusHasAHole) {
  const Index3 dims(33, 31, 17);
  const auto field = [](const glm::dvec3& p) {
    const glm::dvec3 q = p - glm::dvec3(16, 15.2, 7.9);
    return 4.0 - std::hypot(std::hypot(q.x, q.y) - 9.0, q.z);
  };
  const auto pyramid = buildReferencePyramid<float>(dims, sampleField(dims, field));
  ReferenceQuery query;
  const ReferenceMesh mesh = referenceMesh(pyramid, query);
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
  ASSERT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.genus, 1);
  EXPECT_EQ(report.euler, 0);
  EXPECT_NEAR(report.volume / (2 * std::numbers::pi * std::numbers::pi * 9 * 16), 1.0, 0.02);
}

// A plane is met exactly on every level, thin last cells included: all vertices are on it, the
// normals are its normal, and overlaps or folds would show in the area.
TEST(ReferenceMesher, PlanesAreExactOnAllLevels) {
  Random random(7);
  for (int i = 0; i < 60; ++i) {
    const Index3 dims(randomInt(random, 6, 24), randomInt(random, 6, 24),
                      randomInt(random, 22, 33));
    const double slope_x = randomReal(random, -0.3, 0.3);
    const double slope_y = randomReal(random, -0.3, 0.3);
    const double height = 0.5 * static_cast<double>(dims.z - 1) + randomReal(random, -2, 2);
    const glm::dvec3 middle(0.5 * static_cast<double>(dims.x - 1),
                            0.5 * static_cast<double>(dims.y - 1), height);
    const auto field = [&](const glm::dvec3& p) {
      const glm::dvec3 q = p - middle;
      return slope_x * q.x + slope_y * q.y - q.z;
    };
    const auto pyramid = buildReferencePyramid<float>(dims, sampleField(dims, field));
    ReferenceQuery query;
    query.focus = glm::dvec3(randomReal(random, 0, 20), randomReal(random, 0, 20), height);
    query.radius = randomReal(random, 0, 5);
    const ReferenceMesh mesh = referenceMesh(pyramid, query);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(dims));
    ASSERT_TRUE(report.ok()) << report.summary();
    // Crossings kept away from lattice points may be off by a 4096th of an edge of at most 32.
    for (const glm::dvec3& p : mesh.positions) ASSERT_NEAR(field(p), 0.0, 32.0 / 4096.0);
    const double slant = std::sqrt(1 + slope_x * slope_x + slope_y * slope_y);
    const double ground = static_cast<double>((dims.x - 1) * (dims.y - 1));
    EXPECT_NEAR(report.area / (ground * slant), 1.0, 1e-3);
    const glm::dvec3 up = glm::dvec3(-slope_x, -slope_y, 1) / slant;
    for (const ReferenceCrossing& crossing : mesh.crossings) {
      ASSERT_GT(glm::dot(crossing.normal, up), 1 - 1e-6);
    }
  }
}

TEST(ReferenceMesher, FlatGradientNormalPointsFromInsideToOutside) {
  // Level 0: 5 0 5 along x; the central difference at the middle is 0, one-sided at the ends.
  const std::vector<float> voxels = {0, 5, 0, 0, 5, 0, 0, 5, 0, 0, 5, 0};
  const auto pyramid = buildReferencePyramid<float>({3, 2, 2}, voxels);
  ReferenceQuery query;
  query.iso = 5;  // equal to samples: t = 1 - 1/4096 and 1/4096
  const ReferenceMesh mesh = referenceMesh(pyramid, query);
  ASSERT_EQ(mesh.crossings.size(), 8u);
  EXPECT_EQ(mesh.triangleCount(), 4);
  EXPECT_EQ(mesh.crossings[0].t, 1.0 - 1.0 / 4096.0);
  EXPECT_EQ(mesh.crossings[0].normal, glm::dvec3(-1, 0, 0));
  EXPECT_EQ(mesh.crossings[1].t, 1.0 / 4096.0);
  EXPECT_EQ(mesh.crossings[1].normal, glm::dvec3(1, 0, 0));
  const std::vector<float> constant(12, 5.0f);
  EXPECT_EQ(referenceMesh(buildReferencePyramid<float>({3, 2, 2}, constant), query).triangleCount(),
            0);
}

// All 256 corner patterns of a single cell: the number of triangles is n - 2 per loop, and no
// diagonal is in a face (the triangulator throws if there is no way).
TEST(ReferenceMesher, AllPatternsOfOneCellAreTriangulated) {
  for (unsigned pattern = 0; pattern < 256; ++pattern) {
    std::vector<float> voxels;
    for (unsigned i = 0; i < 8; ++i) voxels.push_back((pattern >> i & 1u) != 0 ? 1.0f : 0.0f);
    const auto pyramid = buildReferencePyramid<float>({2, 2, 2}, voxels);
    ReferenceQuery query;
    query.iso = 0.5;
    const ReferenceMesh mesh = referenceMesh(pyramid, query);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions({2, 2, 2}));
    ASSERT_TRUE(report.ok()) << pattern << ": " << report.summary();
    EXPECT_EQ(mesh.triangleCount(),
              static_cast<std::int64_t>(mesh.crossings.size()) - 2 * report.components);
    EXPECT_EQ(report.components, report.border_loops);
  }
}

// Rule 9, and with it the winding: inside corners that touch only across a face's diagonal are cut
// off on their own; outside ones are joined.
TEST(ReferenceMesher, AmbiguousFacesKeepInsideCornersApart) {
  for (const bool inverted : {false, true}) {
    std::vector<float> voxels(8, inverted ? 1.0f : 0.0f);
    voxels[0] = voxels[3] = inverted ? 0.0f : 1.0f;  // (0,0,0) and (1,1,0)
    const auto pyramid = buildReferencePyramid<float>({2, 2, 2}, voxels);
    ReferenceQuery query;
    query.iso = 0.5;
    const ReferenceMesh mesh = referenceMesh(pyramid, query);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions({2, 2, 2}));
    EXPECT_TRUE(report.ok()) << report.summary();
    EXPECT_EQ(report.components, inverted ? 1 : 2);
    EXPECT_EQ(mesh.triangleCount(), inverted ? 4 : 2);
    const glm::dvec3 a = mesh.positions[mesh.triangles[0]];
    const glm::dvec3 b = mesh.positions[mesh.triangles[1]];
    const glm::dvec3 c = mesh.positions[mesh.triangles[2]];
    if (!inverted) {
      EXPECT_GT(glm::cross(b - a, c - a).z, 0);  // away from the inside, at z = 0
    }
  }
}

// Rule 6 by hand: level-1 leaves at x < 4, level-0 leaves beyond, in a 7 x 4 x 4 volume whose
// levels hold unrelated values. The last cells of level 1 along y and z are thin: 2 .. 3.
TEST(ReferenceMesher, ValuesDependOnThePointAlone) {
  const Index3 dims(7, 4, 4);
  auto pyramid =
      buildReferencePyramid<float>(dims, sampleField(dims, [](const glm::dvec3& p) {
                                     return 100 + p.x + 10 * p.y * p.y + 3 * p.z * p.z * p.z;
                                   }));
  for (std::size_t i = 0; i < pyramid.levels[1].size(); ++i) {
    pyramid.levels[1][i] = static_cast<float>(i * i % 31);
  }
  LeafLevels leaves{{6, 3, 3}, {}};
  for (int i = 0; i < 54; ++i) leaves.levels.push_back(i % 6 < 4 ? 1 : 0);
  EXPECT_TRUE(auditLeafLevels(leaves).empty());
  const auto fine = [&](int x, int y, int z) { return pyramid.sampleAt(0, {x, y, z}); };

  // Touched by level-1 leaves only, and by level-0 leaves only.
  EXPECT_EQ(referenceValue(pyramid, leaves, {2, 2, 0}), pyramid.sampleAt(1, {1, 1, 0}));
  EXPECT_EQ(referenceValue(pyramid, leaves, {2, 3, 3}), pyramid.sampleAt(1, {1, 2, 2}));
  EXPECT_EQ(referenceValue(pyramid, leaves, {5, 1, 1}), fine(5, 1, 1));
  // On the lattice of both: the finer level's value.
  EXPECT_EQ(referenceValue(pyramid, leaves, {4, 2, 2}), fine(4, 2, 2));
  EXPECT_EQ(referenceValue(pyramid, leaves, {4, 3, 0}), fine(4, 3, 0));
  // Hanging on an edge and on a face: means of the finer level's corners.
  EXPECT_EQ(referenceValue(pyramid, leaves, {4, 1, 2}), (fine(4, 0, 2) + fine(4, 2, 2)) / 2);
  EXPECT_EQ(referenceValue(pyramid, leaves, {4, 3, 1}), (fine(4, 3, 0) + fine(4, 3, 2)) / 2);
  EXPECT_EQ(referenceValue(pyramid, leaves, {4, 1, 1}),
            (fine(4, 0, 0) + fine(4, 2, 0) + fine(4, 0, 2) + fine(4, 2, 2)) / 4);

  // In a thin last cell the midpoint is not in the middle: level-2 leaves at x < 4 and y in 4 .. 7.
  const Index3 thin_dims(9, 8, 5);
  const auto thin = buildReferencePyramid<float>(
      thin_dims, sampleField(thin_dims, [](const glm::dvec3& p) { return p.y * p.y; }));
  LeafLevels thin_leaves{{8, 7, 4}, {}};
  for (int i = 0; i < 8 * 7 * 4; ++i) thin_leaves.levels.push_back(i % 8 < 4 ? 2 : 1);
  // Ends 4 and 7 of a level-2 edge; level 1 at (4, 4, 0) is (9 + 2 * 16 + 25) / 4 = 16.5.
  EXPECT_EQ(thin.sampleAt(1, {2, 2, 0}), 16.5f);
  EXPECT_EQ(referenceValue(thin, thin_leaves, {4, 6, 0}),
            static_cast<float>(16.5 + (2.0 / 3.0) * (49 - 16.5)));
}

// A segment inside the volume is walked once each way.
TEST(ReferenceMesher, SegmentsMatchAcrossCells) {
  for (std::uint64_t seed = 1; seed < 60; ++seed) {
    const ReferenceCase c = referenceCase(seed);
    const ReferenceMesh mesh = referenceMesh(c.pyramid, c.leaves, c.query.iso);
    const Index3 last = c.pyramid.lattice.voxels() - Index3(1);
    const std::set<std::array<std::uint32_t, 2>> segments(mesh.segments.begin(),
                                                          mesh.segments.end());
    ASSERT_EQ(segments.size(), mesh.segments.size()) << c.description;
    for (const auto& [a, b] : mesh.segments) {
      const glm::dvec3 p = mesh.crossings[a].point();
      const glm::dvec3 q = mesh.crossings[b].point();
      bool is_border = false;
      for (int axis = 0; axis < 3; ++axis) {
        const double end = static_cast<double>(last[axis]);
        is_border = is_border || (p[axis] == q[axis] && (p[axis] == 0 || p[axis] == end));
      }
      ASSERT_EQ(segments.count({b, a}), is_border ? 0u : 1u) << c.description;
    }
  }
}

// ---- The checker finds planted faults -----------------------------------------------------------

struct VertexList {
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> triangles;

  MeshReport check(const MeshCheckOptions& options = {}) const {
    return checkMesh(positions, triangles, options);
  }
};

VertexList octahedron(const glm::dvec3& centre = glm::dvec3(0)) {
  VertexList mesh;
  for (const glm::dvec3 p : {glm::dvec3(1, 0, 0), glm::dvec3(-1, 0, 0), glm::dvec3(0, 1, 0),
                             glm::dvec3(0, -1, 0), glm::dvec3(0, 0, 1), glm::dvec3(0, 0, -1)}) {
    mesh.positions.push_back(p + centre);
  }
  mesh.triangles = {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5};
  return mesh;
}

void append(VertexList& mesh, const VertexList& other) {
  const auto offset = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), other.positions.begin(), other.positions.end());
  for (const std::uint32_t index : other.triangles) mesh.triangles.push_back(index + offset);
}

TEST(MeshChecker, PassesAClosedMesh) {
  VertexList mesh = octahedron();
  append(mesh, octahedron({5, 0, 0}));
  const MeshReport report = mesh.check();
  EXPECT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.edges, 24);
  EXPECT_EQ(report.euler, 4);
  EXPECT_EQ(report.components, 2);
  EXPECT_EQ(report.genus, 0);
  EXPECT_NEAR(report.volume, 8.0 / 3.0, 1e-12);
  EXPECT_NEAR(report.area, 16 * std::numbers::sqrt3 / 2, 1e-12);
  EXPECT_NE(report.summary().find("OK"), std::string::npos);
  EXPECT_TRUE(checkMesh(std::vector<glm::vec3>{}, {}).ok());
}

TEST(MeshChecker, FindsAHole) {
  VertexList mesh = octahedron();
  mesh.triangles.resize(mesh.triangles.size() - 3);
  EXPECT_EQ(mesh.check().open_edges, 3);
  EXPECT_FALSE(mesh.check().ok());
}

TEST(MeshChecker, AllowsAnOpeningOnlyInOneBorderPlane) {
  VertexList mesh = octahedron();
  mesh.triangles.resize(12);  // the upper half, open in z = 0
  mesh.positions.pop_back();
  EXPECT_EQ(mesh.check().open_edges, 4);
  const MeshReport report = mesh.check(boxOptions({-2, -2, 0}, {2, 2, 2}));
  EXPECT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.border_edges, 4);
  EXPECT_EQ(report.border_loops, 1);
  EXPECT_EQ(report.genus, 0);
  EXPECT_EQ(mesh.check(boxOptions({-2, -2, -1}, {2, 2, 2})).open_edges, 4);
  // Every vertex is on this box, but no open edge is in one of its planes.
  const MeshReport tight = mesh.check(boxOptions({-1, -1, -1}, {1, 1, 1}));
  EXPECT_EQ(tight.open_edges, 4);
  EXPECT_EQ(mesh.check(boxOptions({-1, -1, 0}, {1, 1, 0.5})).outside_vertices, 1);
}

TEST(MeshChecker, MapsObliqueVolumesToTheirBox) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 2, 3};
  geometry.origin = {10, -4, 2};
  geometry.direction = glm::dmat3(glm::dvec3(0.8, 0.6, 0), glm::dvec3(0.6, -0.8, 0),
                                  glm::dvec3(0, 0, 1));  // a flip too
  VertexList mesh = octahedron({2, 2, 0});
  mesh.triangles.resize(12);
  mesh.positions.pop_back();
  for (glm::dvec3& p : mesh.positions) p = geometry.indexToWorld(p);
  const MeshReport report = mesh.check(volumeOptions(geometry, {5, 5, 5}));
  EXPECT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.border_edges, 4);
}

TEST(MeshChecker, FindsAFlippedTriangle) {
  VertexList mesh = octahedron();
  std::swap(mesh.triangles[0], mesh.triangles[1]);
  EXPECT_EQ(mesh.check().misoriented_edges, 3);
  EXPECT_FALSE(mesh.check().ok());
}

TEST(MeshChecker, FindsADuplicateTriangleEitherWayRound) {
  VertexList mesh = octahedron();
  for (const std::size_t i : {1u, 2u, 0u}) mesh.triangles.push_back(mesh.triangles[i]);
  EXPECT_EQ(mesh.check().duplicate_triangles, 1);
  EXPECT_EQ(mesh.check().nonmanifold_edges, 3);

  const VertexList pillow{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 2, 0, 2, 1}};
  EXPECT_EQ(pillow.check().duplicate_triangles, 1);
  EXPECT_EQ(pillow.check().open_edges, 0);
  EXPECT_FALSE(pillow.check().ok());
}

TEST(MeshChecker, FindsZeroAreaAndNonFinitePositions) {
  VertexList mesh = octahedron();
  mesh.positions[4] = {0.5, 0.5, 0};  // between vertices 0 and 2
  EXPECT_EQ(mesh.check().zero_area_triangles, 1);
  EXPECT_EQ(mesh.check().smallest_area, 0);
  EXPECT_FALSE(mesh.check().ok());
  mesh.positions[4] = {0, std::nan(""), 1};
  EXPECT_EQ(mesh.check().zero_area_triangles, 4);
  EXPECT_EQ(mesh.check().nonfinite_vertices, 1);
}

TEST(MeshChecker, FindsAnEdgeUsedFourTimes) {
  // Two tetrahedra that share the edge 0 - 1: closed and consistently oriented, but not a manifold.
  const std::vector<std::uint32_t> tetrahedron = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
  VertexList mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, -1, 0}, {0, 0, -1}};
  mesh.triangles = tetrahedron;
  for (const std::uint32_t v : tetrahedron) mesh.triangles.push_back(v < 2 ? v : v + 2);
  const MeshReport report = mesh.check();
  EXPECT_EQ(report.nonmanifold_edges, 1);
  EXPECT_EQ(report.misoriented_edges, 0);
  EXPECT_EQ(report.open_edges, 0);
  EXPECT_FALSE(report.ok());
}

TEST(MeshChecker, FindsAPinchedVertex) {
  VertexList mesh = octahedron();
  append(mesh, octahedron({2, 0, 0}));
  EXPECT_EQ(mesh.check().duplicate_positions, 1);  // (1,0,0) twice: allowed
  EXPECT_TRUE(mesh.check().ok());
  for (std::uint32_t& index : mesh.triangles) index = index == 7 ? 0 : index;
  EXPECT_EQ(mesh.check().pinched_vertices, 1);
  EXPECT_EQ(mesh.check().unreferenced_vertices, 1);
  EXPECT_FALSE(mesh.check().ok());
}

TEST(MeshChecker, FindsBadIndices) {
  VertexList mesh = octahedron();
  mesh.triangles[5] = 6;
  EXPECT_EQ(mesh.check().bad_indices, 1);
  EXPECT_FALSE(mesh.check().ok());
  mesh = octahedron();
  mesh.triangles[1] = mesh.triangles[0];
  EXPECT_EQ(mesh.check().repeated_indices, 1);
  EXPECT_FALSE(mesh.check().ok());
  mesh = octahedron();
  mesh.triangles.pop_back();
  EXPECT_EQ(mesh.check().partial_triangles, 1);
  EXPECT_FALSE(mesh.check().ok());
}

// ---- PLY ----------------------------------------------------------------------------------------

class PlyReader : public ::testing::Test {
 protected:
  void SetUp() override {
    header_ =
        "ply\nformat binary_little_endian 1.0\ncomment test\nelement vertex 3\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property float nx\nproperty float ny\nproperty float nz\nproperty uchar quality\n"
        "element face 2\nproperty list uchar uint vertex_indices\nproperty uchar level\n"
        "end_header\n";
    for (const float v : {0.0f, 1.0f, 2.0f}) {
      for (const float value : {v, v * v, 0.25f, 0.0f, 0.0f, 1.0f}) put(value);
      put(std::uint8_t{9});
    }
    for (const std::uint32_t v : {0u, 1u}) {
      put(std::uint8_t{3});
      for (const std::uint32_t index : {v, 1 - v, 2u}) put(index);
      put(std::uint8_t{4});
    }
  }

  template <typename T>
  void put(T value) {
    data_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  PlyMesh readBack(const std::string& content) {
    writeBytes(path_, content);
    return readPly(path_);
  }

  TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_.file("mesh.ply");
  std::string header_, data_;
};

TEST_F(PlyReader, ReadsAndSkips) {
  const PlyMesh mesh = readBack(header_ + data_);
  ASSERT_EQ(mesh.positions.size(), 3u);
  EXPECT_EQ(mesh.positions[2], glm::dvec3(2, 4, 0.25));
  EXPECT_EQ(mesh.normals[1], glm::dvec3(0, 0, 1));
  EXPECT_EQ(mesh.triangles, (std::vector<std::uint32_t>{0, 1, 2, 1, 0, 2}));
}

TEST_F(PlyReader, RefusesEveryTruncation) {
  const std::string whole = header_ + data_;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_THROW(readBack(whole.substr(0, size)), Error) << size;
  }
  EXPECT_THROW(readBack(whole + "x"), Error);
  EXPECT_THROW(readPly(path_ / "absent"), Error);
}

}  // namespace
}  // namespace isobrick::test
