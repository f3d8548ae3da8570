// Oracles that answer for rows of cells at once, against the same oracles asked cell by cell.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

bool bitOf(const std::vector<std::uint64_t>& bits, std::int64_t i) {
  return (bits[static_cast<std::size_t>(i / 64)] >> i % 64 & 1) != 0;
}

std::vector<std::uint64_t> randomWords(Random& random, std::int64_t bits) {
  std::vector<std::uint64_t> words(static_cast<std::size_t>(wordsOf(bits)));
  for (std::uint64_t& word : words) word = random();
  return words;
}

TEST(RowBits, AreThoseOfSingleBits) {
  Random random(3);
  for (int round = 0; round < 3000; ++round) {
    const std::int64_t count = randomInt(random, 1, 200);
    const std::int64_t begin = randomInt(random, -70, 270);
    const std::int64_t end = randomInt(random, begin, 300);
    const std::vector<std::uint64_t> words = randomWords(random, count);
    std::vector<std::uint64_t> kept = words, set = words, is_between(words.size());
    keepBits(kept.data(), count, begin, end);
    setBits(set.data(), count);
    for (std::int64_t w = 0; w < wordsOf(count); ++w)
      is_between[static_cast<std::size_t>(w)] = bitsBetween(begin, end, w);
    bool any = false;
    for (std::int64_t i = 0; i < 64 * wordsOf(count); ++i) {
      const bool between = i >= begin && i < end;
      ASSERT_EQ(bitOf(is_between, i), between);
      ASSERT_EQ(bitOf(kept, i), between && bitOf(words, i));
      ASSERT_EQ(bitOf(set, i), i < count);
      any = any || (between && bitOf(words, i));
    }
    if (begin >= 0 && end <= 64 * wordsOf(count)) {
      ASSERT_EQ(hasBitsBetween(words.data(), begin, end), any) << begin << " " << end;
    }
  }
  EXPECT_EQ(lowBits(0), 0u);
  EXPECT_EQ(lowBits(63), ~std::uint64_t{0} >> 1);
  EXPECT_EQ(lowBits(64), ~std::uint64_t{0});
}

TEST(RowBits, OfParentsAreThoseOfTheirCells) {
  Random random(4);
  for (int round = 0; round < 3000; ++round) {
    const std::int64_t skip = randomInt(random, 0, 1), count = randomInt(random, 1, 300);
    const std::int64_t parents = (skip + count - 1) / 2 + 1;
    const std::vector<std::uint64_t> parent_bits = randomWords(random, parents);
    std::vector<std::uint64_t> cells(static_cast<std::size_t>(wordsOf(count)), random());
    doubleBits(parent_bits.data(), parents, skip, count, cells.data());
    for (std::int64_t i = 0; i < 64 * wordsOf(count); ++i)
      ASSERT_EQ(bitOf(cells, i), i < count && bitOf(parent_bits, (skip + i) / 2))
          << i << " of " << count << " behind " << skip;
  }
}

// Where a focus may be, and how large: on samples, centres and ties between cells, outside, and so
// far away that a step of a cell is lost in the distance.
FocusSphere randomFocus(Random& random, const Index3& dims) {
  FocusSphere focus;
  const std::int64_t kind = randomInt(random, 0, 5);
  for (int axis = 0; axis < 3; ++axis) {
    const auto most = static_cast<double>(dims[axis] - 1);
    double at = randomReal(random, 0, most);
    if (kind == 1) at = std::round(at);
    if (kind == 2) at = std::round(at) + 0.5;
    if (kind == 3) at = randomReal(random, -3 * most, 4 * most);
    if (kind == 4)
      at = std::ldexp(randomReal(random, -1, 1), static_cast<int>(randomInt(random, 5, 30)));
    if (kind == 5 && randomInt(random, 0, 1) == 0)
      at = randomInt(random, 0, 1) == 0 ? 0x1p30 : -0x1p30;
    focus.center[axis] = at;
  }
  const auto reach = static_cast<double>(std::max({dims.x, dims.y, dims.z}));
  const double distance = glm::length(focus.center - 0.5 * glm::dvec3(dims));
  switch (randomInt(random, 0, 6)) {
    case 0:
      focus.radius = 0;
      break;
    case 1:
      focus.radius = std::ldexp(1.0, static_cast<int>(randomInt(random, 0, 1000)));
      break;
    case 2:
      focus.radius = std::round(randomReal(random, 0, reach));
      break;
    case 3:
      focus.radius = std::max(0.0, distance + randomReal(random, -reach, reach));
      break;
    default:
      focus.radius = randomReal(random, 0, reach);
  }
  return focus;
}

