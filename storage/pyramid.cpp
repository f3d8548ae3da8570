#include "isobrick/storage/pyramid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/brick_index.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/usable_geometry.h"

namespace isobrick {
namespace {

bool isPowerOfTwoWithin(std::uint32_t value, std::uint32_t least, std::uint32_t greatest) {
  return std::has_single_bit(value) && value >= least && value <= greatest;
}

bool areKindsSane(const format::Header& header) {
  if (header.kind_count < 2 || header.kind_count > format::kMostKinds) return false;
  for (std::uint32_t i = 1; i < header.kind_count; ++i)
    if (header.kinds[i] <= header.kinds[i - 1]) return false;
  return header.kinds[0] == static_cast<std::uint32_t>(PartKind::kSamples) &&
         header.kinds[1] == static_cast<std::uint32_t>(PartKind::kRanges);
}

// True where a voxel of the type may have the value.
bool isVoxel(VoxelType type, double value) {
  return visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    using Limits = std::numeric_limits<T>;
    return value >= static_cast<double>(Limits::lowest()) &&
           value <= static_cast<double>(Limits::max()) &&
           static_cast<double>(static_cast<T>(value)) == value;
  });
}

// Of a header whose voxel type is one of the five.
bool areValuesSane(const format::Header& header) {
  const auto type = static_cast<VoxelType>(header.voxel_type);
  if (!isVoxel(type, header.value_min) || !isVoxel(type, header.value_max) ||
      header.value_min > header.value_max)
    return false;
  // Noise is the median of second differences, less a factor; twice the range bounds it.
  return header.noise >= 0 && header.noise <= 2 * (header.value_max - header.value_min);
}

// Bins lie where values are. Those of a float32 may reach beyond by their width in the histogram.
bool areBinsNearValues(const ErrorBins& bins, const ValueRange& values) {
  const double most = std::max(std::abs(static_cast<double>(values.min)),
                               std::abs(static_cast<double>(values.max)));
  const double reach = most * (1 + 1.0 / 64) + 0x1p-120;
  return std::abs(bins.first) <= reach && bins.width * bins.count <= 2 * reach;
}

bool hasKind(const format::Header& header, PartKind kind) {
  const auto* const end = header.kinds + header.kind_count;
  return std::find(header.kinds, end, static_cast<std::uint32_t>(kind)) != end;
}

}  // namespace

Pyramid::Pyramid(const std::string& path, std::uint64_t budget_bytes, FileAccess access)
    : file_(path, access), budget_bytes_(budget_bytes) {
  readHeader();
}
Pyramid::~Pyramid() = default;

void Pyramid::fail(const std::string& what, ErrorPlace place) const {
  place.path = path();
  throw Error("'" + path() + "' " + what, std::move(place));
}

