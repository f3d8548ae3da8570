#include "isobrick/storage/pyramid_writer.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <limits>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/stored_grid.h"

namespace isobrick {
namespace {

std::string journalPath(const AtomicFile& file) { return file.temporaryPath() + ".journal"; }

// The fields that need no brick.
format::Header formatHeaderOf(const PyramidSpec& spec, std::uint64_t missing_voxels) {
  format::Header header = {};
  std::memcpy(header.magic, format::kMagic, sizeof header.magic);
  header.version = format::kVersion;
  if (!spec.values.isIdentity() || missing_voxels > 0 || spec.level0 != Level0Place::kStored) {
    header.version = format::kVersionOfTransforms;
    header.value_scale = spec.values.scale;
    header.value_offset = spec.values.offset;
    header.missing_voxels = missing_voxels;
  }
  if (spec.level0 != Level0Place::kStored) {
    header.version = format::kVersionOfSources;
    header.level0_place = static_cast<std::uint32_t>(spec.level0);
  }
  header.header_bytes = sizeof header;
  header.voxel_type = static_cast<std::uint32_t>(spec.voxel_type);
  header.filter = static_cast<std::uint32_t>(spec.filter);
  header.level_count = static_cast<std::uint32_t>(Lattice(spec.voxels).levels());
  header.brick_cells = static_cast<std::uint32_t>(spec.brick_cells);
  header.tile_cells = static_cast<std::uint32_t>(spec.tile_cells);
  storeGrid(spec.voxels, spec.geometry, header);
  header.curvature_epsilon = spec.curvature_epsilon;
  return header;
}

std::vector<format::LevelRow> levelTable(const BrickLayout& layout, const TableRows& rows) {
  std::vector<format::LevelRow> table;
  for (int level = 0; level < layout.lattice().levels(); ++level) {
    const Index3 samples = layout.lattice().samples(level);
    const Index3 bricks = layout.bricks(level);
    format::LevelRow row = {};
    for (int axis = 0; axis < 3; ++axis) {
      row.samples[axis] = static_cast<std::uint64_t>(samples[axis]);
      row.bricks[axis] = static_cast<std::uint64_t>(bricks[axis]);
    }
    row.first_brick = rows.hasLevel(level) ? rows.firstOfLevel(level) : format::kNoRow;
    table.push_back(row);
  }
  return table;
}

// Only samples that are used in place, and have some size, are worth a page of their own.
std::uint64_t sampleAlignment(const EncodedPart& samples) {
  const bool in_place = samples.codec == format::Codec::kStored;
  return in_place && samples.bytes.size() >= format::kSampleAlignment ? format::kSampleAlignment
                                                                      : format::kPartAlignment;
}

// "codec=lz4 (it was codec=zstd)" for the first line that differs.
std::string firstDifference(const std::string& is, const std::string& was) {
  std::size_t at = 0;
  while (at < is.size() && at < was.size()) {
    const std::string line_is = is.substr(at, is.find('\n', at) - at);
    const std::string line_was = was.substr(at, was.find('\n', at) - at);
    if (line_is != line_was) return line_is + " (it was " + line_was + ")";
    at += line_is.size() + 1;
  }
  return "more or fewer options";
}

// True if the parts of the entry lie behind `begin`, one after the other with zeros between, and
// are undamaged.
bool isUndamaged(int fd, const JournalEntry& entry, std::uint64_t begin,
                 std::vector<std::byte>& buffer) {
  struct stat status = {};
  if (fstat(fd, &status) != 0 || entry.end > static_cast<std::uint64_t>(status.st_size))
    return false;
  std::uint64_t at = begin;
  for (const format::PartEntry& part : entry.row.parts) {
    if (!isInFile(part)) continue;
    if (part.offset < at || part.offset - at >= format::kSampleAlignment ||
        part.offset > entry.end || part.stored_bytes > entry.end - part.offset)
      return false;
    const std::size_t gap = part.offset - at;
    buffer.resize(gap + part.stored_bytes);
    if (readBytesAt(fd, at, buffer.data(), buffer.size()).bytes < buffer.size() ||
        std::any_of(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(gap),
                    [](std::byte b) { return b != std::byte{0}; }) ||
        !isChecksum(checksum64(buffer.data() + gap, part.stored_bytes), part.checksum))
      return false;
    at = part.offset + part.stored_bytes;
  }
  return at == entry.end;
}

// True if a foreign file has a temporary file's name: it begins neither with zeros nor with
// `magic`.
template <std::size_t bytes>
bool isForeign(const std::string& path, const char (&magic)[bytes]) {
  if (!isRegularFile(path)) return false;
  std::ifstream file(path, std::ios::binary);
  char begin[bytes] = {};
  file.read(begin, bytes);
  return std::memcmp(begin, magic, bytes) != 0 &&
         std::any_of(std::begin(begin), std::end(begin), [](char c) { return c != 0; });
}

// Returns the path, unless the file with the temporary file's name, or a journal without that file,
// is foreign: an unfinished pyramid begins with zeros, and for a moment at the end with its header.
const std::string& refuseForeignTemporary(const std::string& path) {
  const std::string temporary = path + kUnfinishedEnding;
  const bool is_there = isPresent(temporary);
  const std::string file = is_there ? temporary : temporary + ".journal";
  if (is_there ? isForeign(file, format::kMagic) : isForeign(file, kJournalMagic))
    throw Error("'" + file +
                    "' exists and is not an unfinished pyramid; move it away, or choose another "
                    "output",
                {.path = file});
  return path;
}

}  // namespace

void removeStrayJournal(const std::string& path) noexcept try {
  const std::string temporary = path + kUnfinishedEnding;
  if (!isPresent(temporary + ".journal") || isPresent(temporary) ||
      isForeign(temporary + ".journal", kJournalMagic))
    return;
  // With the exclusive right to write: no other process begins meanwhile.
  AtomicFile file(path, AtomicFile::Leftover::kKeep, kUnfinishedEnding);
  struct stat status = {};
  const bool is_ours = fstat(file.fd(), &status) == 0 && status.st_size == 0;
  file.keepTemporary(!is_ours);
  if (is_ours) unlink(journalPath(file).c_str());
} catch (const std::exception&) {  // a folder that may not be written to, another process at work
}

PyramidWriter::PyramidWriter(const std::string& path, const PyramidSpec& spec,
                             const std::string& identity, bool resume, const CancelFlag* cancel,
                             const std::optional<DividedFile>& file)
    : cancel_(cancel),
      spec_(spec),
      layout_(spec.layout()),
      divided_(file),
      file_(refuseForeignTemporary(path),
            resume ? AtomicFile::Leftover::kKeep : AtomicFile::Leftover::kEmpty, kUnfinishedEnding),
      rows_(file ? file->rows() : TableRows(layout_)),
      brick_table_(rows_.count()) {
  if (!isUsableGeometry(spec.geometry))
    throw Error("cannot write '" + path +
                "': the spacing must be within 2^-100 .. 2^100 and the origin within 2^100; "
                "choose another unit of length");
  end_ = sizeof(format::Header);
  std::vector<JournalEntry> entries;
  if (resume) {
    // A file that cannot be continued now, on a full disk for one, is not thrown away.
    file_.keepTemporary(true);
    entries = takeOver(identity, cancel);
  } else {
    unlink(journalPath(file_).c_str());
  }
  // The header is written last; until then its place holds zeros, which no reader accepts as one.
  const std::array<std::byte, sizeof(format::Header)> blank{};
  file_.pwrite(blank.data(), blank.size(), 0);
  file_.continueFrom(end_);
  file_.cutAfterPosition();
  journal_ = std::make_unique<WriteJournal>(journalPath(file_), identity, entries);
  file_.keepTemporary(false);
}

PyramidWriter::~PyramidWriter() {
  if (!journal_ || keeps_) return;
  journal_->remove();
}

void PyramidWriter::keepForResume() {
  keeps_ = true;
  file_.keepTemporary(true);
}

void PyramidWriter::refuseToBeginAnew() const {
  throw Error("cannot continue '" + file_.temporaryPath() + "': its journal '" +
                  journalPath(file_) + "' is missing or damaged; put it back, or begin anew",
              {.path = file_.temporaryPath()}, {Remedy::kBeginAnew});
}

std::vector<JournalEntry> PyramidWriter::takeOver(const std::string& identity,
                                                  const CancelFlag* cancel) {
  struct stat status = {};
  if (fstat(file_.fd(), &status) != 0 || status.st_size == 0) return {};  // made just now
  auto journal = WriteJournal::read(journalPath(file_));
  if (!journal) {
    // The journal comes right after the blank header: a file of that length holds no work yet.
    if (static_cast<std::uint64_t>(status.st_size) > sizeof(format::Header)) refuseToBeginAnew();
    return {};
  }
  if (journal->identity != identity)
    throw Error("cannot continue '" + file_.temporaryPath() + "': it was begun differently: " +
                    firstDifference(identity, journal->identity) + "; do as then, or begin anew",
                {.path = file_.temporaryPath()}, {Remedy::kBeginAnew});
  std::vector<JournalEntry>& entries = journal->entries;
  if (entries.size() > brick_table_.size()) entries.clear();
  std::vector<std::byte> buffer;
  std::size_t good = 0;
  for (; good < entries.size(); ++good) {
    const auto [level, brick] = rows_.address(good);
    if (!isPossibleRow(entries[good].row, spec_, layout_, level, brick)) break;
    if (cancel != nullptr && cancel->requested())
      throw Cancelled("interrupted; '" + file_.temporaryPath() + "' stays as it was");
    if (!isUndamaged(file_.fd(), entries[good], end_, buffer)) break;
    brick_table_[good] = entries[good].row;
    end_ = entries[good].end;
  }
  entries.resize(good);
  bricks_written_ = bricks_resumed_ = good;
  return std::move(entries);
}

void PyramidWriter::write(const EncodedBrick& brick) {
  assert(bricks_written_ < brick_table_.size());
  static constexpr std::array<std::byte, format::kSampleAlignment> kZeros{};
  std::array<iovec, 2 * kPartKinds.size()> spans;
  std::size_t count = 0;
  const auto append = [&](const void* data, std::size_t bytes) {
    spans[count++] = {const_cast<void*>(data), bytes};  // only read; iovec has no const pointer
    end_ += bytes;
  };
  const auto place = [&](const EncodedPart& part, std::uint64_t alignment) {
    format::PartEntry entry = {};
    entry.codec = static_cast<std::uint32_t>(part.codec);
    entry.checksum = part.checksum;
    entry.stored_bytes = static_cast<std::uint32_t>(part.bytes.size());
    if (!isInFile(entry)) return entry;
    append(kZeros.data(), (alignment - end_ % alignment) % alignment);
    entry.offset = end_;
    append(part.bytes.data(), part.bytes.size());
    return entry;
  };
  BrickRow& row = brick_table_[bricks_written_];
  row.part(PartKind::kSamples) = place(brick.samples, sampleAlignment(brick.samples));
  row.part(PartKind::kRanges) = place(brick.ranges, format::kPartAlignment);
  row.part(PartKind::kCurvature) = place(brick.curvature, format::kPartAlignment);
  row.constant = brick.constant;
  file_.writeGathered(std::span(spans).first(count));
  journal_->add(row, end_);
  ++bricks_written_;
}

void PyramidWriter::readPart(std::uint64_t row, PartKind part, std::size_t bytes,
                             std::byte* out) const {
  const BrickRow& brick = brick_table_[row];
  const format::PartEntry& entry = brick.part(part);
  const auto codec = static_cast<format::Codec>(entry.codec);
  if (codec == format::Codec::kConstant) {
    visitVoxelType(spec_.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      std::fill_n(reinterpret_cast<T*>(out), bytes / sizeof(T), static_cast<T>(brick.constant));
    });
    return;
  }
  std::vector<std::byte> stored(entry.stored_bytes);
  const IoResult result = readBytesAt(file_.fd(), entry.offset, stored.data(), stored.size());
  const bool is_read = result.bytes == stored.size();
  if (!is_read || !decodePart(codec, stored, bytes, out))
    throw ResumableError("cannot read '" + file_.temporaryPath() + "' " +
                             (is_read ? "at byte " + std::to_string(entry.offset)
                                      : ioFailureText(entry.offset, result)) +
                             "; check the disk, or begin anew",
                         {.path = file_.temporaryPath(), .offset = entry.offset},
                         {Remedy::kBeginAnew});
}

