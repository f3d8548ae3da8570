#include "isobrick/storage/pyramid_verify.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <exception>
#include <iterator>
#include <limits>
#include <mutex>
#include <set>
#include <span>
#include <thread>
#include <type_traits>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

// Header and tables of a file that begins at `base`, to the bytes that have a meaning.
void addTables(const format::Header& header, std::uint64_t base, std::vector<ByteRange>& extents) {
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
bool isRangeSound(const PagedFile& file, std::uint64_t base, std::uint64_t file_bytes,
                  const ByteRange& range, std::uint64_t checksum) try {
  if (range.offset > file_bytes || range.bytes > file_bytes - range.offset) return false;
  RunningChecksum sum;
  std::vector<std::byte> some(std::min<std::uint64_t>(range.bytes, std::uint64_t{1} << 20));
  for (std::uint64_t at = 0; at < range.bytes; at += some.size()) {
    const std::uint64_t bytes = std::min<std::uint64_t>(some.size(), range.bytes - at);
    file.read(base + range.offset + at, bytes, some.data());
    sum.add(some.data(), bytes);
  }
  return range.bytes == 0 || isChecksum(sum.value(), checksum);
} catch (const ReadFailure&) {
  return false;
}

// The tables of all files of super-bricks, which opening the index does not read.
void addFiles(const PyramidTables& tables, const PyramidDivision& division,
              std::vector<ByteRange>& extents, std::vector<std::string>& faults) {
  const PagedFile& file = tables.bytes();
  for (std::size_t number = 0; number < division.fileCount(); ++number) {
    const std::uint64_t base = division.base(number);
    const std::string name = "'" + file.place(base).path + "'";
    format::Header header{};
    try {
      file.read(base, sizeof header, reinterpret_cast<std::byte*>(&header));
    } catch (const ReadFailure& failure) {
      const std::size_t bricks = division.superBricks().rowCount(number);
      faults.push_back(name + ", with " + std::to_string(bricks) + " bricks, " + failure.what());
      extents.push_back({base, division.file(number).file_bytes});
      continue;
    }
    addTables(header, base, extents);
    const auto check = [&](std::uint64_t offset, std::uint64_t bytes, std::uint64_t checksum,
                           const char* what) {
      if (!isRangeSound(file, base, division.file(number).file_bytes, {offset, bytes}, checksum))
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

template <typename Iterator>
bool isAnySet(Iterator begin, Iterator end) {
  return std::any_of(begin, end, [](auto value) { return value != 0; });
}

void verifyReservedFields(const PyramidTables& tables, std::vector<std::string>& faults) {
  const format::Header& header = tables.header();
  if (isAnySet(std::begin(header.reserved), std::end(header.reserved)) ||
      isAnySet(std::begin(header.reserved_between), std::end(header.reserved_between)))
    faults.emplace_back("reserved bytes of the header are not zero");
  if (header.version < format::kVersionOfSources && header.level0_place != 0)
    faults.emplace_back("the header says where level 0 lies, which its version does not");
  if (header.version == format::kVersion &&
      (header.value_scale != 0 || header.value_offset != 0 || header.missing_voxels != 0))
    faults.emplace_back("the header has a transform of values, which its version has not");
  if (!tables.hasErrorKind() &&
      isAnySet(std::begin(header.error_bins), std::end(header.error_bins)))
    faults.emplace_back("the header has bins of errors, and the bricks have none");
  if (isAnySet(std::begin(header.kinds) + header.kind_count, std::end(header.kinds)))
    faults.emplace_back("kinds of the header that are not counted are not zero");
}

void verifyStatistics(const Pyramid& pyramid, std::vector<std::string>& faults) try {
  if (pyramid.brickRange(pyramid.lattice().levels() - 1, Index3(0)) != pyramid.valueRange())
    faults.emplace_back("the value range in the header is not that of the voxels");
  const VoxelHistogram counts = pyramid.histogram();
  if (counts.counts().front() == 0 || counts.counts().back() == 0)
    faults.emplace_back("the histogram has no voxel of the least or the greatest value");
  static_cast<void>(pyramid.parts().tables().gradients());
} catch (const Error& error) {
  faults.emplace_back(error.what());
}

// Stored parts of all bricks. False if a row is damaged, whose parts are not known then; the brick
// is named by itself.
bool addParts(const BrickIndex& index, std::vector<ByteRange>& extents) {
  bool knows_all = true;
  for (std::size_t number = 0; number < index.count(); ++number) try {
      for (const format::PartEntry& part : index.storedRow(number).parts)
        if (isInFile(part)) extents.push_back({part.offset, part.stored_bytes});
    } catch (const Error&) {
      knows_all = false;
    }
  return knows_all;
}

// Finds bytes between the extents that are not zero, and extents that overlap.
void verifyPadding(const PagedFile& file, std::vector<ByteRange> extents, bool knows_all,
                   const CancelFlag* cancel, std::vector<std::string>& faults) {
  constexpr std::uint64_t kMostGapBytes = std::uint64_t{64} << 10;
  constexpr std::size_t kGapsAtOnce = 512;  // a server sends many in the time of one
  // How often, and the first place.
  struct Findings {
    std::uint64_t count = 0, first = 0;
    void add(std::uint64_t offset) {
      if (count++ == 0) first = offset;
    }
  };
  Findings strays, overlaps;
  std::vector<ByteRange> gaps;  // up to one that is not in the file
  std::sort(extents.begin(), extents.end(),
            [](const ByteRange& a, const ByteRange& b) { return a.offset < b.offset; });
  extents.push_back({file.size(), 0});
  std::uint64_t end = 0;
  for (const ByteRange& extent : extents) {
    if (extent.offset < end && extent.bytes > 0) overlaps.add(extent.offset);
    for (; end < extent.offset && file.holds(end, 0); end += gaps.back().bytes)
      gaps.push_back({end, std::min(extent.offset - end, kMostGapBytes)});
    end = std::max(end, extent.offset + extent.bytes);
  }
  std::vector<std::byte> read(kMostGapBytes);
  for (std::size_t gap = 0; gap < gaps.size(); ++gap) {
    if (cancel != nullptr) cancel->check();
    if (gap % kGapsAtOnce == 0 && file.isRemote())
      file.announce(std::span(gaps).subspan(gap, std::min(kGapsAtOnce, gaps.size() - gap)));
    const auto [offset, bytes] = gaps[gap];
    try {
      if (!file.holds(offset, bytes)) throw ReadFailure("cannot be read");
      file.read(offset, bytes, read.data());
    } catch (const ReadFailure& failure) {
      faults.push_back("the padding at offset " + std::to_string(offset) + " " + failure.what());
      return;
    }
    for (std::uint64_t i = 0; i < bytes; ++i)
      if (read[i] != std::byte{0}) strays.add(offset + i);
  }
  // The parts of a damaged row lie in bytes that look like padding.
  if (strays.count > 0 && knows_all)
    faults.push_back("padding that is not zero: " + std::to_string(strays.count) +
                     " bytes, the first at offset " + std::to_string(strays.first));
  if (overlaps.count > 0)
    faults.push_back("parts that overlap: " + std::to_string(overlaps.count) +
                     ", the first at offset " + std::to_string(overlaps.first));
}

}  // namespace

std::vector<std::string> verifyRest(const Pyramid& pyramid, const CancelFlag* cancel) {
  const PyramidTables& tables = pyramid.parts().tables();
  std::vector<std::string> faults;
  verifyReservedFields(tables, faults);
  verifyStatistics(pyramid, faults);

  std::vector<ByteRange> extents;
  addTables(tables.header(), 0, extents);
  if (const PyramidDivision* const division = tables.division())
    addFiles(tables, *division, extents, faults);
  const bool knows_all_parts = addParts(tables.index(), extents);

  verifyPadding(tables.bytes(), std::move(extents), knows_all_parts, cancel, faults);
  return faults;
}

// ---- bricks

namespace {

// Fields that nothing uses are zero.
bool hasStrayFields(const PyramidTables& tables, std::size_t number) {
  const BrickIndex::StoredRow row = tables.index().storedRow(number);
  const bool is_constant =
      row.parts[0].codec == static_cast<std::uint32_t>(format::Codec::kConstant);
  return (!tables.hasErrorKind() && row.tail.error_bytes != 0) ||
         (!is_constant && std::bit_cast<std::uint32_t>(row.tail.constant) != 0) ||
         std::any_of(row.parts.begin(), row.parts.end(), [](const format::PartEntry& part) {
           return part.stored_bytes == 0 && part.checksum != 0;
         });
}

// Of samples that may have no data, and are not finite then.
template <typename T>
bool areFinite(std::span<const T> samples, bool may_be_missing) {
  if constexpr (std::is_floating_point_v<T>)
    return std::all_of(samples.begin(), samples.end(), [&](T value) {
      return std::isfinite(value) || (may_be_missing && std::isnan(value));
    });
  return true;
}

// Over the corners of `cells`, which the brick of `samples` holds.
template <typename T>
ValueRange rangeOfSamples(const BrickSamples& samples, const IndexBox& cells) {
  ValueRange range;
  forEachIndex({cells.first - samples.box.first, cells.count + Index3(1)}, [&](const Index3& at) {
    range.include(static_cast<float>(samples.data<T>()[linearIndex(at, samples.box.count)]));
  });
  return range;
}

// An empty range, as that of voxels without data, is covered.
bool covers(const ValueRange& outer, const ValueRange& inner) {
  return inner.min > inner.max || (outer.min <= inner.min && outer.max >= inner.max);
}

// Contradictions within a brick: between samples, ranges of tiles, that of the brick, and codes.
template <typename T>
const char* contradictionIn(const PyramidParts& pyramid, int level, const Index3& brick) {
  using Limits = std::numeric_limits<float>;
  constexpr ValueRange kNoData{Limits::max(), Limits::lowest()};
  const PyramidSpec& spec = pyramid.tables().spec();
  const BrickLayout& layout = pyramid.tables().layout();
  const BrickSamples samples = pyramid.samples(level, brick);
  std::vector<ValueRange> ranges;
  pyramid.tileRanges(level, brick, ranges);
  std::vector<std::uint8_t> codes;
  if (level == 0 && pyramid.storedBytes(PartKind::kCurvature, level, brick) > 0)
    pyramid.curvature(brick, codes);
  if (hasStrayFields(pyramid.tables(), pyramid.brickRow(level, brick)))
    return "a field that nothing uses is not zero";
  const auto count = static_cast<std::size_t>(samples.box.size());
  if (!areFinite(std::span(samples.data<T>(), count), spec.has_missing))
    return "a sample is not a finite number";
  const ValueRange stated = pyramid.brickRange(level, brick);
  const IndexBox cells = layout.brickCellBox(level, brick);
  const Index3 tiles = layout.brickTiles(level, brick);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const ValueRange& tile = ranges[i];
    if (!(tile.min <= tile.max) && !(spec.has_missing && tile == kNoData))
      return "a tile's range is reversed";
    if (!covers(stated, tile)) return "a tile's range exceeds the brick's";
    const Index3 first = layout.tileCells() * indexAt(static_cast<std::int64_t>(i), tiles);
    const Index3 edge = glm::min(Index3(layout.tileCells()), cells.count - first);
    if (!covers(tile, rangeOfSamples<T>(samples, {cells.first + first, edge})))
      return "a sample lies outside its tile's range";
  }
  pyramid.throwIfReadsFailed(level, brick);
  const Index3 blocks = layout.brickCurvatureBlocks(brick);
  for (std::size_t i = 0; i < codes.size(); ++i) {
    const auto block = static_cast<std::int64_t>(i / kDeviationCoefficients);
    const ValueRange range = curvatureBlockRange(layout, brick, ranges, indexAt(block, blocks));
    if (codes[i] != 0 && !(range.min < range.max))
      return "a block without contrast has a curvature";
  }
  return nullptr;
}

}  // namespace

std::optional<BrickDamage> verifyBrick(const Pyramid& pyramid, int level, const Index3& brick) try {
  const char* const fault = visitVoxelType(pyramid.spec().voxel_type, [&](auto tag) {
    return contradictionIn<typename decltype(tag)::Type>(pyramid.parts(), level, brick);
  });
  if (fault == nullptr) return std::nullopt;
  return BrickDamage{level, brick, fault};
} catch (const Error& error) {
  std::string fault = error.what();
  const std::string where = "'" + pyramid.path() + "' " + brickName(level, brick);
  if (fault.starts_with(where)) fault.erase(0, fault.find_first_not_of(", ", where.size()));
  return BrickDamage{level, brick, fault};
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
    try {
      tables.bytes().read(division->base(number), 1, &first);
    } catch (const ReadFailure&) {
      lost.insert(number);
    }
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
