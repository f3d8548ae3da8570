#include "isobrick/storage/pyramid_verify.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <exception>
#include <iterator>
#include <mutex>
#include <set>
#include <span>
#include <thread>
#include <utility>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
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

template <typename Iterator>
bool isAnySet(Iterator begin, Iterator end) {
  return std::any_of(begin, end, [](auto value) { return value != 0; });
}

void verifyReservedFields(const PyramidTables& tables, std::vector<std::string>& faults) {
  const format::Header& header = tables.header();
  if (isAnySet(std::begin(header.reserved), std::end(header.reserved)) ||
      isAnySet(std::begin(header.reserved_between), std::end(header.reserved_between)))
    faults.emplace_back("reserved bytes of the header are not zero");
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
bool addParts(const BrickIndex& index, std::vector<Extent>& extents) {
  bool knows_all = true;
  for (std::size_t number = 0; number < index.count(); ++number) try {
      for (const format::PartEntry& part : index.storedRow(number).parts)
        if (part.stored_bytes > 0) extents.push_back({part.offset, part.stored_bytes});
    } catch (const Error&) {
      knows_all = false;
    }
  return knows_all;
}

// Occurrences of something, and the offset of the first one.
struct Findings {
  std::uint64_t count = 0, first = 0;
  void add(std::uint64_t offset) {
    if (count++ == 0) first = offset;
  }
};

// The bytes of a file between its extents, and extents that begin before the end of others.
struct Padding {
  static constexpr std::uint64_t kMostGapBytes = std::uint64_t{64} << 10;
  std::vector<ByteRange> gaps;  // up to one that is not in the file
  Findings overlaps;
};

Padding paddingBetween(std::vector<Extent> extents, const PagedFile& file) {
  std::sort(extents.begin(), extents.end(),
            [](const Extent& a, const Extent& b) { return a.offset < b.offset; });
  extents.push_back({file.size(), 0});
  Padding padding;
  std::uint64_t at = 0;
  for (const Extent& extent : extents) {
    if (extent.offset < at && extent.bytes > 0) padding.overlaps.add(extent.offset);
    for (; at < extent.offset; at += padding.gaps.back().bytes) {
      padding.gaps.push_back({at, std::min(extent.offset - at, Padding::kMostGapBytes)});
      if (!file.holds(at, padding.gaps.back().bytes)) return padding;
    }
    at = std::max(at, extent.offset + extent.bytes);
  }
  return padding;
}

// Adds the bytes of the gaps that are not zero. False, with a fault, if a gap cannot be read.
bool readPadding(const PagedFile& file, std::span<const ByteRange> gaps, const CancelFlag* cancel,
                 Findings& strays, std::vector<std::string>& faults) {
  constexpr std::size_t kGapsAtOnce = 512;  // a server sends many in the time of one
  const auto fail = [&](std::uint64_t offset, RangeReader::Failure why) {
    faults.push_back("the padding at offset " + std::to_string(offset) + " " + why);
    return false;
  };
  RangeReader::Failure why = "cannot be read";
  if (!gaps.empty() && !file.holds(gaps.back().offset, gaps.back().bytes))
    return fail(gaps.back().offset, why);
  std::vector<std::byte> read(Padding::kMostGapBytes);
  for (std::size_t gap = 0; gap < gaps.size(); ++gap) {
    if (cancel != nullptr) cancel->check();
    if (gap % kGapsAtOnce == 0 && file.isRemote())
      file.announce(gaps.subspan(gap, std::min(kGapsAtOnce, gaps.size() - gap)));
    const auto [offset, bytes] = gaps[gap];
    if (!file.read(offset, bytes, read.data(), &why)) return fail(offset, why);
    for (std::uint64_t i = 0; i < bytes; ++i)
      if (read[i] != std::byte{0}) strays.add(offset + i);
  }
  return true;
}

}  // namespace

std::vector<std::string> verifyRest(const Pyramid& pyramid, const CancelFlag* cancel) {
  const PyramidTables& tables = pyramid.parts().tables();
  std::vector<std::string> faults;
  verifyReservedFields(tables, faults);
  verifyStatistics(pyramid, faults);

  std::vector<Extent> extents;
  addTables(tables.header(), 0, extents);
  if (const PyramidDivision* const division = tables.division())
    addFiles(tables, *division, extents, faults);
  const bool knows_all_parts = addParts(tables.index(), extents);

  const Padding padding = paddingBetween(std::move(extents), tables.bytes());
  Findings strays;
  if (!readPadding(tables.bytes(), padding.gaps, cancel, strays, faults)) return faults;
  // The parts of a damaged row lie in bytes that look like padding.
  if (strays.count > 0 && knows_all_parts)
    faults.push_back("padding that is not zero: " + std::to_string(strays.count) +
                     " bytes, the first at offset " + std::to_string(strays.first));
  if (padding.overlaps.count > 0)
    faults.push_back("parts that overlap: " + std::to_string(padding.overlaps.count) +
                     ", the first at offset " + std::to_string(padding.overlaps.first));
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
