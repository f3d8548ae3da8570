#include "isobrick/storage/pyramid_tables.h"

#include <algorithm>
#include <cstring>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/storage/stored_grid.h"
#include "isobrick/storage/stored_spec.h"

namespace isobrick {
namespace {

// Rows of a remote brick table that are asked for together when all of it is passed over.
constexpr std::size_t kRowsInAStride = std::size_t{1} << 15;

// A table of hostile length, in pieces as they were announced.
class TableRun {
 public:
  TableRun(const PagedFile& file, const ByteRange& range) : file_(file), left_(range) {
    if (!file.holds(range.offset, range.bytes)) left_.bytes = 0;
  }
  // Fills `out` with the next bytes; false if there are no more. Throws ReadFailure.
  bool next(std::span<std::byte> out) {
    while (!out.empty()) {
      if (at_ == piece_.size() && !nextPiece()) return false;
      const std::size_t some = std::min(out.size(), piece_.size() - at_);
      std::memcpy(out.data(), piece_.data() + at_, some);
      at_ += some;
      out = out.subspan(some);
    }
    return true;
  }
  // Of all bytes that came.
  std::uint64_t checksum() const { return checksum_.value(); }

 private:
  bool nextPiece() {
    constexpr std::uint64_t kPieceBytes = std::uint64_t{1} << 20;
    piece_.resize(std::min(left_.bytes, kPieceBytes));
    at_ = 0;
    if (piece_.empty()) return false;
    file_.read(left_.offset, piece_.size(), piece_.data());
    checksum_.add(piece_.data(), piece_.size());
    left_.offset += piece_.size();
    left_.bytes -= piece_.size();
    return true;
  }