// Every fourth volume may have long rows.
Index3 randomDims(Random& random, int round) {
  Index3 dims;
  for (int axis = 0; axis < 3; ++axis)
    dims[axis] = randomInt(random, 2, axis == 0 && round % 4 == 0 ? 5000 : 300);
  return dims;
}

TEST(FocusOracle, KeepsInRowsTheCellsThatItRefines) {
  Random random(5);
  std::int64_t rows_with_both = 0;
  for (int round = 0; round < 800; ++round) {
    const Index3 dims = randomDims(random, round);
    const Lattice lattice(dims);
    Query query;
    if (randomInt(random, 0, 9) > 0)
      query.focus = randomFocus(random, dims);
    else if (randomInt(random, 0, 1) == 0)
      query.uniform_level = static_cast<int>(randomInt(random, 0, lattice.levels() - 1));
    const FocusOracle oracle(lattice, query);
    for (int row = 0; row < 30; ++row) {
      const int level = static_cast<int>(randomInt(random, 0, lattice.levels()));
      const Index3 cells = lattice.cells(level);
      Index3 first;
      for (int axis = 0; axis < 3; ++axis) first[axis] = randomInt(random, 0, cells[axis] - 1);
      const std::int64_t count =
          randomInt(random, 1, std::min<std::int64_t>(cells.x - first.x, 258));
      const std::vector<std::uint64_t> asked = randomWords(random, count);
      std::vector<std::uint64_t> kept = asked;
      oracle.keepRefined(level, first, count, kept.data());
      bool any = false, all = true;
      for (std::int64_t i = 0; i < count; ++i) {
        const bool refined = oracle.refines(level, {first.x + i, first.y, first.z});
        ASSERT_EQ(bitOf(kept, i), refined && bitOf(asked, i))
            << "round " << round << " level " << level << " cell " << i << " of " << count;
        any = any || refined;
        all = all && refined;
      }
      rows_with_both += any && !all ? 1 : 0;
    }
  }
  EXPECT_GT(rows_with_both, 300);
}

TEST(FocusOracle, CutsEightRowsAsItCutsOne) {
  Random random(8);
  std::int64_t rows_with_both = 0;
  for (int round = 0; round < 40000; ++round) {
    const Index3 dims = randomDims(random, round);
    const Lattice lattice(dims);
    Query query;
    if (randomInt(random, 0, 9) > 0) query.focus = randomFocus(random, dims);
    const FocusOracle oracle(lattice, query);
    const int level = static_cast<int>(randomInt(random, 1, lattice.levels()));
    const Index3 cells = lattice.cells(level);
    Index3 first;
    for (int axis = 0; axis < 3; ++axis) first[axis] = randomInt(random, 0, cells[axis] - 1);
    const std::int64_t count = randomInt(random, 1, std::min<std::int64_t>(cells.x - first.x, 258));
    const auto rows = static_cast<std::size_t>(
        randomInt(random, 1, std::min<std::int64_t>(cells.y - first.y, SphereRows::kMost)));
    CellSpan spans[SphereRows::kMost];
    oracle.refinedSpans(level, first, count, rows, spans);
    for (std::size_t row = 0; row < rows; ++row) {
      const Index3 at = first + Index3(0, row, 0);
      const CellSpan one = oracle.refinedSpan(level, at, count);
      for (std::int64_t i = 0; i < count; ++i) {
        const bool refined = oracle.refines(level, at + Index3(i, 0, 0));
        ASSERT_EQ(i >= spans[row].begin && i < spans[row].end, refined)
            << "round " << round << " level " << level << " cell " << i << " of " << count;
        ASSERT_EQ(i >= one.begin && i < one.end, refined);
      }
      rows_with_both += one.begin < one.end && one.end - one.begin < count ? 1 : 0;
    }
  }
  EXPECT_GT(rows_with_both, 1000);
}

