// One brick against itself and against those that its ranges must agree with.
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"

namespace isobrick {
namespace {

// Reads samples and ranges by the ordinary calls, so an unreadable part is an Error.
//
// A contradiction between two bricks does not show which of them is wrong. The finer one is checked
// first: if it is wrong by itself, it is named when its turn comes, and the coarser is not.
class BrickVerifier {
 public:
  explicit BrickVerifier(const Pyramid& pyramid)
      : pyramid_(pyramid.parts()), layout_(pyramid.layout()), lattice_(pyramid.lattice()) {}

  // The fault of a brick, or "".
  std::string findFault(int level, const Index3& brick) const {
    Values values;
    std::string fault = findOwnFault(level, brick, values);
    if (fault.empty()) fault = findRangeFault(level, brick, values);
    if (fault.empty()) fault = findSampleFault(level, brick);
    return fault;
  }

 private:
  // Per tile of a brick: the range that the file states, and that of the brick's own samples.
  struct Values {
    std::vector<ValueRange> stated, seen;
  };

  // Contradictions within the brick. Fills `values`.
  std::string findOwnFault(int level, const Index3& brick, Values& values) const {
    const BrickSamples samples = pyramid_.samples(level, brick);
    std::vector<ValueRange>& ranges = values.stated;
    pyramid_.tileRanges(level, brick, ranges);
    std::vector<std::uint8_t> codes;
    if (level == 0 && pyramid_.storedBytes(PartKind::kCurvature, level, brick) > 0)
      pyramid_.curvature(brick, codes);
    if (hasStrayFields(level, brick)) return "a field that nothing uses is not zero";
    if (!arePossible(samples)) return "a sample is not a finite number";
    std::vector<ValueRange>& seen = values.seen;
    seen.assign(ranges.size(), {});
    includeSamples(level, brick, samples, seen);
    const ValueRange stated = pyramid_.brickRange(level, brick);
    for (std::size_t tile = 0; tile < ranges.size(); ++tile) {
      if (!(ranges[tile].min <= ranges[tile].max) && !isNoRange(ranges[tile]))
        return "a tile's range is reversed";
      if (!covers(stated, ranges[tile])) return "a tile's range exceeds the brick's";
      if (!covers(stated, seen[tile])) return "a sample lies outside the brick's range";
      if (!covers(ranges[tile], seen[tile])) return "a sample lies outside its tile's range";
    }
    pyramid_.throwIfReadsFailed(level, brick);
    if (hasStrayCodes(brick, ranges, codes)) return "a block without contrast has a curvature";
    return "";
  }

  // Ranges against those of the next finer level, which they include, and against all values that
  // they have to cover.
  std::string findRangeFault(int level, const Index3& brick, const Values& values) const {
    const std::vector<ValueRange>& ranges = values.stated;
    std::vector<ValueRange> known = values.seen;
    ValueRange brick_known;
    try {
      if (level > 0) includeFinerRanges(level, brick, known, brick_known);
    } catch (const Error&) {
      return "";  // a finer brick, named by itself
    }
    const ValueRange stated = pyramid_.brickRange(level, brick);
    const char* fault = nullptr;
    for (std::size_t tile = 0; tile < ranges.size(); ++tile) {
      brick_known.include(ranges[tile]);
      if (!covers(ranges[tile], known[tile]))
        fault = "a tile's range lacks values of a finer level";
    }
    if (!covers(stated, brick_known)) fault = "its range lacks values of a finer level";
    try {
      const Index3 tiles = layout_.brickTiles(level, brick);
      for (std::size_t tile = 0; tile < ranges.size() && fault == nullptr; ++tile)
        if (known[tile] != ranges[tile]) {
          includeCoarserSamples(level, tileCells(level, brick, indexAt(tile, tiles)),
                                layout_.tileCells(), known[tile]);
          if (!covers(known[tile], ranges[tile])) fault = "a tile's range is wider than its values";
        }
      if (fault == nullptr && brick_known != stated) {
        includeCoarserSamples(level, layout_.brickCellBox(level, brick), layout_.brickCells(),
                              brick_known);
        if (!covers(brick_known, stated)) fault = "its range is wider than its values";
      }
    } catch (const Error&) {
      return "";  // a coarser brick
    }
    return fault == nullptr || hasFaultyNeighbour(level, brick) ? "" : fault;
  }

