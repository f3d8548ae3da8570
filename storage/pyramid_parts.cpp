#include "isobrick/storage/pyramid_parts.h"

#include <algorithm>
#include <cstring>

#include "isobrick/storage/deviation_code.h"

namespace isobrick {

namespace {

// The share of the budget that the source of an index may hold: each chunk of a store is in up to
// 27 bricks, of three slabs.
constexpr std::uint64_t kSourceShare = 2;

std::unique_ptr<Level0Source> sourceOf(const PyramidTables& tables, std::uint64_t budget_bytes) {
  if (tables.spec().level0 == Level0Place::kStored) return nullptr;
  return std::make_unique<Level0Source>(SourceRequest{
      tables.path(), tables.provenance(), tables.spec(), budget_bytes / kSourceShare, nullptr});
}

}  // namespace

PyramidParts::PyramidParts(const PyramidTables& tables, std::uint64_t budget_bytes,
                           std::shared_ptr<const BrickSupply> supply)
    : tables_(tables),
      supply_(std::move(supply)),
      rows_(tables.layout()),
      source_(sourceOf(tables, budget_bytes)),
      pager_(
          tables.bytes(),
          [this](std::size_t id) {
            const BrickAddress at = brickAt(id / kPartKinds.size());
            return pagedPart(static_cast<PartKind>(id % kPartKinds.size()), at.level, at.brick);
          },
          budget_bytes, source_.get(), tables.layout().bricks(0)) {}

// Threads of the pager may wait for a server, and the pager for them.
PyramidParts::~PyramidParts() {
  tables_.bytes().abandonReads();
  if (source_ != nullptr) source_->abandon();
}

BrickPager::Part PyramidParts::pagedPart(PartKind kind, int level, const Index3& brick) const {
  const BrickRow row = brickRowOf(level, brick);
  const format::PartEntry& part = row.part(kind);
  const auto codec = static_cast<format::Codec>(part.codec);
  if (codec == format::Codec::kInSource)
    return {brickRow(level, brick), part.stored_bytes, part.checksum, 0, codec};
  // The index has seen to it that the elements of a packed part are fewer than 2^31 bytes.
  const bool is_packed = codec == format::Codec::kLz4 || codec == format::Codec::kZstd;
  const auto elements =
      is_packed ? static_cast<std::uint32_t>(partBytes(spec(), layout(), kind, level, brick)) : 0;
  return {part.offset, part.stored_bytes, part.checksum, elements, codec};
}

BrickPart PyramidParts::acquire(PartKind kind, int level, const Index3& brick,
                                const CancelFlag* cancel) const {
  BrickPart part;
  part.id_ = partId(kind, brickRow(level, brick));
  try {
    part.data_ = pager_.acquire(part.id_, cancel);
  } catch (const ReadFailure& failure) {
    const format::PartEntry entry = brickRowOf(level, brick).part(kind);
    if (source_ != nullptr && !isInFile(entry))
      tables_.fail(
          brickName(level, brick) + ", its voxels in " + source_->name() + ' ' +
              withAdvice(failure.what(), "put them back as they were, or build the index again"),
          {.level = level, .brick = brick});
    ErrorPlace place = tables_.bytes().place(entry.offset);
    place.level = level;
    place.brick = brick;
    tables_.fail(
        brickName(level, brick) + ", " + partName(kind) + ", " +
            std::to_string(entry.stored_bytes) + " bytes at " +
            tables_.bytes().offsetText(entry.offset) + ", " +
            withAdvice(failure.what(),
                       tables_.division() == nullptr ? kDamageAdvice : kDividedDamageAdvice),
        std::move(place));
  }
  part.pager_ = &pager_;
  return part;
}

BrickPager::Fetched PyramidParts::fetch(PartKind kind, int level, const Index3& brick,
                                        const CancelFlag* cancel,
                                        const std::shared_ptr<BrickPager::Room>& room) const {
  if (storedBytes(kind, level, brick) == 0) return BrickPager::Fetched::kBefore;
  return pager_.fetch(partId(kind, brickRow(level, brick)), cancel, room);
}

std::shared_ptr<BrickPager::Room> PyramidParts::reserve(std::span<const PartKind> kinds, int level,
                                                        const Index3& brick,
                                                        std::uint64_t since) const {
  const BrickRow row = brickRowOf(level, brick);
  std::vector<std::size_t> ids;
  for (const PartKind kind : kinds)
    if (row.part(kind).stored_bytes > 0) ids.push_back(partId(kind, brickRow(level, brick)));
  return pager_.reserve(ids, since);
}

void PyramidParts::announce(std::span<const PartAddress> parts) const {
  std::vector<std::size_t> ids;
  for (const auto& [kind, level, brick] : parts)
    if (storedBytes(kind, level, brick) > 0) ids.push_back(partId(kind, brickRow(level, brick)));
  pager_.announce(ids);
}

bool PyramidParts::isCached(PartKind kind, int level, const Index3& brick) const {
  const format::PartEntry part = brickRowOf(level, brick).part(kind);
  return part.stored_bytes == 0 ||
         (isInFile(part) && tables_.bytes().isCached({part.offset, part.stored_bytes}));
}

void PyramidParts::require(PartKind kind, int level, const Index3& brick,
                           const CancelFlag* cancel) const {
  if (storedBytes(kind, level, brick) > 0) acquire(kind, level, brick, cancel);
}

std::optional<BrickPart> PyramidParts::holdIfResident(PartKind kind, int level,
                                                      const Index3& brick) const {
  BrickPart part;
  if (storedBytes(kind, level, brick) == 0) return part;
  part.id_ = partId(kind, brickRow(level, brick));
  part.data_ = pager_.acquireIfResident(part.id_);
  if (part.data_ == nullptr) return std::nullopt;
  part.pager_ = &pager_;
  return part;
}

std::uint64_t PyramidParts::heldBytes(PartKind kind, int level, const Index3& brick) const {
  const BrickPager::Part part = pagedPart(kind, level, brick);
  return part.bytes == 0 ? 0 : pager_.costOf(part);
}

void PyramidParts::withdraw(int level, const Index3& brick) const {
  for (const PartKind kind : kPartKinds) pager_.withdraw(partId(kind, brickRow(level, brick)));
}

void PyramidParts::throwIfReadsFailed(int level, const Index3& brick) const {
  for (const PartKind kind : kPartKinds) throwIfReadFailed(kind, level, brick);
}

void PyramidParts::throwIfReadFailed(PartKind kind, int level, const Index3& brick) const {
  const BrickPager::Part part = pagedPart(kind, level, brick);
  if (part.bytes == 0 || !pager_.isInPlace(part)) return;
  const std::optional<std::uint64_t> page = tables_.bytes().failedOffset(part.offset, part.bytes);
  if (!page) return;
  const std::uint64_t offset = std::max(*page, part.offset);
  tables_.fail(
      brickName(level, brick) + " became unreadable at offset " + std::to_string(offset) +
          " while it was in use (the file was cut short or its disk failed); check the disk "
          "and build it again or restore a copy",
      {.offset = offset, .level = level, .brick = brick});
}

void PyramidParts::throwIfWrittenOver(PartKind kind, int level, const Index3& brick) const {
  const BrickPager::Part part = pagedPart(kind, level, brick);
  if (part.bytes > 0 && pager_.isInPlace(part)) acquire(kind, level, brick);
}

BrickSamples PyramidParts::samples(int level, const Index3& brick, const CancelFlag* cancel) const {
  BrickSamples result;
  result.box = layout().brickSampleBox(level, brick);
  const BrickRow row = brickRowOf(level, brick);
  if (row.part(kSamples).stored_bytes > 0) {
    result.part = acquire(kSamples, level, brick, cancel);
    return result;
  }
  const std::uint64_t bytes = partBytes(spec(), layout(), kSamples, level, brick);
  result.part.made_ = std::make_unique_for_overwrite<std::byte[]>(bytes);
  result.part.data_ = result.part.made_.get();
  if (isSupplied()) {
    supply_->copySamples(brick, result.part.made_.get());
    return result;
  }
  visitVoxelType(spec().voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    std::fill_n(reinterpret_cast<T*>(result.part.made_.get()), result.box.size(),
                static_cast<T>(row.constant));
  });
  return result;
}

