// Rows of states of a brick's cells, and samples of a brick, against the same asked one by one.
#include "isobrick/extract/meshing/leaf_rows.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/corner_values.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

bool hasBit(const std::uint64_t* words, std::int64_t i) {
  return (words[i / 64] >> i % 64 & 1) != 0;
}

Index3 randomDims(Random& random) {
  Index3 dims;
  for (int axis = 0; axis < 3; ++axis)
    dims[axis] = randomInt(random, 2, axis == 0 && randomInt(random, 0, 2) == 0 ? 300 : 40);
  return dims;
}

// One brick's rows, all found, and the states of its cells.
struct FoundBrick {
  LeafClassifier rows_classifier, states;
  LeafRows rows;
  int level;
  IndexBox cells;

  FoundBrick(const MeshContext& context, int of_level, const IndexBox& of_cells)
      : rows_classifier(context), states(context), level(of_level), cells(of_cells) {
    rows.reset(rows_classifier, context.lattice(), level, cells);
  }
  CellState state(std::int64_t i, std::int64_t j, std::int64_t k) {
    return states.state(level, cells.first + Index3(i, j, k));
  }
  // Any cell of the box that begins at (i, j, k), counted from the brick's first.
  bool hasAny(CellState wanted, std::int64_t i, std::int64_t j, std::int64_t k,
              const Index3& count) {
    for (std::int64_t z = k; z < k + count.z; ++z)
      for (std::int64_t y = j; y < j + count.y; ++y)
        for (std::int64_t x = i; x < i + count.x; ++x)
          if (state(x, y, z) == wanted) return true;
    return false;
  }

  void checkRow(std::int64_t j, std::int64_t k) {
    rows.find(j, k);
    rows.findAround(j, k);
    const std::int64_t nx = cells.count.x, words = wordsOf(nx), corner_words = wordsOf(nx + 1);
    std::vector<std::uint64_t> leaves(static_cast<std::size_t>(words)), others(leaves);
    rows.leaves(j, k, leaves.data());
    rows.besideOthers(j, k, others.data());
    for (std::int64_t i = 0; i < nx; ++i) {
      const CellState here = state(i, j, k);
      ASSERT_EQ(hasBit(leaves.data(), i), here == CellState::kLeaf) << i << " " << j << " " << k;
      const Index3 around(3);
      const bool finer = hasAny(CellState::kFiner, i - 1, j - 1, k - 1, around);
      const bool coarser = hasAny(CellState::kCoarser, i - 1, j - 1, k - 1, around);
      ASSERT_EQ(hasBit(others.data(), i), finer || coarser) << i << " " << j << " " << k;
      ASSERT_EQ(rows.isRefined(cells.first + Index3(i, j, k)), here == CellState::kFiner);
      const auto across = rows.besideFiner(j, k, i / 64);
      for (int face = 0; face < 6; ++face) {
        Index3 to(i, j, k);
        to[face / 2] += face % 2 == 0 ? -1 : 1;
        ASSERT_EQ((across[static_cast<std::size_t>(face)] >> i % 64 & 1) != 0,
                  state(to.x, to.y, to.z) == CellState::kFiner);
      }
    }
    std::vector<std::uint64_t> finer(static_cast<std::size_t>(corner_words)), coarser(finer);
    rows.cornersTouching(j, k, finer.data(), coarser.data());
    for (std::int64_t i = 0; i <= nx; ++i) {
      ASSERT_EQ(hasBit(finer.data(), i), hasAny(CellState::kFiner, i - 1, j - 1, k - 1, Index3(2)));
      ASSERT_EQ(hasBit(coarser.data(), i),
                hasAny(CellState::kCoarser, i - 1, j - 1, k - 1, Index3(2)));
      for (int axis = 0; axis < 3; ++axis) checkEdge(axis, i, j, k);
    }
  }
  // The edge along `axis` from a corner.
  void checkEdge(int axis, std::int64_t i, std::int64_t j, std::int64_t k) {
    if (axis == 0 && i == cells.count.x) return;
    Index3 first(i - 1, j - 1, k - 1), count(2);
    ++first[axis];
    --count[axis];
    LeafRows::EdgeBits bits;
    if (axis != 0 && i == 0) {
      bits = rows.firstEdgeAround(axis, j, k);
    } else {
      const std::int64_t bit = axis == 0 ? i : i - 1;
      bits = rows.edgesAround(axis, j, k, bit / 64);
      bits = {bits.beside_finer >> bit % 64 & 1, bits.beside_coarser >> bit % 64 & 1};
    }
    ASSERT_EQ(bits.beside_finer != 0, hasAny(CellState::kFiner, first.x, first.y, first.z, count))
        << axis << ": " << i << " " << j << " " << k;
    ASSERT_EQ(bits.beside_coarser != 0,
              hasAny(CellState::kCoarser, first.x, first.y, first.z, count))
        << axis << ": " << i << " " << j << " " << k;
  }
};