bool PyramidWriter::hasCurvature() const {
  const auto isOf = [](const format::PartEntry& part, format::Codec codec) {
    return part.codec == static_cast<std::uint32_t>(codec);
  };
  return std::any_of(brick_table_.begin(), brick_table_.end(), [&](const BrickRow& row) {
    return !isOf(row.part(PartKind::kCurvature), format::Codec::kAbsent) &&
           !isOf(row.part(PartKind::kSamples), format::Codec::kConstant);
  });
}

// The kinds that bricks of this pyramid may have.
std::vector<PartKind> PyramidWriter::kinds() const {
  std::vector<PartKind> kinds = {PartKind::kSamples, PartKind::kRanges};
  if (spec_.has_curvature) kinds.push_back(PartKind::kCurvature);
  return kinds;
}

std::uint64_t PyramidWriter::append(const void* data, std::size_t bytes) {
  static constexpr std::array<std::byte, format::kPartAlignment> kZeros{};
  const std::size_t gap = (kZeros.size() - end_ % kZeros.size()) % kZeros.size();
  file_.write(kZeros.data(), gap);
  file_.write(data, bytes);
  const std::uint64_t offset = end_ + gap;
  end_ = offset + bytes;
  return offset;
}

std::uint64_t PyramidWriter::appendBrickTable() {
  const std::vector<PartKind> kinds = this->kinds();
  std::vector<std::byte> table(brick_table_.size() *
                               format::rowBytes(static_cast<std::uint32_t>(kinds.size())));
  std::byte* at = table.data();
  for (std::size_t number = 0; number < brick_table_.size(); ++number) {
    const BrickRow& row = brick_table_[number];
    const std::byte* const begin = at;
    for (const PartKind kind : kinds) {
      std::memcpy(at, &row.part(kind), sizeof(format::PartEntry));
      at += sizeof(format::PartEntry);
    }
    format::RowTail tail{row.range_min, row.range_max, row.constant, 0, 0};
    std::memcpy(at, &tail, sizeof tail);
    at += offsetof(format::RowTail, checksum);
    tail.checksum = checksum64(begin, static_cast<std::size_t>(at - begin), number);
    std::memcpy(at, &tail.checksum, sizeof tail.checksum);
    at += sizeof tail.checksum;
  }
  return append(table.data(), table.size());
}