BrickPart PyramidParts::suppliedRanges(const Index3& brick) const {
  BrickPart part;
  part.made_ =
      std::make_unique_for_overwrite<std::byte[]>(partBytes(spec(), layout(), kRanges, 0, brick));
  part.data_ = part.made_.get();
  supply_->copyTileRanges(brick, part.made_.get());
  return part;
}

BrickRanges PyramidParts::ranges(int level, const Index3& brick, const CancelFlag* cancel) const {
  const BrickRow row = brickRowOf(level, brick);
  if (isSupplied()) return {suppliedRanges(brick), 0};
  if (row.part(kRanges).stored_bytes == 0) return {{}, row.constant};
  return {acquire(kRanges, level, brick, cancel), 0};
}

void PyramidParts::tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out,
                              const CancelFlag* cancel) const {
  const BrickRanges ranges = this->ranges(level, brick, cancel);
  out.resize(static_cast<std::size_t>(elementCount(layout().brickTiles(level, brick))));
  visitVoxelType(spec().voxel_type, [&](auto tag) {
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] = ranges.tile<typename decltype(tag)::Type>(i);
  });
  throwIfReadFailed(kRanges, level, brick);
}

void PyramidParts::crossedTiles(int level, const Index3& brick, float isovalue,
                                std::vector<std::uint8_t>& out, const CancelFlag* cancel) const {
  const BrickRow row = brickRowOf(level, brick);
  const auto count = static_cast<std::size_t>(elementCount(layout().brickTiles(level, brick)));
  out.assign(count, 0);
  if (isSupplied() ? !supply_->range(brick).crosses(isovalue)
                   : row.part(kRanges).stored_bytes == 0)  // one value does not cross
    return;
  const BrickPart part =
      isSupplied() ? suppliedRanges(brick) : acquire(kRanges, level, brick, cancel);
  visitVoxelType(spec().voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    const std::optional<T> threshold = insideThreshold<T>(isovalue);
    if (!threshold) return;
    const T* pairs = reinterpret_cast<const T*>(part.data());
    std::uint8_t* crossed = out.data();
    const T least = *threshold;
    // Without branches: a loop for vectors.
    for (std::size_t i = 0; i < count; ++i)
      crossed[i] = static_cast<std::uint8_t>(static_cast<unsigned>(pairs[2 * i] < least) &
                                             static_cast<unsigned>(pairs[2 * i + 1] >= least));
  });
  throwIfReadFailed(kRanges, level, brick);
}

void PyramidParts::curvature(const Index3& brick, std::vector<std::uint8_t>& out,
                             const CancelFlag* cancel) const {
  out.clear();
  if (!spec().has_curvature) return;
  const auto count = static_cast<std::size_t>(kDeviationCoefficients *
                                              elementCount(layout().brickCurvatureBlocks(brick)));
  const format::PartEntry entry = brickRowOf(0, brick).part(kCurvature);
  if (entry.stored_bytes == 0) {
    const bool is_absent = entry.codec == static_cast<std::uint32_t>(format::Codec::kAbsent);
    out.assign(count, is_absent ? std::uint8_t{255} : std::uint8_t{0});
    return;
  }
  const BrickPart part = acquire(kCurvature, 0, brick, cancel);
  out.resize(count);
  std::memcpy(out.data(), part.data(), count);
  throwIfReadFailed(kCurvature, 0, brick);
}

}  // namespace isobrick