TEST(LeafRows, SayOfEachCellWhatTheClassifierSays) {
  const TemporaryFolder folder;
  Random random(11);
  int with_runs = 0, without_runs = 0;
  for (int volume = 0; volume < 10; ++volume) {
    const Index3 dims = randomDims(random);
    BuildOptions options;
    options.brick_cells = std::int64_t{4} << randomInt(random, 0, 6);
    options.tile_cells = 2;
    ArraySource<float> source(dims, arrayOfField<float>(dims, [&](const Index3& i) {
                                return std::sin(0.4 * static_cast<double>(i.x)) +
                                       std::sin(0.3 * static_cast<double>(i.y + i.z));
                              }));
    const std::string path = folder.file("leaf_rows.isb");
    buildPyramid(source, path, options);
    const Pyramid pyramid(path);
    for (int q = 0; q < 12; ++q) {
      Query query;
      FocusSphere focus;
      for (int axis = 0; axis < 3; ++axis)
        focus.center[axis] = std::floor(randomReal(random, -4, static_cast<double>(dims[axis]))) +
                             (q % 3 == 0 ? 0.0 : randomReal(random, 0, 1));
      focus.radius = randomReal(random, 0, 12);
      query.focus = focus;
      if (q % 4 == 3) query.curvature_tolerance = std::exp(randomReal(random, -6, 3));
      const auto oracles = oraclesOf(pyramid, query);
      const WorldFrame frame(pyramid.spec().geometry);
      ReadLog log;
      const MeshContext context{pyramid, query, oracles, frame, 0.0f, log};
      const int level =
          static_cast<int>(randomInt(random, 0, std::min(3, pyramid.lattice().levels() - 1)));
      const Index3 bricks = pyramid.layout().bricks(level);
      Index3 brick;
      for (int axis = 0; axis < 3; ++axis) brick[axis] = randomInt(random, 0, bricks[axis] - 1);
      FoundBrick found(context, level, pyramid.layout().brickCellBox(level, brick));
      (found.rows_classifier.hasRuns() ? with_runs : without_runs) += 1;
      for (int row = 0; row < 12; ++row)
        found.checkRow(randomInt(random, 0, found.cells.count.y - 1),
                       randomInt(random, 0, found.cells.count.z - 1));
    }
  }
  EXPECT_GT(with_runs, 60);
  EXPECT_GT(without_runs, 20);
}

// A box of random samples of one level.
template <typename T>
struct RandomSamples {
  Lattice lattice;
  int level;
  IndexBox box;
  std::vector<T> data;

  explicit RandomSamples(Random& random)
      : lattice(randomDims(random)),
        level(static_cast<int>(randomInt(random, 0, lattice.levels() - 1))) {
    const Index3 samples = lattice.samples(level);
    for (int axis = 0; axis < 3; ++axis) {
      box.first[axis] = randomInt(random, 0, samples[axis] - 2);
      box.count[axis] = randomInt(random, 2, samples[axis] - box.first[axis]);
    }
    data.resize(static_cast<std::size_t>(elementCount(box.count)));
    for (T& value : data) value = static_cast<T>(randomInt(random, 0, 65535));
  }
  SampleView<T> view() const { return {lattice, level, box, data.data()}; }
  Index3 randomSample(Random& random) const {
    Index3 sample;
    for (int axis = 0; axis < 3; ++axis)
      sample[axis] = box.first[axis] + randomInt(random, 0, box.count[axis] - 1);
    return sample;
  }
  T at(const Index3& sample) const {
    return data[static_cast<std::size_t>(linearIndex(sample - box.first, box.count))];
  }
};