template <typename T>
format::PartEntry PyramidWriter::appendNumbers(std::span<const T> numbers, format::Codec codec) {
  EncodedPart part;
  const auto bytes = std::as_bytes(numbers);
  part.bytes.assign(bytes.begin(), bytes.end());
  encodeNumbers(sizeof(T), codec, part);
  return {append(part.bytes.data(), part.bytes.size()), part.checksum,
          static_cast<std::uint32_t>(part.bytes.size()), static_cast<std::uint32_t>(part.codec)};
}

format::PartEntry PyramidWriter::appendBytes(std::span<const std::byte> bytes) {
  if (bytes.empty()) return {};
  if (bytes.size() > std::numeric_limits<std::uint32_t>::max())
    throw Error("cannot write '" + file_.temporaryPath() +
                "': its table of files would have more than 4 GiB; choose larger super-bricks");
  return {append(bytes.data(), bytes.size()), checksum64(bytes.data(), bytes.size()),
          static_cast<std::uint32_t>(bytes.size()),
          static_cast<std::uint32_t>(format::Codec::kStored)};
}

format::PartEntry PyramidWriter::append(std::span<const std::uint32_t> numbers,
                                        format::Codec codec) {
  return numbers.empty() ? format::PartEntry{} : appendNumbers(numbers, codec);
}