  // Samples against the ranges of finer tiles and bricks that take them in.
  std::string findSampleFault(int level, const Index3& brick) const {
    const BrickSamples samples = pyramid_.samples(level, brick);
    const int tile_levels = std::countr_zero(static_cast<std::uint64_t>(layout_.tileCells()));
    const int brick_levels = std::countr_zero(static_cast<std::uint64_t>(layout_.brickCells()));
    for (int down = 1; down <= std::min(brick_levels, level); ++down) {
      const int finer = level - down;
      const Index3 first = brick << std::int64_t{down};
      const Index3 end = glm::min((brick + Index3(1)) << std::int64_t{down}, layout_.bricks(finer));
      std::string fault;
      forEachIndex({first, end - first}, [&](const Index3& at) {
        if (!fault.empty() || takesIn(finer, at, down, samples, down <= tile_levels)) return;
        if (!isFaulty(finer, at, false))
          fault = "a sample lies outside a range of " + brickName(finer, at);
      });
      if (!fault.empty()) return fault;
    }
    pyramid_.throwIfReadsFailed(level, brick);
    return "";
  }

  // True if the ranges of brick `at` of level `finer` include the samples of the brick `down`
  // levels above that lie in them, or if they cannot be read.
  bool takesIn(int finer, const Index3& at, int down, const BrickSamples& samples,
               bool with_tiles) const {
    std::vector<ValueRange> ranges;
    try {
      if (!covers(pyramid_.brickRange(finer, at),
                  rangeOfSamples(samples, coarserBox(layout_.brickCellBox(finer, at), down))))
        return false;
      if (!with_tiles) return true;
      pyramid_.tileRanges(finer, at, ranges);
    } catch (const Error&) {
      return true;
    }
    const Index3 tiles = layout_.brickTiles(finer, at);
    for (std::size_t tile = 0; tile < ranges.size(); ++tile) {
      const IndexBox cells = tileCells(finer, at, indexAt(tile, tiles));
      if (!covers(ranges[tile], rangeOfSamples(samples, coarserBox(cells, down)))) return false;
    }
    return true;
  }

  // True if a brick that findRangeFault() reads is wrong by itself.
  bool hasFaultyNeighbour(int level, const Index3& brick) const {
    if (level > 0) {
      const IndexBox children = childrenOf(level, brick);
      for (std::int64_t i = 0; i < children.size(); ++i)
        if (isFaulty(level - 1, children.first + indexAt(i, children.count), true)) return true;
    }
    for (int up = 1; level + up < lattice_.levels(); ++up) {
      if ((std::int64_t{1} << up) > layout_.brickCells()) break;
      if (isFaulty(level + up, brick >> std::int64_t{up}, false)) return true;
    }
    return false;
  }
  bool isFaulty(int level, const Index3& brick, bool with_ranges) const {
    try {
      Values values;
      return !findOwnFault(level, brick, values).empty() ||
             (with_ranges && !findRangeFault(level, brick, values).empty());
    } catch (const Error&) {
      return true;
    }
  }

  // Of values, a few of which may be: no range has the values of voxels without data.
  static bool covers(const ValueRange& outer, const ValueRange& inner) {
    return inner.min > inner.max || (outer.min <= inner.min && outer.max >= inner.max);
  }
  // Where no voxel has data.
  bool isNoRange(const ValueRange& range) const {
    return pyramid_.tables().spec().has_missing && range.min == std::numeric_limits<float>::max() &&
           range.max == std::numeric_limits<float>::lowest();
  }
  IndexBox childrenOf(int level, const Index3& brick) const {
    const Index3 first = 2L * brick;
    return {first, glm::min(first + Index3(2), layout_.bricks(level - 1)) - first};
  }
  // Cells of `level` in a tile of the brick.
  IndexBox tileCells(int level, const Index3& brick, const Index3& tile) const {
    const IndexBox cells = layout_.brickCellBox(level, brick);
    const Index3 first = cells.first + tile * layout_.tileCells();
    return {first, glm::min(Index3(layout_.tileCells()), cells.end() - first)};
  }
  // Cells of the level `up` above that cover those of a tile or brick, which begin on its lattice.
  static IndexBox coarserBox(const IndexBox& cells, int up) {
    const Index3 first = cells.first >> std::int64_t{up};
    const Index3 end = (cells.end() + Index3((std::int64_t{1} << up) - 1)) >> std::int64_t{up};
    return {first, end - first};
  }