TEST(SampleView, TakesGradientsBetweenTheNeighboursThatThereAre) {
  Random random(12);
  int one_sided = 0, between = 0;
  for (int round = 0; round < 400; ++round) {
    const RandomSamples<std::uint16_t> samples(random);
    const SampleView<std::uint16_t> view = samples.view();
    for (int n = 0; n < 20; ++n) {
      const Index3 sample = samples.randomSample(random);
      EdgeEnd end;
      view.end(sample, end);
      ASSERT_EQ(end.value, static_cast<float>(samples.at(sample)));
      for (int axis = 0; axis < 3; ++axis) {
        Index3 low = sample, high = sample;
        low[axis] = std::max(low[axis] - 1, samples.box.first[axis]);
        high[axis] = std::min(high[axis] + 1, samples.box.end()[axis] - 1);
        const auto distance =
            static_cast<float>(samples.lattice.position(samples.level, axis, high[axis]) -
                               samples.lattice.position(samples.level, axis, low[axis]));
        const float difference =
            static_cast<float>(samples.at(high)) - static_cast<float>(samples.at(low));
        ASSERT_EQ((&end.gradient.x)[axis], difference / distance);
        (high[axis] - low[axis] == 2 ? between : one_sided) += 1;
      }
    }
  }
  EXPECT_GT(one_sided, 1000);
  EXPECT_GT(between, 1000);
}

TEST(CornerValue, OfIntegersHangsAsThatOfAnySamples) {
  Random random(13);
  int hanging = 0;
  for (int round = 0; round < 400; ++round) {
    const RandomSamples<std::uint16_t> samples(random);
    const SampleView<std::uint16_t> view = samples.view();
    for (int n = 0; n < 20; ++n) {
      const Index3 sample = samples.randomSample(random);
      int odd = 0;
      bool has_ends = true;
      for (int axis = 0; axis < 3; ++axis) {
        if (isOnCoarserLattice(samples.lattice, samples.level, axis, sample[axis])) continue;
        ++odd;
        has_ends = has_ends && sample[axis] > samples.box.first[axis] &&
                   sample[axis] + 1 < samples.box.end()[axis];
      }
      if (odd == 3 || !has_ends) continue;
      hanging += odd > 0 ? 1 : 0;
      ASSERT_EQ(ownValueOnCoarserLeaf(samples.lattice, samples.level, sample, view),
                valueOnCoarserLeaf(samples.lattice, samples.level, sample,
                                   [&](const Index3& at) { return view.value(at); }));
    }
  }
  EXPECT_GT(hanging, 1000);
}

// The coarser side and the finer ones of a face. The values nearly make zero in its middle, so that
// the order of the roundings shows.
TEST(CornerValue, OfAFaceIsTheSameFromBothSides) {
  constexpr int kLevel = 1;
  Random random(14);
  const Lattice lattice(Index3(8));  // the last cells of level 2 are three voxels wide
  const Index3 first(2);
  for (int round = 0; round < 3000; ++round) {
    const int axis = round % 3, b = (axis + 1) % 3, c = (axis + 2) % 3;
    float values[3][3];
    for (const int corner : {0, 1, 2})
      values[corner & 2][2 * (corner & 1)] = static_cast<float>(randomReal(random, -1, 1));
    values[2][2] = (values[0][0] + 2 * values[0][2] + 2 * values[2][0]) / -4;
    fillFace(lattice, kLevel, first, {b, c}, {2, 2}, values);
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) {
        Index3 sample = first;
        sample[b] += i;
        sample[c] += j;
        ASSERT_EQ(values[j][i], valueOnCoarserLeaf(lattice, kLevel, sample, [&](const Index3& at) {
                    return values[at[c] - first[c]][at[b] - first[b]];
                  }));
      }
  }
}

}  // namespace
}  // namespace isobrick::test
