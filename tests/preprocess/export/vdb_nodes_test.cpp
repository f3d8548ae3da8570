// Ranges and curvature in OpenVDB files: read by OpenVDB, compared with the library node by node.
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/mat4x4.hpp>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

constexpr NodeValue kRanges[] = {NodeValue::kLeast, NodeValue::kGreatest};

class VdbNodesTest : public VolumeFilesTest {
 protected:
  // Waves, noise and a constant part, on a grid of no axis of the world.
  template <typename T>
  void build(const Index3& voxels, double offset) {
    Random random(7);
    std::vector<T> values;
    forEachIndex({Index3(0), voxels}, [&](const Index3& at) {
      const double wave = std::sin(0.2 * static_cast<double>(at.x + 2 * at.y)) *
                          std::cos(0.3 * static_cast<double>(at.z));
      values.push_back(
          at.x > 40 ? T{90} : static_cast<T>(60 + 50 * wave + static_cast<double>(random() % 3)));
    });
    ArraySource<T> source(voxels, values);
    GridGeometry& geometry = source.editInfo().geometry;
    geometry.direction =
        glm::dmat3(glm::rotate(glm::dmat4(1.0), 0.7, glm::normalize(glm::dvec3(1, -2, 3))));
    geometry.spacing = {0.7, 1.0 / 3, 2.5};
    geometry.origin = {-101.3, 17.77, 1e3 / 7};
    source.editInfo().values.offset = offset;
    source.editInfo().properties["vdb.background"] = "60";
    BuildOptions options;
    options.brick_cells = 16;
    buildPyramid(source, pathOf("volume.isb"), options);
    pyramid_ = std::make_shared<Pyramid>(pathOf("volume.isb"));
  }

  // All nodes that reach into the box.
  void write(const IndexBox& voxels, int levels) {
    VolumeLevels sources;
    sources.push_back(makePyramidSource(pyramid_, 1 << 20, 0));
    const auto add = [&](NodeValue value, int level) {
      sources.push_back(makeNodeSource(pyramid_, 1 << 20, value, level, voxels));
    };
    for (int level = 0; level < levels; ++level)
      for (const NodeValue value : kRanges) add(value, level);
    for (int i = 0; i < kDeviationCoefficients; ++i)
      add(static_cast<NodeValue>(static_cast<int>(NodeValue::kCurvature) + i), 0);
    ExportOptions options;
    options.memory_bytes = std::uint64_t{64} << 20;
    options.vdb_tolerance = 100;  // of voxels alone
    options.vdb_half = true;
    exportVolume(sources, pathOf("nodes.vdb"), options);
    file_ = std::make_unique<openvdb::io::File>(pathOf("nodes.vdb"));
    file_->open();
    grids_ = file_->getGrids();
  }

  const openvdb::FloatGrid& grid(const std::string& name) const {
    for (const auto& grid : *grids_)
      if (grid->getName() == name) return static_cast<const openvdb::FloatGrid&>(*grid);
    throw Error("no grid " + name);
  }

  // The grid's value where the middle of the node is in the world, a whole coordinate.
  float valueAt(const openvdb::FloatGrid& grid, const Index3& node, std::int64_t edge) const {
    const glm::dvec3 middle = (glm::dvec3(node) + 0.5) * static_cast<double>(edge);
    const glm::dvec3 world = pyramid_->spec().geometry.indexToWorld(middle);
    const openvdb::Vec3d at = grid.worldToIndex({world.x, world.y, world.z});
    const openvdb::Coord coord = openvdb::Coord::round(at);
    EXPECT_LT((coord.asVec3d() - at).length(), 1e-9);
    return grid.tree().getValue(coord);
  }