void Pyramid::readHeader() {
  constexpr std::uint64_t kSize = sizeof(format::Header);
  format::Header header{};
  if (file_.size() >= kSize && !file_.read(0, kSize, reinterpret_cast<std::byte*>(&header)))
    fail("cannot be read at offset 0; check the disk");
  if (std::memcmp(header.magic, format::kMagic, sizeof header.magic) != 0)
    fail("is not an isobrick pyramid; make one with 'isobrick build'");
  if (header.version != format::kVersion)
    fail("has format version " + std::to_string(header.version) + ", this program reads version " +
         std::to_string(format::kVersion) + "; build it again or use the program that wrote it");
  if (header.header_bytes != kSize ||
      header.header_checksum != checksum64(&header, offsetof(format::Header, header_checksum)))
    fail("has a damaged header; build it again");
  if (header.file_bytes != file_.size())
    fail("has " + std::to_string(file_.size()) + " bytes where its header says " +
         std::to_string(header.file_bytes) + ": it was cut or changed; build it again");

  bool sane = header.voxel_type < kVoxelTypeCount && header.filter <= 1 && areKindsSane(header) &&
              isPowerOfTwoWithin(header.brick_cells, 4, 256) &&
              isPowerOfTwoWithin(header.tile_cells, 2, header.brick_cells) &&
              areValuesSane(header) && std::isfinite(header.curvature_epsilon) &&
              header.curvature_epsilon >= 0 &&
              header.length_unit <= static_cast<std::uint32_t>(LengthUnit::kMillimetre);
  for (int axis = 0; axis < 3; ++axis) {
    sane = sane && header.dims[axis] >= 2 &&
           header.dims[axis] <= static_cast<std::uint64_t>(kMaxVoxelsPerAxis) &&
           std::isfinite(header.spacing[axis]) && header.spacing[axis] > 0 &&
           std::isfinite(header.origin[axis]);
  }
  for (const double d : header.direction) sane = sane && std::isfinite(d);
  if (!sane) fail("has impossible numbers in its header; build it again");

  for (int axis = 0; axis < 3; ++axis) {
    spec_.voxels[axis] = static_cast<std::int64_t>(header.dims[axis]);
    spec_.geometry.spacing[axis] = header.spacing[axis];
    spec_.geometry.origin[axis] = header.origin[axis];
    for (int row = 0; row < 3; ++row)
      spec_.geometry.direction[axis][row] = header.direction[3 * axis + row];
  }
  spec_.geometry.unit = static_cast<LengthUnit>(header.length_unit);
  if (!isUsableGeometry(spec_.geometry))
    fail("has a spacing, an origin or directions that give no usable positions; build it again");
  spec_.voxel_type = static_cast<VoxelType>(header.voxel_type);
  spec_.filter = static_cast<format::Filter>(header.filter);
  spec_.brick_cells = header.brick_cells;
  spec_.tile_cells = header.tile_cells;
  spec_.has_curvature = hasKind(header, kCurvature);
  spec_.curvature_epsilon = header.curvature_epsilon;
  spec_.error_level = hasKind(header, kError) ? static_cast<int>(header.error_last_level) : 0;
  value_range_ = {static_cast<float>(header.value_min), static_cast<float>(header.value_max)};
  layout_ = spec_.layout();
  header_ = header;
  if (hasKind(header, kError)) readErrorBins(header);
  if (header.level_count != static_cast<std::uint32_t>(lattice().levels()))
    fail("has a wrong number of levels; build it again");
  readTables(header);
}

void Pyramid::readErrorBins(const format::Header& header) {
  error_bins_ = {header.error_first, header.error_width, header.error_bins, spec_.error_level};
  // Far enough from underflow.
  if (!(error_bins_.width >= 0x1p-200) || error_bins_.count == 0 ||
      error_bins_.count > ErrorBins::kMost || !areBinsNearValues(error_bins_, value_range_) ||
      spec_.error_level < kFirstErrorLevel ||
      spec_.error_level > std::min(kMostErrorLevel, lattice().levels() - 1))
    fail("has impossible bins of errors in its header; build it again");
}

std::vector<std::byte> Pyramid::readTable(std::uint64_t offset, std::uint64_t bytes,
                                          std::uint64_t checksum, const char* name) const {
  std::vector<std::byte> table;
  if (file_.holds(offset, bytes)) {
    table.resize(bytes);
    if (file_.read(offset, bytes, table.data()) && checksum64(table.data(), bytes) == checksum)
      return table;
  }
  fail(std::string("has a damaged ") + name + "; build it again");
}