  template <typename F>
  void visitSamples(const BrickSamples& samples, F&& f) const {
    visitVoxelType(pyramid_.tables().spec().voxel_type,
                   [&](auto tag) { f(samples.data<typename decltype(tag)::Type>()); });
  }
  bool arePossible(const BrickSamples& samples) const {
    if (pyramid_.tables().spec().voxel_type != VoxelType::kFloat32) return true;
    bool all = true;
    const bool may_be_missing = pyramid_.tables().spec().has_missing;
    visitSamples(samples, [&](const auto* data) {
      for (std::int64_t i = 0; i < samples.box.size(); ++i) {
        const auto value = static_cast<float>(data[i]);
        all = all && (std::isfinite(value) || (may_be_missing && std::isnan(value)));
      }
    });
    return all;
  }
  // Over the corners of `cells`, which the brick of `samples` holds.
  ValueRange rangeOfSamples(const BrickSamples& samples, const IndexBox& cells) const {
    ValueRange range;
    visitSamples(samples, [&](const auto* data) {
      const Index3 first = cells.first - samples.box.first;
      for (std::int64_t z = first.z; z <= first.z + cells.count.z; ++z)
        for (std::int64_t y = first.y; y <= first.y + cells.count.y; ++y) {
          const auto* row = data + linearIndex(Index3(first.x, y, z), samples.box.count);
          for (std::int64_t x = 0; x <= cells.count.x; ++x)
            range.include(static_cast<float>(row[x]));
        }
    });
    return range;
  }
  void includeSamples(int level, const Index3& brick, const BrickSamples& samples,
                      std::vector<ValueRange>& tiles_seen) const {
    const Index3 tiles = layout_.brickTiles(level, brick);
    for (std::size_t tile = 0; tile < tiles_seen.size(); ++tile)
      tiles_seen[tile].include(
          rangeOfSamples(samples, tileCells(level, brick, indexAt(tile, tiles))));
  }
  void includeFinerRanges(int level, const Index3& brick, std::vector<ValueRange>& tiles_known,
                          ValueRange& brick_known) const {
    const Index3 tiles = layout_.brickTiles(level, brick);
    const std::int64_t tiles_of_brick = layout_.brickCells() / layout_.tileCells();
    const IndexBox children = childrenOf(level, brick);
    std::vector<ValueRange> ranges;
    for (std::int64_t i = 0; i < children.size(); ++i) {
      const Index3 child = children.first + indexAt(i, children.count);
      brick_known.include(pyramid_.brickRange(level - 1, child));
      pyramid_.tileRanges(level - 1, child, ranges);
      const Index3 child_tiles = layout_.brickTiles(level - 1, child);
      for (std::size_t tile = 0; tile < ranges.size(); ++tile) {
        const Index3 at = child * tiles_of_brick + indexAt(tile, child_tiles);
        const Index3 local = at / std::int64_t{2} - brick * tiles_of_brick;
        tiles_known[static_cast<std::size_t>(linearIndex(local, tiles))].include(ranges[tile]);
      }
    }
  }
  // Samples of the levels above whose cells are not longer than `edge` cells of `level`.
  void includeCoarserSamples(int level, const IndexBox& cells, std::int64_t edge,
                             ValueRange& known) const {
    const Index3 brick = cells.first / layout_.brickCells();
    for (int up = 1; (std::int64_t{1} << up) <= edge && level + up < lattice_.levels(); ++up) {
      const Index3 above = brick >> std::int64_t{up};
      known.include(rangeOfSamples(pyramid_.samples(level + up, above), coarserBox(cells, up)));
      pyramid_.throwIfReadsFailed(level + up, above);
    }
  }

  bool hasStrayFields(int level, const Index3& brick) const {
    const BrickIndex::StoredRow row =
        pyramid_.tables().index().storedRow(pyramid_.brickRow(level, brick));
    bool stray = !pyramid_.tables().hasErrorKind() && row.tail.error_bytes != 0;
    for (const format::PartEntry& part : row.parts)
      stray = stray || (part.stored_bytes == 0 && part.checksum != 0);
    const bool is_constant =
        row.parts[0].codec == static_cast<std::uint32_t>(format::Codec::kConstant);
    return stray || (!is_constant && std::bit_cast<std::uint32_t>(row.tail.constant) != 0);
  }
  // A block of one value has no surface.
  bool hasStrayCodes(const Index3& brick, const std::vector<ValueRange>& ranges,
                     const std::vector<std::uint8_t>& codes) const {
    const Index3 blocks = layout_.brickCurvatureBlocks(brick);
    for (std::size_t i = 0; i < codes.size(); ++i) {
      if (codes[i] == 0) continue;
      const Index3 block = indexAt(i / kDeviationCoefficients, blocks);
      const ValueRange range = curvatureBlockRange(layout_, brick, ranges, block);
      if (!(range.min < range.max)) return true;
    }
    return false;
  }

  const PyramidParts& pyramid_;
  const BrickLayout& layout_;
  const Lattice& lattice_;
};

}  // namespace

std::optional<BrickDamage> verifyBrick(const Pyramid& pyramid, int level, const Index3& brick) {
  std::string fault;
  try {
    fault = BrickVerifier(pyramid).findFault(level, brick);
  } catch (const Error& error) {
    fault = error.what();
    const std::string where = "'" + pyramid.path() + "' " + brickName(level, brick);
    if (fault.starts_with(where)) fault.erase(0, fault.find_first_not_of(", ", where.size()));
  }
  if (fault.empty()) return std::nullopt;
  return BrickDamage{level, brick, fault};
}

}  // namespace isobrick
