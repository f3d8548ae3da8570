#include "isobrick/preprocess/brick_maker.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "isobrick/preprocess/kernels/curvature_bound.h"
#include "isobrick/preprocess/kernels/low_pass.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

template <typename T>
void BrickClosures::include(int level, const Index3& brick, const ValueRange& tiles,
                            const SampleBlock<T>& samples) {
  ranges_[row(level, brick)].include(tiles);
  includeInFiner(level, brick, samples);
}

template <typename T>
void BrickClosures::includeInFiner(int level, const Index3& brick, const SampleBlock<T>& samples) {
  const auto log2 = [](std::int64_t n) { return std::countr_zero(static_cast<std::uint64_t>(n)); };
  const IndexBox cells = layout_.brickCellBox(level, brick);
  CubeRanges<T> cubes;
  // Bricks of level - down are cubes of brick_cells / 2^down cells of this level.
  for (int down = log2(layout_.tileCells()) + 1;
       down <= std::min(level - rows_.firstLevel(), log2(layout_.brickCells())); ++down) {
    if (!rows_.hasLevel(level - down)) continue;
    const std::int64_t edge = layout_.brickCells() >> down;
    cubes.reset(BrickLayout::ceilDivide(cells.count, edge));
    includeClosedCubes(samples, cells, edge, cubes, has_missing_);
    const Index3 first = cells.first / edge;
    std::size_t cube = 0;
    forEachIndex({first, cubes.dims}, [&](const Index3& finer) {
      const ValueRange range = cubes.range(cube++);
      if (contains(rows_.bricks(level - down), finer))
        ranges_[row(level - down, finer)].include(range);
    });
  }
}

#define ISOBRICK_INSTANTIATE(T)                                                  \
  template void BrickClosures::include<T>(int, const Index3&, const ValueRange&, \
                                          const SampleBlock<T>&);                \
  template void BrickClosures::includeInFiner<T>(int, const Index3&, const SampleBlock<T>&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

namespace {

// Copies `block` into dense bytes.
template <typename T>
void copyDense(const SampleBlock<T>& block, std::vector<std::byte>& bytes) {
  bytes.resize(static_cast<std::size_t>(block.box.size()) * sizeof(T));
  copyBox(block, block.box, reinterpret_cast<T*>(bytes.data()), block.box);
}

template <typename T>
void pairsOf(const CubeRanges<T>& ranges, std::vector<T>& pairs) {
  pairs.resize(2 * ranges.size());
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const ValueRange range = ranges.range(i);
    pairs[2 * i] = static_cast<T>(range.min);
    pairs[2 * i + 1] = static_cast<T>(range.max);
  }
}

template <typename T>
ValueRange unionOf(const CubeRanges<T>& ranges) {
  ValueRange all;
  for (std::size_t i = 0; i < ranges.size(); ++i) all.include(ranges.range(i));
  return all;
}

}  // namespace

// Memory that a thread uses for one brick after the other.
template <typename T>
struct BrickMaker<T>::Scratch {
  std::vector<std::vector<T>> above;  // samples of the levels above, as far as ranges need them
  CubeRanges<T> tiles;
  std::vector<T> finer_pairs, pairs, samples;
  std::vector<ValueRange> tile_ranges;
};

template <typename T>
typename BrickMaker<T>::Scratch& BrickMaker<T>::scratch() {
  thread_local Scratch the_scratch;
  return the_scratch;
}

template <typename T>
ValueRange BrickMaker<T>::make(int level, const Index3& brick, const SampleBlock<T>& samples,
                               const ScratchVolume* finer_tiles, const HandedOn<T>& handed_on,
                               EncodedBrick& encoded) const {
  Scratch& s = scratch();
  const BrickLayout& layout = needs_.layout();
  const IndexBox bricks = {brick, Index3(1)};
  const int top = needs_.levelsAbove(level);
  s.above.resize(std::max(s.above.size(), static_cast<std::size_t>(top) + 1));

  const auto blockAbove = [&](int above) {
    return above == 0 ? samples
                      : SampleBlock<T>::dense(s.above[static_cast<std::size_t>(above)].data(),
                                              needs_.samplesAbove(level, bricks, above));
  };
  {
    const PhaseTimes::Timer timer(times_, BuildStep::kLowPass);
    for (int above = 1; above <= top; ++above) {
      const IndexBox box = needs_.samplesAbove(level, bricks, above);
      auto& coarse = s.above[static_cast<std::size_t>(above)];
      coarse.resize(static_cast<std::size_t>(box.size()));
      lowPassBlock(layout.lattice(), level + above - 1, spec_.filter, blockAbove(above - 1), box,
                   coarse.data(), spec_.has_missing);
    }
    if (handed_on.samples != nullptr)
      copyBox(blockAbove(1), needs_.handedOn(level, bricks), handed_on.samples, handed_on.box);
  }
  ValueRange voxels;
  {
    const PhaseTimes::Timer timer(times_, BuildStep::kRanges);
    s.tiles.reset(layout.brickTiles(level, brick));
    for (int above = 0; above <= top; ++above) {
      includeClosedCubes(blockAbove(above), needs_.cellsAbove(level, bricks, above),
                         spec_.tile_cells >> above, s.tiles, spec_.has_missing);
      if (above == 0 && level == 0) voxels = unionOf(s.tiles);
    }
    if (finer_tiles != nullptr) includeFinerTiles(level, brick, *finer_tiles, s);
    closures_.include(level, brick, unionOf(s.tiles), samples);
    pairsOf(s.tiles, s.pairs);
    handOnTiles(level, brick, handed_on, s.pairs);
  }
  if (level == 0) count(brick, samples);
  encoded.curvature.bytes.clear();
  if (level == 0 && spec_.has_curvature) {
    const PhaseTimes::Timer timer(times_, BuildStep::kCurvature);
    s.tile_ranges.clear();
    for (std::size_t i = 0; i < s.tiles.size(); ++i) s.tile_ranges.push_back(s.tiles.range(i));
    std::vector<std::uint8_t> codes;
    brickCurvature<T>(layout, brick, samples, top > 0 ? blockAbove(1) : SampleBlock<T>(),
                      s.tile_ranges, spec_.curvature_epsilon, codes);
    const auto bytes = std::as_bytes(std::span(codes));
    encoded.curvature.bytes.assign(bytes.begin(), bytes.end());
  }
  const PhaseTimes::Timer timer(times_, BuildStep::kPack);
  copyDense(samples.part(layout.brickSampleBox(level, brick)), encoded.samples.bytes);
  const auto pairs = std::as_bytes(std::span(s.pairs));
  encoded.ranges.bytes.assign(pairs.begin(), pairs.end());
  encoded.is_in_source = level == 0 && spec_.level0 != Level0Place::kStored;
  encodeBrick(spec_.voxel_type, codec_, encoded);
  return voxels;
}