void Pyramid::readTables(const format::Header& header) {
  // The layout follows from the header, so the tables must have just the sizes that it gives.
  index_ = std::make_unique<BrickIndex>(file_, spec_, header);
  std::vector<format::LevelRow> levels(static_cast<std::size_t>(lattice().levels()));
  const std::uint64_t level_bytes = levels.size() * sizeof(format::LevelRow);
  std::memcpy(
      levels.data(),
      readTable(header.level_table_offset, level_bytes, header.level_table_checksum, "level table")
          .data(),
      level_bytes);
  for (int level = 0; level < lattice().levels(); ++level) {
    const format::LevelRow& row = levels[static_cast<std::size_t>(level)];
    const Index3 samples = lattice().samples(level);
    const Index3 bricks = layout_.bricks(level);
    bool same = row.first_brick == index_->firstOfLevel(level);
    for (int axis = 0; axis < 3; ++axis)
      same = same && row.samples[axis] == static_cast<std::uint64_t>(samples[axis]) &&
             row.bricks[axis] == static_cast<std::uint64_t>(bricks[axis]);
    if (!same) fail("has a level table that contradicts its header; build it again");
  }
  if (header.provenance_bytes > kMostProvenanceBytes)
    fail("has a provenance of " + std::to_string(header.provenance_bytes) +
         " bytes, which is more than any pyramid has; build it again");
  const std::vector<std::byte> text = readTable(header.provenance_offset, header.provenance_bytes,
                                                header.provenance_checksum, "provenance");
  provenance_.assign(reinterpret_cast<const char*>(text.data()), text.size());

  pager_ = std::make_unique<BrickPager>(
      file_,
      [this](std::size_t id) {
        const BrickAddress at = brickAt(id / kPartKinds.size());
        return pagedPart(static_cast<PartKind>(id % kPartKinds.size()), at.level, at.brick);
      },
      budget_bytes_);
}

VoxelHistogram Pyramid::histogram() const {
  VoxelHistogram histogram(spec_.voxel_type, value_range_);
  const format::PartEntry& part = header_.histogram;
  const auto counts = std::as_writable_bytes(histogram.counts());
  // What is stored is not longer than the counts, which are few.
  std::vector<std::byte> stored;
  if (part.stored_bytes <= counts.size())
    stored = readTable(part.offset, part.stored_bytes, part.checksum, "histogram");
  bool is_sound =
      decodePart(static_cast<format::Codec>(part.codec), stored, counts.size(), counts.data());
  auto left = static_cast<std::uint64_t>(elementCount(spec_.voxels));
  for (const std::uint64_t count : histogram.counts()) {
    is_sound = is_sound && count <= left;
    left -= is_sound ? count : 0;
  }
  if (!is_sound || left != 0) fail("has a damaged histogram; build it again");
  return histogram;
}

std::optional<GradientSpectrum> Pyramid::gradients() const {
  const format::PartEntry& part = header_.gradients;
  if (part.offset == 0 && part.stored_bytes == 0) return std::nullopt;
  std::vector<float> elements(gradientElements(gradientParts(spec_.voxels)));
  const auto bytes = std::as_writable_bytes(std::span(elements));
  std::vector<std::byte> stored;
  if (part.stored_bytes <= bytes.size())
    stored = readTable(part.offset, part.stored_bytes, part.checksum, "gradient spectrum");
  std::optional<GradientSpectrum> spectrum;
  if (decodePart(static_cast<format::Codec>(part.codec), stored, bytes.size(), bytes.data()))
    spectrum = gradientSpectrumOf(elements);
  if (!spectrum) fail("has a damaged gradient spectrum; build it again");
  return spectrum;
}

PyramidSums Pyramid::sums() const {
  PyramidSums sums;
  PyramidBytes& bytes = sums.bytes;
  bytes.total = file_.size();
  bytes.raw = static_cast<std::uint64_t>(elementCount(spec_.voxels)) * voxelBytes(spec_.voxel_type);
  for (std::size_t n = 0; n < brickCount(); ++n) {
    const auto [level, brick] = brickAt(n);
    const BrickRow row = index_->row(n);
    const std::uint64_t stored = row.part(kSamples).stored_bytes;
    (level == 0 ? bytes.samples_level0 : bytes.samples_coarser) += stored;
    bytes.ranges += row.part(kRanges).stored_bytes;
    bytes.curvature += row.part(kCurvature).stored_bytes;
    bytes.error += row.part(kError).stored_bytes;
    ++sums.codecs.samples[row.part(kSamples).codec];
    ++sums.codecs.ranges[row.part(kRanges).codec];
    ++sums.codecs.curvature[row.part(kCurvature).codec];
    ++sums.codecs.error[row.part(kError).codec];
    if (level > 0 || stored == 0) continue;
    // What the brick holds beyond one copy of the samples that it covers.
    const auto all_samples = static_cast<std::uint64_t>(layout_.brickSampleBox(0, brick).size());
    const auto own_samples = static_cast<std::uint64_t>(layout_.brickOwnSamples(0, brick).size());
    bytes.aprons_level0 += stored * (all_samples - own_samples) / all_samples;
  }
  bytes.index = bytes.total - bytes.samples_level0 - bytes.samples_coarser - bytes.ranges -
                bytes.curvature - bytes.error;
  return sums;
}