  const PagedFile& file_;
  ByteRange left_;
  std::vector<std::byte> piece_;
  std::size_t at_ = 0;
  RunningChecksum checksum_;
};

}  // namespace

PyramidTables::PyramidTables(const std::string& path, FileAccess access,
                             const RemoteOptions& remote)
    : path_(isRemotePath(path) ? withoutSecrets(path) : path),
      file_(pyramidFileOf(path), access, remote),
      remote_(remote) {
  readHeader();
}
PyramidTables::PyramidTables(std::string name, const PyramidSpec& spec, const ValueRange& values)
    : path_(std::move(name)), spec_(spec), layout_(spec.layout()), value_range_(values) {
  spec_.level0 = Level0Place::kStored;  // of a part of an index: nothing of it is read
}
PyramidTables::~PyramidTables() = default;

void PyramidTables::fail(const std::string& what, ErrorPlace place) const {
  if (place.path.empty()) place.path = path();
  throw Error("'" + path() + "' " + what, std::move(place));
}

void PyramidTables::readHeader() {
  constexpr std::uint64_t kSize = sizeof(format::Header);
  format::Header header{};
  try {
    if (file_.size() >= kSize) file_.read(0, kSize, reinterpret_cast<std::byte*>(&header));
  } catch (const ReadFailure& failure) {
    fail(withAdvice(failure.what(), "check the disk"));
  }
  if (std::memcmp(header.magic, format::kMagic, sizeof header.magic) != 0)
    fail("is not an isobrick pyramid; make one with 'isobrick build'");
  if (header.version < format::kVersion || header.version > format::kVersionOfSources)
    fail("has format version " + std::to_string(header.version) + ", this program reads versions " +
         std::to_string(format::kVersion) + " to " + std::to_string(format::kVersionOfSources) +
         "; build it again or use the program that wrote it");
  if (header.header_bytes != kSize ||
      !isChecksum(checksum64(&header, offsetof(format::Header, header_checksum)),
                  header.header_checksum))
    fail("has a damaged header; build it again");
  if (header.file_bytes != file_.size())
    fail("has " + std::to_string(file_.size()) + " bytes where its header says " +
         std::to_string(header.file_bytes) + ": it was cut or changed; build it again");

  if (header.version >= format::kVersionOfTransforms && header.voxel_type == format::kLabelVoxels)
    fail("holds labels, which this program does not read; use the program that wrote it");
  const std::optional<PyramidSpec> spec = storedSpec(header);
  if (!spec) fail("has impossible numbers in its header; build it again");
  spec_ = *spec;
  if (!isUsableGeometry(spec_.geometry))
    fail("has a spacing, an origin or directions that give no usable positions; build it again");
  value_range_ = {static_cast<float>(header.value_min), static_cast<float>(header.value_max)};
  layout_ = spec_.layout();
  header_ = header;
  if (header.level_count != static_cast<std::uint32_t>(lattice().levels()))
    fail("has a wrong number of levels; build it again");
  announceTables(header);
  readDivision();
  readTables(header);
}

void PyramidTables::readDivision() {
  const format::Header& header = header_;
  if (header.super_cells == 0) {
    if (header.super_levels != 0 || header.super_brick != 0 || header.division.stored_bytes != 0)
      fail("has impossible numbers in its header; build it again");
    return;
  }
  const bool is_power = isPowerOfTwoWithin(
      header.super_cells, header.brick_cells,
      header.brick_cells * static_cast<std::uint32_t>(SuperBricks::kMostBricksAlong));
  if (!is_power || lattice().levels() < 2)
    fail("has impossible numbers in its header; build it again");
  const SuperBricks super_bricks(layout_, header.super_cells);
  if (static_cast<std::uint32_t>(super_bricks.levels()) != header.super_levels ||
      header.super_brick > super_bricks.count())
    fail("has impossible numbers in its header; build it again");
  divided_file_ = DividedFile{super_bricks, std::nullopt};
  if (header.super_brick > 0) {
    divided_file_->number = header.super_brick - 1;
    return;
  }
  if (PyramidDivision::tableBytes(layout_, super_bricks) != header.division.stored_bytes)
    fail("has a damaged table of files; join them again");
  TableRun run(file_, {header.division.offset, header.division.stored_bytes});
  std::optional<PyramidDivision> division;
  try {
    division = PyramidDivision::of(
        layout_, super_bricks,
        [&](std::span<std::byte> out) {
          if (!run.next(out)) fail("has a damaged table of files; join them again");
        },
        format::rowBytes(header.kind_count), header.file_bytes);
  } catch (const ReadFailure& failure) {
    fail(withAdvice(std::string("has a table of files that ") + failure.what(), "check the disk"));
  }
  if (!division || !isChecksum(run.checksum(), header.division.checksum))
    fail("has a damaged table of files; join them again");
  division_ = std::make_shared<PyramidDivision>(std::move(*division));
  file_.divide(division_, remote_);
}

std::vector<std::byte> PyramidTables::divisionBytes() const {
  const format::PartEntry& entry = header_.division;
  return readTable(entry.offset, entry.stored_bytes, entry.checksum,
                   header_.super_brick == 0 ? "table of files" : "table for the join");
}

std::vector<std::byte> PyramidTables::readTable(std::uint64_t offset, std::uint64_t bytes,
                                                std::uint64_t checksum, const char* name) const {
  if (file_.holds(offset, bytes)) try {
      std::vector<std::byte> table(bytes);
      file_.read(offset, bytes, table.data());
      if (isChecksum(checksum64(table.data(), bytes), checksum)) return table;
    } catch (const ReadFailure& failure) {
      fail(withAdvice(std::string("has a ") + name + " that " + failure.what(), "check the disk"));
    }
  fail(std::string("has a damaged ") + name + "; build it again");
}

// All that is read when a pyramid is opened, in one go.
void PyramidTables::announceTables(const format::Header& header) const {
  std::vector<ByteRange> ranges = BrickIndex::rangesReadAtOnce(header);
  ranges.push_back({header.level_table_offset, header.level_count * sizeof(format::LevelRow)});
  if (header.provenance_bytes <= kMostProvenanceBytes)
    ranges.push_back({header.provenance_offset, header.provenance_bytes});
  if (header.super_cells > 0 && header.super_brick == 0)
    ranges.push_back({header.division.offset, header.division.stored_bytes});
  std::erase_if(ranges,
                [&](const ByteRange& range) { return !file_.holds(range.offset, range.bytes); });
  file_.announce(ranges);
}

void PyramidTables::readTables(const format::Header& header) {
  // The layout follows from the header, so the tables must have just the sizes that it gives.
  const TableRows own = divided_file_ ? divided_file_->rows() : TableRows(layout_);
  index_ = std::make_unique<BrickIndex>(file_, spec_, header, own, division_.get());
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
    bool same = row.first_brick == (own.hasLevel(level) ? own.firstOfLevel(level) : format::kNoRow);
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
}

VoxelHistogram PyramidTables::histogram() const {
  VoxelHistogram histogram(spec_.voxel_type, value_range_);
  const format::PartEntry& part = header_.histogram;
  const auto counts = std::as_writable_bytes(histogram.counts());
  // The stored bytes are at most those of the counts, which are few.
  std::vector<std::byte> stored;
  if (part.stored_bytes <= counts.size())
    stored = readTable(part.offset, part.stored_bytes, part.checksum, "histogram");
  bool is_sound =
      decodePart(static_cast<format::Codec>(part.codec), stored, counts.size(), counts.data());
  std::uint64_t left = static_cast<std::uint64_t>(elementCount(spec_.voxels)) - missingVoxels();
  for (const std::uint64_t count : histogram.counts()) {
    is_sound = is_sound && count <= left;
    left -= is_sound ? count : 0;
  }
  if (!is_sound || left != 0) fail("has a damaged histogram; build it again");
  return histogram;
}

std::optional<GradientSpectrum> PyramidTables::gradients() const {
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

PyramidSums PyramidTables::sums() const {
  PyramidSums sums;
  PyramidBytes& bytes = sums.bytes;
  bytes.total = fileBytes();
  bytes.raw = static_cast<std::uint64_t>(elementCount(spec_.voxels)) * voxelBytes(spec_.voxel_type);
  std::vector<std::size_t> stride;
  for (std::size_t n = 0; n < index_->count(); ++n) {
    if (n % kRowsInAStride == 0 && file_.isRemote()) {
      stride.clear();
      for (std::size_t row = n; row < std::min(n + kRowsInAStride, index_->count());
           row += BrickIndex::kRowsAtATime)
        stride.push_back(row);
      index_->bringIn(stride);
    }
    const auto [level, brick] = index_->address(n);
    const BrickRow row = index_->row(n);
    const std::uint64_t stored = isInFile(row.part(kSamples)) ? row.part(kSamples).stored_bytes : 0;
    (level == 0 ? bytes.samples_level0 : bytes.samples_coarser) += stored;
    bytes.ranges += row.part(kRanges).stored_bytes;
    bytes.curvature += row.part(kCurvature).stored_bytes;
    ++sums.codecs.samples[row.part(kSamples).codec];
    ++sums.codecs.ranges[row.part(kRanges).codec];
    ++sums.codecs.curvature[row.part(kCurvature).codec];
    if (level > 0 || stored == 0) continue;
    // The bytes of the brick beyond one copy of the samples that it covers.
    const auto all_samples = static_cast<std::uint64_t>(layout_.brickSampleBox(0, brick).size());
    const auto own_samples = static_cast<std::uint64_t>(layout_.brickOwnSamples(0, brick).size());
    bytes.aprons_level0 += stored * (all_samples - own_samples) / all_samples;
  }
  bytes.index =
      bytes.total - bytes.samples_level0 - bytes.samples_coarser - bytes.ranges - bytes.curvature;
  return sums;
}

}  // namespace isobrick
