#include "isobrick/storage/pyramid_verify.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <exception>
#include <mutex>
#include <set>
#include <span>
#include <thread>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

constexpr std::size_t kGapsAtOnce = 512;

bool hasErrorKind(const format::Header& header) {
  const auto* const end = header.kinds + header.kind_count;
  return std::find(header.kinds, end, format::kErrorKind) != end;
}

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
    if (level == 0) pyramid_.curvature(brick, codes);
    if (hasStrayFields(level, brick)) return "a field that nothing uses is not zero";
    if (!areFinite(samples)) return "a sample is not a finite number";
    std::vector<ValueRange>& seen = values.seen;
    seen.assign(ranges.size(), {});
    includeSamples(level, brick, samples, seen);
    const ValueRange stated = pyramid_.brickRange(level, brick);
    for (std::size_t tile = 0; tile < ranges.size(); ++tile) {
      if (!(ranges[tile].min <= ranges[tile].max)) return "a tile's range is reversed";
      if (!covers(stated, ranges[tile])) return "a tile's range exceeds the brick's";
      if (!covers(stated, seen[tile])) return "a sample lies outside the brick's range";
      if (!covers(ranges[tile], seen[tile])) return "a sample lies outside its tile's range";
    }
    pyramid_.throwIfReadsFailed(level, brick);
    if (hasStrayCodes(brick, ranges, codes)) return "a tile without contrast has a curvature";
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

  static bool covers(const ValueRange& outer, const ValueRange& inner) {
    return outer.min <= inner.min && outer.max >= inner.max;
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
  bool areFinite(const BrickSamples& samples) const {
    if (pyramid_.tables().spec().voxel_type != VoxelType::kFloat32) return true;
    bool finite = true;
    visitSamples(samples, [&](const auto* data) {
      for (std::int64_t i = 0; i < samples.box.size(); ++i)
        finite = finite && std::isfinite(static_cast<float>(data[i]));
    });
    return finite;
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
    bool stray = !hasErrorKind(pyramid_.tables().header()) && row.tail.error_bytes != 0;
    for (const format::PartEntry& part : row.parts)
      stray = stray || (part.stored_bytes == 0 && part.checksum != 0);
    const bool is_constant =
        row.parts[0].codec == static_cast<std::uint32_t>(format::Codec::kConstant);
    return stray || (!is_constant && std::bit_cast<std::uint32_t>(row.tail.constant) != 0);
  }
  bool hasStrayCodes(const Index3& brick, const std::vector<ValueRange>& ranges,
                     const std::vector<std::uint8_t>& codes) const {
    const Index3 nodes = layout_.brickNodes(brick);
    const Index3 tiles = layout_.brickTiles(0, brick);
    for (std::size_t node = 0; 3 * node < codes.size(); ++node) {
      if (codes[3 * node] == 0 && codes[3 * node + 1] == 0 && codes[3 * node + 2] == 0) continue;
      const Index3 tile = 2L * indexAt(node, nodes) / layout_.tileCells();
      const ValueRange& range = ranges[static_cast<std::size_t>(linearIndex(tile, tiles))];
      if (range.min == range.max) return true;
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

namespace {

// Bytes that have a meaning.
struct Extent {
  std::uint64_t offset, bytes;
};

// Header and tables of a file that begins at `base`.
void addTables(const format::Header& header, std::uint64_t base, std::vector<Extent>& extents) {
  const auto add = [&](std::uint64_t offset, std::uint64_t bytes) {
    if (bytes > 0) extents.push_back({base + offset, bytes});
  };
  add(0, sizeof header);
  add(header.level_table_offset, header.level_count * sizeof(format::LevelRow));
  add(header.brick_table_offset, header.brick_count * format::rowBytes(header.kind_count));
  add(header.provenance_offset, header.provenance_bytes);
  for (const format::PartEntry& part : {header.histogram, header.gradients, header.division})
    add(part.offset, part.stored_bytes);
}

// Whether a range of the file that begins at `base` and has `file_bytes` has this checksum.
bool isUndamaged(const PagedFile& file, std::uint64_t base, std::uint64_t file_bytes,
                 const ByteRange& range, std::uint64_t checksum) {
  if (range.offset > file_bytes || range.bytes > file_bytes - range.offset) return false;
  RunningChecksum sum;
  std::vector<std::byte> some(std::min<std::uint64_t>(range.bytes, std::uint64_t{1} << 20));
  for (std::uint64_t at = 0; at < range.bytes; at += some.size()) {
    const std::uint64_t bytes = std::min<std::uint64_t>(some.size(), range.bytes - at);
    if (!file.read(base + range.offset + at, bytes, some.data())) return false;
    sum.add(some.data(), bytes);
  }
  return range.bytes == 0 || sum.value() == checksum;
}

// The tables of all files of super-bricks, which opening the index does not read.
void addFiles(const PyramidTables& tables, const PyramidDivision& division,
              std::vector<Extent>& extents, std::vector<std::string>& faults) {
  const PagedFile& file = tables.bytes();
  for (std::size_t number = 0; number < division.fileCount(); ++number) {
    const std::uint64_t base = division.base(number);
    std::string name = "'";
    name.append(file.place(base).path).append("'");
    format::Header header{};
    RangeReader::Failure why = "cannot be read";
    if (!file.read(base, sizeof header, reinterpret_cast<std::byte*>(&header), &why)) {
      const std::size_t bricks = division.superBricks().rowCount(number);
      faults.push_back(name + ", with " + std::to_string(bricks) + " bricks, " + why);
      extents.push_back({base, division.file(number).file_bytes});
      continue;
    }
    addTables(header, base, extents);
    const auto check = [&](std::uint64_t offset, std::uint64_t bytes, std::uint64_t checksum,
                           const char* what) {
      if (!isUndamaged(file, base, division.file(number).file_bytes, {offset, bytes}, checksum))
        faults.push_back(name + " has a damaged " + what);
    };
    check(header.level_table_offset, header.level_count * sizeof(format::LevelRow),
          header.level_table_checksum, "level table");
    check(header.provenance_offset, header.provenance_bytes, header.provenance_checksum,
          "provenance");
    check(header.division.offset, header.division.stored_bytes, header.division.checksum,
          "table for the join");
    if (division.file(number).reserved != 0)
      faults.push_back("reserved bytes of the entry of " + name + " are not zero");
  }
  for (std::size_t number = 0; number < division.fileCount(); ++number) {
    const format::PartEntry& corrections = division.file(number).corrections;
    if (corrections.stored_bytes > 0)
      extents.push_back({corrections.offset, corrections.stored_bytes});
  }
}

}  // namespace

std::vector<std::string> verifyRest(const Pyramid& pyramid, const CancelFlag* cancel) {
  const PyramidTables& tables = pyramid.parts().tables();
  const format::Header& header = tables.header();
  std::vector<std::string> faults;
  const auto isSet = [](std::uint8_t byte) { return byte != 0; };
  if (std::any_of(std::begin(header.reserved), std::end(header.reserved), isSet) ||
      std::any_of(std::begin(header.reserved_between), std::end(header.reserved_between), isSet))
    faults.emplace_back("reserved bytes of the header are not zero");
  if (!hasErrorKind(header) &&
      std::any_of(std::begin(header.error_bins), std::end(header.error_bins), isSet))
    faults.emplace_back("the header has bins of errors, and the bricks have none");
  if (std::any_of(header.kinds + header.kind_count, std::end(header.kinds),
                  [](std::uint32_t kind) { return kind != 0; }))
    faults.emplace_back("kinds of the header that are not counted are not zero");
  try {
    if (pyramid.brickRange(pyramid.lattice().levels() - 1, Index3(0)) != pyramid.valueRange())
      faults.emplace_back("the value range in the header is not that of the voxels");
    const VoxelHistogram counts = pyramid.histogram();
    if (counts.counts().front() == 0 || counts.counts().back() == 0)
      faults.emplace_back("the histogram has no voxel of the least or the greatest value");
    static_cast<void>(tables.gradients());
  } catch (const Error& error) {
    faults.emplace_back(error.what());
  }

  bool knows_all_parts = true;
  std::vector<Extent> extents;
  addTables(header, 0, extents);
  if (const PyramidDivision* const division = tables.division())
    addFiles(tables, *division, extents, faults);
  for (std::size_t number = 0; number < tables.index().count(); ++number) try {
      for (const format::PartEntry& part : tables.index().storedRow(number).parts)
        if (part.stored_bytes > 0) extents.push_back({part.offset, part.stored_bytes});
    } catch (const Error&) {  // a damaged row: the brick is named by itself
      knows_all_parts = false;
    }
  std::sort(extents.begin(), extents.end(),
            [](const Extent& a, const Extent& b) { return a.offset < b.offset; });
  extents.push_back({tables.bytes().size(), 0});

  std::uint64_t at = 0, stray_bytes = 0, first_stray = 0, overlaps = 0, first_overlap = 0;
  std::vector<std::byte> padding(std::size_t{64} << 10);
  std::vector<ByteRange> gaps;
  for (const Extent& extent : extents) {
    if (extent.offset < at && extent.bytes > 0 && overlaps++ == 0) first_overlap = extent.offset;
    for (; at < extent.offset; at += gaps.back().bytes) {
      gaps.push_back({at, std::min<std::uint64_t>(extent.offset - at, padding.size())});
      if (tables.bytes().holds(at, gaps.back().bytes)) continue;
      faults.push_back("the padding at offset " + std::to_string(at) + " cannot be read");
      return faults;
    }
    at = std::max(at, extent.offset + extent.bytes);
  }
  for (std::size_t gap = 0; gap < gaps.size(); ++gap) {
    if (cancel != nullptr) cancel->check();
    // A server sends many in the time of one.
    if (gap % kGapsAtOnce == 0 && tables.bytes().isRemote())
      tables.bytes().announce(
          std::span(gaps).subspan(gap, std::min(kGapsAtOnce, gaps.size() - gap)));
    const auto [offset, bytes] = gaps[gap];
    RangeReader::Failure why = "cannot be read";
    if (!tables.bytes().read(offset, bytes, padding.data(), &why)) {
      faults.push_back("the padding at offset " + std::to_string(offset) + " " + why);
      return faults;
    }
    for (std::uint64_t i = 0; i < bytes; ++i)
      if (padding[i] != std::byte{0} && stray_bytes++ == 0) first_stray = offset + i;
  }
  // The parts of a damaged row lie in bytes that look like padding.
  if (stray_bytes > 0 && knows_all_parts)
    faults.push_back("padding that is not zero: " + std::to_string(stray_bytes) +
                     " bytes, the first at offset " + std::to_string(first_stray));
  if (overlaps > 0)
    faults.push_back("parts that overlap: " + std::to_string(overlaps) + ", the first at offset " +
                     std::to_string(first_overlap));
  return faults;
}

namespace {

// A server is asked for the bricks that come so much later.
constexpr std::size_t kBricksAhead = 64;

void announceBrick(const PyramidParts& parts, std::size_t row) {
  if (row >= parts.brickCount()) return;
  const BrickAddress at = parts.brickAt(row);
  std::array<PyramidParts::PartAddress, kPartKinds.size()> all;
  std::transform(kPartKinds.begin(), kPartKinds.end(), all.begin(), [&](PartKind kind) {
    return PyramidParts::PartAddress{kind, at.level, at.brick};
  });
  try {
    parts.announce(all);
  } catch (const Error&) {  // of a damaged row, which has its turn
  }
}

// The files of super-bricks that cannot be opened: verifyRest() names each of them once.
std::set<std::size_t> lostFiles(const PyramidTables& tables) {
  std::set<std::size_t> lost;
  const PyramidDivision* const division = tables.division();
  for (std::size_t number = 0; division != nullptr && number < division->fileCount(); ++number) {
    std::byte first{};
    if (!tables.bytes().read(division->base(number), 1, &first)) lost.insert(number);
  }
  return lost;
}

}  // namespace

PyramidFaults verifyPyramid(const Pyramid& pyramid, const VerifyOptions& options) {
  PyramidFaults faults;
  faults.rest = verifyRest(pyramid, options.cancel);
  const std::set<std::size_t> lost = lostFiles(pyramid.parts().tables());
  for (const std::size_t file : lost)
    faults.lost_bricks += pyramid.parts().tables().division()->superBricks().rowCount(file);
  const std::size_t count = pyramid.parts().brickCount();
  std::atomic<std::size_t> next{0};
  std::mutex mutex;  // guards all below
  std::size_t done = 0;
  std::vector<std::pair<std::size_t, BrickDamage>> damages;  // with their rows
  std::exception_ptr failure;
  const auto verifyNext = [&] {
    try {
      for (std::size_t row = next++; row < count; row = next++) {
        if (options.cancel != nullptr) options.cancel->check();
        if (lost.contains(pyramid.parts().tables().index().fileOf(row))) continue;
        if (pyramid.parts().isRemote()) announceBrick(pyramid.parts(), row + kBricksAhead);
        const BrickAddress at = pyramid.parts().brickAt(row);
        std::optional<BrickDamage> damage = verifyBrick(pyramid, at.level, at.brick);
        const std::lock_guard lock(mutex);
        if (damage) damages.emplace_back(row, *std::move(damage));
        if (options.progress)
          options.progress(static_cast<double>(++done) / static_cast<double>(count));
      }
    } catch (...) {
      next = count;
      const std::lock_guard lock(mutex);
      failure = std::current_exception();
    }
  };
  {
    const std::size_t wanted = options.threads > 0 ? static_cast<std::size_t>(options.threads)
                                                   : std::thread::hardware_concurrency();
    std::vector<std::jthread> threads;
    try {
      while (threads.size() + 1 < std::min(wanted, count)) threads.emplace_back(verifyNext);
    } catch (const std::exception&) {  // the existing threads do the work
    }
    verifyNext();
  }
  if (failure) std::rethrow_exception(failure);
  std::sort(damages.begin(), damages.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  for (auto& [row, damage] : damages) faults.bricks.push_back(std::move(damage));
  return faults;
}

}  // namespace isobrick