BrickPager::Part Pyramid::pagedPart(PartKind kind, int level, const Index3& brick) const {
  const BrickRow row = brickRowOf(level, brick);
  const format::PartEntry& part = row.part(kind);
  const auto codec = static_cast<format::Codec>(part.codec);
  // The index has seen to it that the elements of a packed part are fewer than 2^31 bytes.
  const bool is_packed = codec == format::Codec::kLz4 || codec == format::Codec::kZstd;
  const auto elements =
      is_packed ? static_cast<std::uint32_t>(partBytes(row, spec_, layout_, kind, level, brick))
                : 0;
  return {part.offset, part.stored_bytes, part.checksum, elements, codec};
}

BrickRow Pyramid::brickRowOf(int level, const Index3& brick) const {
  return index_->row(brickRow(level, brick));
}

bool Pyramid::isRowAtHand(int level, const Index3& brick) const {
  return index_->isAtHand(brickRow(level, brick));
}

std::uint64_t Pyramid::tableBytesRead() const { return index_->bytesRead(); }

format::PartEntry Pyramid::entryOf(PartKind kind, int level, const Index3& brick) const {
  return brickRowOf(level, brick).part(kind);
}

BrickAddress Pyramid::brickAt(std::size_t row) const { return index_->address(row); }
std::size_t Pyramid::brickRow(int level, const Index3& brick) const {
  return index_->number(level, brick);
}
std::size_t Pyramid::brickCount() const { return index_->count(); }

BrickPart Pyramid::acquire(PartKind kind, int level, const Index3& brick,
                           const CancelFlag* cancel) const {
  BrickPart part;
  part.id_ = partId(kind, brickRow(level, brick));
  const char* why = "";
  part.data_ = pager_->acquire(part.id_, &why, cancel);
  if (part.data_ == nullptr) {
    const format::PartEntry entry = entryOf(kind, level, brick);
    fail(brickName(level, brick) + ", " + partName(kind) + ", " +
             std::to_string(entry.stored_bytes) + " bytes at offset " +
             std::to_string(entry.offset) + ", " + why + "; build it again or restore a copy",
         {.offset = entry.offset, .level = level, .brick = brick});
  }
  part.pager_ = pager_.get();
  return part;
}

BrickPager::Fetched Pyramid::fetch(PartKind kind, int level, const Index3& brick,
                                   const CancelFlag* cancel) const {
  if (entryOf(kind, level, brick).stored_bytes == 0) return BrickPager::Fetched::kBefore;
  return pager_->fetch(partId(kind, brickRow(level, brick)), cancel);
}

std::optional<BrickPager::Room> Pyramid::reserve(std::span<const PartKind> kinds, int level,
                                                 const Index3& brick, std::uint64_t since) const {
  const BrickRow row = brickRowOf(level, brick);
  std::vector<std::size_t> ids;
  for (const PartKind kind : kinds)
    if (row.part(kind).stored_bytes > 0) ids.push_back(partId(kind, brickRow(level, brick)));
  return pager_->reserve(ids, since);
}

BrickPager::Fetched Pyramid::fetch(PartKind kind, int level, const Index3& brick,
                                   BrickPager::Room& room) const {
  if (entryOf(kind, level, brick).stored_bytes == 0) return BrickPager::Fetched::kBefore;
  return pager_->fetch(partId(kind, brickRow(level, brick)), room);
}

void Pyramid::announce(PartKind kind, int level, const Index3& brick) const {
  if (entryOf(kind, level, brick).stored_bytes > 0)
    pager_->announce(partId(kind, brickRow(level, brick)));
}

void Pyramid::require(PartKind kind, int level, const Index3& brick,
                      const CancelFlag* cancel) const {
  if (entryOf(kind, level, brick).stored_bytes > 0) acquire(kind, level, brick, cancel);
}