TEST(LeafClassifier, ClassifiesRowsAsItClassifiesCells) {
  const TemporaryFolder folder;
  Random random(6);
  std::int64_t leaves = 0, finer = 0, coarser = 0, rows_with_runs = 0;
  for (int volume = 0; volume < 12; ++volume) {
    Index3 dims;
    for (int axis = 0; axis < 3; ++axis)
      dims[axis] = randomInt(random, 2, axis == 0 && volume % 3 == 0 ? 300 : 24);
    BuildOptions options;
    options.brick_cells = std::int64_t{4} << randomInt(random, 0, 6);
    options.tile_cells = 2 << randomInt(random, 0, 1);
    ArraySource<float> source(dims, arrayOfField<float>(dims, [&](const Index3& i) {
                                const double smooth = std::sin(0.4 * static_cast<double>(i.x)) +
                                                      std::sin(0.3 * static_cast<double>(i.y)) +
                                                      std::sin(0.5 * static_cast<double>(i.z));
                                return smooth + (i.x % 40 < 20 ? randomReal(random, 0, 1) : 0.0);
                              }));
    const std::string path = folder.file("rows.isb");
    buildPyramid(source, path, options);
    const Pyramid pyramid(path);
    const Lattice& lattice = pyramid.lattice();
    for (int q = 0; q < 8; ++q) {
      Query query;
      query.isovalue = randomReal(random, -2, 2);
      if (q > 0) query.focus = randomFocus(random, dims);
      if (q % 2 == 0) query.curvature_tolerance = std::exp(randomReal(random, -6, 3));
      const auto oracles = oraclesOf(pyramid, query);
      const WorldFrame frame(pyramid.spec().geometry);
      ReadLog log;
      const MeshContext context{pyramid, query, oracles, frame, static_cast<float>(query.isovalue),
                                log};
      LeafClassifier rows(context), cells(context);
      for (int row = 0; row < 60; ++row) {
        const int level = static_cast<int>(randomInt(random, 0, lattice.levels() - 1));
        const Index3 dims_in_cells = lattice.cells(level);
        Index3 first;
        for (int axis = 0; axis < 3; ++axis)
          first[axis] = randomInt(random, 0, dims_in_cells[axis] - 1);
        const std::int64_t count =
            randomInt(random, 1, std::min<std::int64_t>(dims_in_cells.x - first.x, 258));
        // Two rows with the same parents, often.
        for (first.y = first.y / 2 * 2; first.y < dims_in_cells.y && randomInt(random, 0, 2) > 0;
             ++first.y) {
          std::vector<std::uint64_t> refined = randomWords(random, count);
          const std::uint64_t* row_exists = rows.classifyRow(level, first, count, refined.data());
          const std::vector<std::uint64_t> exists(row_exists, row_exists + wordsOf(count));
          if (rows.hasRuns()) {
            CellSpan existing, run;
            rows.classifyRows(level, first, count, 1, &existing, &run);
            for (std::int64_t i = 0; i < count; ++i) {
              const bool is_there = i >= existing.begin && i < existing.end;
              ASSERT_EQ(is_there, bitOf(exists, i));
              ASSERT_EQ(is_there && i >= run.begin && i < run.end, bitOf(refined, i));
            }
            ++rows_with_runs;
          }
          for (std::int64_t i = 0; i < 64 * wordsOf(count); ++i) {
            CellState expected = CellState::kCoarser;
            if (i < count) expected = cells.state(level, {first.x + i, first.y, first.z});
            ASSERT_EQ(bitOf(exists, i), expected != CellState::kCoarser);
            ASSERT_EQ(bitOf(refined, i), expected == CellState::kFiner);
            leaves += expected == CellState::kLeaf ? 1 : 0;
            finer += expected == CellState::kFiner ? 1 : 0;
            coarser += i < count && expected == CellState::kCoarser ? 1 : 0;
          }
        }
      }
    }
  }
  EXPECT_GT(leaves, 5000);
  EXPECT_GT(finer, 5000);
  EXPECT_GT(coarser, 5000);
  EXPECT_GT(rows_with_runs, 500);
}

}  // namespace
}  // namespace isobrick::test