template <typename T>
void BrickMaker<T>::passOn(int level, const IndexBox& coarse, const SampleBlock<T>& samples,
                           const HandedOn<T>& handed_on) const {
  if (coarse.size() == 0) return;
  const PhaseTimes::Timer timer(times_, BuildStep::kLowPass);
  Scratch& s = scratch();
  s.above.resize(std::max<std::size_t>(s.above.size(), 1));
  s.above[0].resize(static_cast<std::size_t>(coarse.size()));
  lowPassBlock(needs_.layout().lattice(), level, spec_.filter, samples, coarse, s.above[0].data(),
               spec_.has_missing);
  copyBox(SampleBlock<T>::dense(s.above[0].data(), coarse), coarse, handed_on.samples,
          handed_on.box);
}

template <typename T>
ValueRange BrickMaker<T>::remake(int level, const Index3& brick, const PyramidWriter& writer,
                                 const HandedOn<T>& handed_on) const {
  Scratch& s = scratch();
  const BrickLayout& layout = needs_.layout();
  const std::uint64_t row = writer.rows().row(level, brick);
  const IndexBox box = layout.brickSampleBox(level, brick);
  s.samples.resize(static_cast<std::size_t>(box.size()));
  s.pairs.resize(static_cast<std::size_t>(2 * elementCount(layout.brickTiles(level, brick))));
  const auto read = [&](PartKind part, std::vector<T>& elements) {
    const PhaseTimes::Timer timer(times_, BuildStep::kRead);
    writer.readPart(row, part, elements.size() * sizeof(T),
                    reinterpret_cast<std::byte*>(elements.data()));
  };
  read(PartKind::kSamples, s.samples);
  read(PartKind::kRanges, s.pairs);

  const auto samples = SampleBlock<T>::dense(s.samples.data(), box);
  if (handed_on.samples != nullptr)
    passOn(level, needs_.handedOn(level, {brick, Index3(1)}), samples, handed_on);
  if (level == 0) count(brick, samples);
  const PhaseTimes::Timer timer(times_, BuildStep::kRanges);
  ValueRange tiles, voxels;
  for (std::size_t i = 0; i < s.pairs.size(); i += 2)
    tiles.include({static_cast<float>(s.pairs[i]), static_cast<float>(s.pairs[i + 1])});
  closures_.include(level, brick, tiles, samples);
  handOnTiles(level, brick, handed_on, s.pairs);
  if (level == 0) {
    s.tiles.reset(Index3(1));
    includeClosedCubes(samples, layout.brickCellBox(level, brick), spec_.brick_cells, s.tiles,
                       spec_.has_missing);
    voxels = unionOf(s.tiles);
  }
  return voxels;
}

template <typename T>
void BrickMaker<T>::count(const Index3& brick, const SampleBlock<T>& voxels) const {
  const PhaseTimes::Timer timer(times_, BuildStep::kCount);
  statistics_.add(voxels, needs_.layout().brickOwnSamples(0, brick), spec_.voxels);
}

// A tile includes its tiles of the finer level, up to eight, and with them all finer samples.
template <typename T>
void BrickMaker<T>::includeFinerTiles(int level, const Index3& brick,
                                      const ScratchVolume& finer_tiles, Scratch& s) const {
  const IndexBox tiles = needs_.tiles(level, {brick, Index3(1)});
  const Index3 first = tiles.first * std::int64_t{2};
  const Index3 count = glm::min(tiles.end() * std::int64_t{2}, needs_.allTiles(level - 1)) - first;
  s.finer_pairs.resize(static_cast<std::size_t>(2 * elementCount(count)));
  finer_tiles.read(tilePairs({first, count}), s.finer_pairs.data());
  std::size_t pair = 0;
  forEachIndex({Index3(0), count}, [&](const Index3& at) {
    const auto tile = static_cast<std::size_t>(linearIndex(at / std::int64_t{2}, s.tiles.dims));
    s.tiles.min[tile] = std::min(s.tiles.min[tile], s.finer_pairs[pair]);
    s.tiles.max[tile] = std::max(s.tiles.max[tile], s.finer_pairs[pair + 1]);
    pair += 2;
  });
}

template <typename T>
void BrickMaker<T>::handOnTiles(int level, const Index3& brick, const HandedOn<T>& handed_on,
                                const std::vector<T>& pairs) const {
  if (handed_on.tiles != nullptr)
    handed_on.tiles->write(tilePairs(needs_.tiles(level, {brick, Index3(1)})), pairs.data());
}

#define ISOBRICK_INSTANTIATE(T) template class BrickMaker<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