std::optional<BrickPart> Pyramid::holdIfResident(PartKind kind, int level,
                                                 const Index3& brick) const {
  BrickPart part;
  if (entryOf(kind, level, brick).stored_bytes == 0) return part;
  part.id_ = partId(kind, brickRow(level, brick));
  part.data_ = pager_->acquireIfResident(part.id_);
  if (part.data_ == nullptr) return std::nullopt;
  part.pager_ = pager_.get();
  return part;
}

std::uint64_t Pyramid::heldBytes(PartKind kind, int level, const Index3& brick) const {
  const BrickPager::Part part = pagedPart(kind, level, brick);
  return part.bytes == 0 ? 0 : pager_->costOf(part);
}

void Pyramid::withdraw(int level, const Index3& brick) const {
  for (const PartKind kind : kPartKinds) pager_->withdraw(partId(kind, brickRow(level, brick)));
}

void Pyramid::throwIfReadsFailed(int level, const Index3& brick) const {
  for (const PartKind kind : kPartKinds) throwIfReadFailed(kind, level, brick);
}

void Pyramid::throwIfReadFailed(PartKind kind, int level, const Index3& brick) const {
  const BrickPager::Part part = pagedPart(kind, level, brick);
  if (part.bytes == 0 || !pager_->isInPlace(part)) return;
  const std::optional<std::uint64_t> page = file_.failedOffset(part.offset, part.bytes);
  if (!page) return;
  const std::uint64_t offset = std::max(*page, part.offset);
  fail(brickName(level, brick) + " became unreadable at offset " + std::to_string(offset) +
           " while it was in use (the file was cut short or its disk failed); check the disk "
           "and build it again or restore a copy",
       {.offset = offset, .level = level, .brick = brick});
}

void Pyramid::throwIfWrittenOver(PartKind kind, int level, const Index3& brick) const {
  const BrickPager::Part part = pagedPart(kind, level, brick);
  if (part.bytes > 0 && pager_->isInPlace(part)) acquire(kind, level, brick);
}

ValueRange Pyramid::brickRange(int level, const Index3& brick) const {
  const BrickRow row = brickRowOf(level, brick);
  return {row.range_min, row.range_max};
}

BrickSamples Pyramid::samples(int level, const Index3& brick, const CancelFlag* cancel) const {
  BrickSamples result;
  result.box = layout_.brickSampleBox(level, brick);
  const BrickRow row = brickRowOf(level, brick);
  if (row.part(kSamples).stored_bytes > 0) {
    result.part = acquire(kSamples, level, brick, cancel);
    return result;
  }
  result.part.made_.resize(partBytes(row, spec_, layout_, kSamples, level, brick));
  visitVoxelType(spec_.voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    std::fill_n(reinterpret_cast<T*>(result.part.made_.data()), result.box.size(),
                static_cast<T>(row.constant));
  });
  result.part.data_ = result.part.made_.data();
  return result;
}

BrickRanges Pyramid::ranges(int level, const Index3& brick, const CancelFlag* cancel) const {
  const BrickRow row = brickRowOf(level, brick);
  if (row.part(kRanges).stored_bytes == 0) return {{}, row.constant};
  return {acquire(kRanges, level, brick, cancel), 0};
}

void Pyramid::tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out,
                         const CancelFlag* cancel) const {
  const BrickRanges ranges = this->ranges(level, brick, cancel);
  out.resize(static_cast<std::size_t>(elementCount(layout_.brickTiles(level, brick))));
  visitVoxelType(spec_.voxel_type, [&](auto tag) {
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] = ranges.tile<typename decltype(tag)::Type>(i);
  });
  throwIfReadFailed(kRanges, level, brick);
}