  // As the library says, for every node of every brick that `isIn` takes; returns how many.
  template <typename IsIn>
  std::int64_t compare(int levels, const IsIn& isIn) const {
    const BrickLayout& layout = pyramid_->layout();
    std::int64_t compared = 0;
    for (int level = 0; level < levels; ++level) {
      const std::string suffix = level == 0 ? "" : "_level" + std::to_string(level);
      const openvdb::FloatGrid &least = grid("min" + suffix), &greatest = grid("max" + suffix);
      EXPECT_EQ(least.metaValue<int>("isobrick:level"), level);
      const std::int64_t edge = layout.tileCells() << level;
      forEachIndex({Index3(0), layout.bricks(level)}, [&](const Index3& brick) {
        std::vector<ValueRange> ranges;
        pyramid_->tileRanges(level, brick, ranges);
        const Index3 count = layout.brickTiles(level, brick);
        for (std::size_t i = 0; i < ranges.size(); ++i) {
          const Index3 tile = brick * (layout.brickCells() / layout.tileCells()) +
                              indexAt(static_cast<std::int64_t>(i), count);
          if (!isIn(tile, edge)) continue;
          const ValueTransform& values = pyramid_->spec().values;
          EXPECT_EQ(valueAt(least, tile, edge), static_cast<float>(values.real(ranges[i].min)));
          EXPECT_EQ(valueAt(greatest, tile, edge), static_cast<float>(values.real(ranges[i].max)));
          ++compared;
        }
      });
    }
    forEachIndex({Index3(0), layout.bricks(0)}, [&](const Index3& brick) {
      std::vector<std::uint8_t> codes;
      pyramid_->parts().curvature(brick, codes);
      const Index3 count = layout.brickCurvatureBlocks(brick);
      const std::int64_t edge = layout.curvatureCells();
      for (std::size_t i = 0; i < codes.size(); ++i) {
        const Index3 block = brick * (layout.brickCells() / edge) +
                             indexAt(static_cast<std::int64_t>(i / kDeviationCoefficients), count);
        if (!isIn(block, edge)) continue;
        EXPECT_EQ(
            valueAt(grid("curvature_" + std::to_string(i % kDeviationCoefficients)), block, edge),
            DeviationCode::decode(codes[i]));
        ++compared;
      }
    });
    return compared;
  }

  std::shared_ptr<const Pyramid> pyramid_;
  std::unique_ptr<openvdb::io::File> file_;
  openvdb::GridPtrVecPtr grids_;
};

TEST_F(VdbNodesTest, AreThoseOfTheLibraryWhereTheyLie) {
  openvdb::initialize();
  const Index3 voxels(61, 40, 19);
  for (const double offset : {0.0, 1000.0}) {
    if (offset == 0)
      build<std::uint16_t>(voxels, offset);
    else
      build<std::int16_t>(voxels, offset);
    const int levels = pyramid_->lattice().levels();
    fs::remove(pathOf("nodes.vdb"));
    write({Index3(0), voxels}, levels);
    EXPECT_EQ(grids_->size(), 1u + 2u * static_cast<unsigned>(levels) + 8u);
    EXPECT_EQ(grid("density").metaValue<int>("isobrick:level"), 0);
    const auto all = [](const Index3&, std::int64_t) { return true; };
    EXPECT_GT(compare(levels, all), 1500);
  }
}

TEST_F(VdbNodesTest, OfABoxAreThoseThatReachIntoIt) {
  openvdb::initialize();
  build<std::uint8_t>({61, 40, 19}, 0);
  const IndexBox box{{9, 8, 4}, {22, 30, 9}};
  write(box, 2);
  const auto isIn = [&](const Index3& node, std::int64_t edge) {
    const Index3 low = node * edge, high = low + Index3(edge);
    return glm::all(glm::lessThan(low, box.end() - Index3(1))) &&
           glm::all(glm::greaterThan(high, box.first));
  };
  EXPECT_GT(compare(2, isIn), 250);
  // And no others: from 8 to 32, 8 to 40, 4 to 12 in tiles of 4.
  EXPECT_EQ(grid("min").metaValue<openvdb::Vec3i>("isobrick:voxels"), openvdb::Vec3i(6, 8, 2));
}

TEST_F(VdbNodesTest, CurvatureThatIsNotThereIsRefused) {
  ArraySource<std::uint8_t> source(Index3(9), std::vector<std::uint8_t>(729, 3));
  BuildOptions options;
  options.with_curvature = false;
  buildPyramid(source, pathOf("flat.isb"), options);
  const auto pyramid = std::make_shared<Pyramid>(pathOf("flat.isb"));
  EXPECT_CONTAINS(
      errorOf([&] {
        makeNodeSource(pyramid, 1 << 20, NodeValue::kCurvature, 0, {Index3(0), Index3(9)});
      }),
      "holds no curvature");
}

}  // namespace
}  // namespace isobrick