std::uint64_t PyramidWriter::finish(const Summary& summary, format::Codec codec) {
  assert(bricks_written_ == brick_table_.size() &&
         summary.brick_ranges.size() == brick_table_.size());
  for (std::size_t row = 0; row < brick_table_.size(); ++row) {
    brick_table_[row].range_min = summary.brick_ranges[row].min;
    brick_table_[row].range_max = summary.brick_ranges[row].max;
  }
  format::Header header = formatHeaderOf(spec_, summary.missing_voxels);
  for (const PartKind kind : kinds()) header.kinds[header.kind_count++] = kindNumber(kind);
  header.value_min = static_cast<double>(summary.voxel_range.min);
  header.value_max = static_cast<double>(summary.voxel_range.max);
  header.noise = summary.noise;
  if (divided_) {
    header.super_cells = static_cast<std::uint32_t>(divided_->super_bricks.cells());
    header.super_levels = static_cast<std::uint32_t>(divided_->super_bricks.levels());
    header.super_brick = divided_->number ? 1 + *divided_->number : 0;
    header.division = appendBytes(summary.division);
  }
  if (summary.histogram) header.histogram = appendNumbers(summary.histogram->counts(), codec);
  if (summary.gradients)
    header.gradients = appendNumbers(std::span<const float>(elementsOf(*summary.gradients)), codec);
  const std::vector<format::LevelRow> levels = levelTable(layout_, rows_);
  const std::size_t level_bytes = levels.size() * sizeof(format::LevelRow);
  header.level_table_offset = append(levels.data(), level_bytes);
  header.level_table_checksum = checksum64(levels.data(), level_bytes);
  header.brick_table_offset = appendBrickTable();
  header.brick_count = brick_table_.size();
  const std::string& provenance = summary.provenance_json;
  header.provenance_offset = append(provenance.data(), provenance.size());
  header.provenance_bytes = provenance.size();
  header.provenance_checksum = checksum64(provenance.data(), provenance.size());
  header.file_bytes = end_;
  header.header_checksum = checksum64(&header, offsetof(format::Header, header_checksum));
  file_.pwrite(&header, sizeof header, 0);
  file_.cutAfterPosition();
  file_.commit(cancel_);
  // Last: a kill before this line leaves a journal without its temporary file, which means nothing
  // (removeStrayJournal()).
  journal_->remove();
  journal_.reset();
  return end_;
}

}  // namespace isobrick