void Pyramid::crossedTiles(int level, const Index3& brick, float isovalue,
                           std::vector<std::uint8_t>& out, const CancelFlag* cancel) const {
  const BrickRow row = brickRowOf(level, brick);
  const auto count = static_cast<std::size_t>(elementCount(layout_.brickTiles(level, brick)));
  out.assign(count, 0);
  if (row.part(kRanges).stored_bytes == 0) return;  // one value does not cross
  const BrickPart part = acquire(kRanges, level, brick, cancel);
  visitVoxelType(spec_.voxel_type, [&](auto tag) {
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

void Pyramid::curvature(const Index3& brick, std::vector<std::uint8_t>& out,
                        const CancelFlag* cancel) const {
  out.clear();
  if (!spec_.has_curvature) return;
  const auto count = static_cast<std::size_t>(3 * elementCount(layout_.brickNodes(brick)));
  if (curvatureBytes(brick) == 0) {
    out.assign(count, 0);
    return;
  }
  const BrickPart part = acquire(kCurvature, 0, brick, cancel);
  out.resize(count);
  std::memcpy(out.data(), part.data(), count);
  throwIfReadFailed(kCurvature, 0, brick);
}

bool Pyramid::errorCodes(int level, const Index3& brick, std::optional<double> isovalue,
                         std::vector<std::uint8_t>& out, const CancelFlag* cancel) const {
  out.clear();
  if (level < kFirstErrorLevel || level > spec_.error_level) return false;
  const IndexBox cells = layout_.brickCellBox(level, brick);
  out.assign(static_cast<std::size_t>(cells.size()), 0);
  const BrickRow row = brickRowOf(level, brick);
  if (row.part(kError).stored_bytes == 0) return true;
  std::vector<ValueRange> ranges;
  tileRanges(level, brick, ranges, cancel);
  const BrickPart part = acquire(kError, level, brick, cancel);
  const std::uint32_t bin = isovalue ? error_bins_.binOf(*isovalue) : 0;
  const Index3 tiles = layout_.brickTiles(level, brick);
  std::uint64_t at = 0;  // of the tile's first block
  for (std::size_t tile = 0; tile < ranges.size(); ++tile) {
    const Index3 first = indexAt(static_cast<std::int64_t>(tile), tiles) * spec_.tile_cells;
    const Index3 count = glm::min(Index3(spec_.tile_cells), cells.count - first);
    const auto block_bytes = static_cast<std::uint64_t>(elementCount(count));
    // A reversed range is one that verify finds; it must not lead anywhere.
    const bool is_sound = ranges[tile].min <= ranges[tile].max;
    const TileBins bins(error_bins_, is_sound ? ranges[tile] : value_range_);
    if (bins.blocks() * block_bytes > row.error_bytes - at) failErrorSize(level, brick);
    const auto* codes = reinterpret_cast<const std::uint8_t*>(part.data()) + at;
    const std::uint32_t begin = isovalue ? bins.blockOf(bin) : 0;
    const std::uint32_t end = isovalue ? begin + 1 : bins.blocks();
    codes += begin * block_bytes;
    for (std::uint32_t block = begin; block < end; ++block)
      for (std::int64_t z = 0; z < count.z; ++z)
        for (std::int64_t y = 0; y < count.y; ++y, codes += count.x) {
          std::uint8_t* const cells_row =
              &out[static_cast<std::size_t>(linearIndex(first + Index3(0, y, z), cells.count))];
          for (std::int64_t x = 0; x < count.x; ++x)
            cells_row[x] = std::max(cells_row[x], codes[x]);
        }
    at += bins.blocks() * block_bytes;
  }
  if (at != row.error_bytes) failErrorSize(level, brick);
  throwIfReadFailed(kError, level, brick);
  return true;
}

void Pyramid::failErrorSize(int level, const Index3& brick) const {
  fail(brickName(level, brick) +
           ", error, does not have the bytes that its ranges ask for; "
           "build it again or restore a copy",
       {.level = level, .brick = brick});
}

std::uint64_t Pyramid::sampleBytes(int level, const Index3& brick) const {
  return entryOf(kSamples, level, brick).stored_bytes;
}
std::uint64_t Pyramid::rangeBytes(int level, const Index3& brick) const {
  return entryOf(kRanges, level, brick).stored_bytes;
}
std::uint64_t Pyramid::curvatureBytes(const Index3& brick) const {
  return entryOf(kCurvature, 0, brick).stored_bytes;
}
std::uint64_t Pyramid::errorBytes(int level, const Index3& brick) const {
  return entryOf(kError, level, brick).stored_bytes;
}

}  // namespace isobrick
