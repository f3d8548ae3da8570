#include "isobrick/preprocess/torn_pyramid.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <utility>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_tables.h"
#include "isobrick/storage/stored_spec.h"

namespace isobrick {
namespace {

bool isHeader(const format::Header& header) {
  return header.header_checksum == checksum64(&header, offsetof(format::Header, header_checksum)) &&
         std::memcmp(header.magic, format::kMagic, sizeof header.magic) == 0 &&
         header.header_bytes == sizeof header && header.version >= format::kVersion &&
         header.version <= format::kVersionOfSources;
}

}  // namespace

// Tries every value of every byte until isRight(), if it is not at once. False if none is.
template <typename IsRight>
bool TornFile::putOneByteRight(std::span<std::byte> bytes, const IsRight& isRight) {
  if (isRight()) return true;
  for (std::byte& byte : bytes) {
    const std::byte was = byte;
    for (int value = 0; value < 256; ++value) {
      byte = static_cast<std::byte>(value);
      if (isRight()) return is_corrected_ = true;
    }
    byte = was;
  }
  return false;
}

TornFile::TornFile(const std::string& path)
    : path_(path), fd_(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
  struct stat status = {};
  if (fd_.get() < 0 || fstat(fd_.get(), &status) != 0 || !S_ISREG(status.st_mode)) return;
  size_ = static_cast<std::uint64_t>(status.st_size);
  mode_ = status.st_mode & 07777;
  format::Header header = {};
  const auto header_bytes = std::as_writable_bytes(std::span(&header, 1));
  if (!readAt(0, header_bytes) || !putOneByteRight(header_bytes, [&] { return isHeader(header); }))
    return;
  const std::optional<PyramidSpec> spec = storedSpec(header);
  if (!spec) return;
  header_ = header;
  spec_ = *spec;

  const std::uint64_t row_bytes = format::rowBytes(header.kind_count);
  const std::uint64_t behind = size_ - std::min(size_, header.brick_table_offset);
  const std::uint64_t rows = std::min(header.brick_count, behind / row_bytes);
  table_.resize(rows * row_bytes);
  if (!readAt(header.brick_table_offset, table_)) table_.clear();
  std::size_t lost = 0;  // a hole in a hostile file may be any number of rows
  constexpr std::size_t kMostTried = 4096;
  for (std::size_t row = 0; row < table_.size() / row_bytes; ++row) {
    const auto bytes = std::span(table_).subspan(row * row_bytes, row_bytes);
    known_.push_back(putOneByteRight(bytes.first(lost < kMostTried ? row_bytes : 0), [&] {
      std::uint64_t checksum;
      std::memcpy(&checksum, bytes.data() + row_bytes - sizeof checksum, sizeof checksum);
      return checksum == checksum64(bytes.data(), row_bytes - sizeof checksum, row);
    }));
    lost += known_.back() ? 0 : 1;
  }
  // A longer text would take too long to put right.
  constexpr std::uint64_t kShort = 4096;
  if (header.provenance_bytes > PyramidTables::kMostProvenanceBytes) return;
  provenance_.resize(header.provenance_bytes);
  const auto text = std::as_writable_bytes(std::span(provenance_));
  const auto isRight = [&] {
    return checksum64(text.data(), text.size()) == header.provenance_checksum;
  };
  if (!readAt(header.provenance_offset, text) ||
      !putOneByteRight(text.first(text.size() <= kShort ? text.size() : 0), isRight))
    provenance_.clear();
}

bool TornFile::readAt(std::uint64_t offset, std::span<std::byte> out) const {
  return offset <= size_ && out.size() <= size_ - offset &&
         readBytesAt(fd_.get(), offset, out.data(), out.size()).bytes == out.size();
}

bool TornFile::read(const format::PartEntry& part, std::vector<std::byte>& out) const {
  if (part.stored_bytes > size_) return false;
  out.resize(part.stored_bytes);
  return readAt(part.offset, out) && checksum64(out.data(), out.size()) == part.checksum;
}

bool TornFile::hasZerosAlone(std::uint64_t offset, std::uint64_t bytes) const {
  std::vector<std::byte> some;
  for (; bytes > 0; offset += some.size(), bytes -= some.size()) {
    some.resize(std::min<std::uint64_t>(bytes, 4096));
    if (!readAt(offset, some) ||
        std::ranges::any_of(some, [](std::byte byte) { return byte != std::byte{0}; }))
      return false;
  }
  return true;
}

std::span<const std::byte> TornFile::rowBytes(std::size_t row) const {
  const std::size_t bytes = format::rowBytes(header_->kind_count);
  return std::span(table_).subspan(row * bytes, bytes);
}

BrickRow TornFile::row(std::size_t row) const {
  BrickRow result = {};
  for (format::PartEntry& part : result.parts)
    part.codec = static_cast<std::uint32_t>(format::Codec::kAbsent);
  if (row >= rowCount()) return result;
  const std::byte* at = rowBytes(row).data();
  for (std::uint32_t i = 0; i < header_->kind_count; ++i, at += sizeof(format::PartEntry))
    for (const PartKind kind : kPartKinds)
      if (kindNumber(kind) == header_->kinds[i])
        std::memcpy(&result.part(kind), at, sizeof(format::PartEntry));
  format::RowTail tail = {};
  std::memcpy(&tail, at, sizeof tail);
  result.range_min = tail.range_min;
  result.range_max = tail.range_max;
  result.constant = tail.constant;
  return result;
}

TornPyramid::TornPyramid(const std::string& path, std::uint64_t memory_bytes) {
  const std::string folder = isFolder(path) ? path : folderOf(path);
  const std::string index = (std::filesystem::path(folder) / kIndexName).string();
  // Every file of a divided pyramid has the facts of all.
  std::vector<std::string> names = {path};
  if (lowerExtension(folder) == kDividedEnding) {
    names = {index};
    static_cast<void>(visitFolder(folder, [&](const FolderMember& member) {
      if (member.path().extension() == ".isb") names.push_back(member.path().string());
      return true;
    }));
  }
  std::optional<TornFile> any;
  for (std::size_t i = 0; i < names.size() && !(any && any->header()); ++i) any.emplace(names[i]);
  if (!any->header())
    throw fileError(path, "'", path,
                    "' has no header of an isobrick pyramid of the versions 3 to 5 that is whole, "
                    "or damaged in one byte alone; build it again");
  const format::Header header = *any->header();
  spec_ = any->spec();
  layout_ = spec_.layout();
  if (header.super_cells > 0) {
    if (!isPowerOfTwoWithin(
            header.super_cells, header.brick_cells,
            header.brick_cells * static_cast<std::uint32_t>(SuperBricks::kMostBricksAlong)) ||
        layout_.lattice().levels() < 2)
      throw fileError(path, "'", path, "' has impossible numbers in its header; build it again");
    super_bricks_.emplace(layout_, header.super_cells);
    // A hostile header may promise any number.
    if (super_bricks_->count() > 2 * names.size())
      throw fileError(path, "'", path, "' lacks most of its ", super_bricks_->count(),
                      " files; build it again");
    index_.emplace(index);
    for (std::size_t number = 0; number < super_bricks_->count(); ++number) {
      TornFile file((std::filesystem::path(folder) / super_bricks_->fileName(number)).string());
      constexpr std::size_t kFacts = offsetof(format::Header, voxel_type);
      if (file.header() && (file.header()->super_brick != number + 1 ||
                            std::memcmp(&file.header()->voxel_type, &header.voxel_type,
                                        offsetof(format::Header, value_min) - kFacts) != 0))
        throw fileError(file.path(), "'", file.path(),
                        "' is a file of another pyramid; move it away");
      files_.push_back(std::move(file));
    }
  } else {
    files_.push_back(std::move(*any));
  }
  for (const TornFile& file : files_)
    if (provenance_.empty()) provenance_ = file.provenance();
  if (provenance_.empty() && index_) provenance_ = index_->provenance();
  if (spec_.level0 == Level0Place::kStored) return;
  source_ = std::make_unique<Level0Source>(
      SourceRequest{super_bricks_ ? folder : path, provenance_, spec_, memory_bytes});
  try {
    source_->bricks();
  } catch (const Cancelled&) {
    throw;
  } catch (const Error& error) {
    source_failure_ = error.what();
    source_.reset();
  }
}

bool TornPyramid::copySamples(const Index3& brick, std::vector<std::byte>& out) const {
  const std::size_t number = super_bricks_ ? super_bricks_->numberOf(0, brick) : 0;
  const TornFile& file = files_[number];
  const std::size_t row_number =
      super_bricks_ ? super_bricks_->rowOf(0, brick)
                    : static_cast<std::size_t>(linearIndex(brick, layout_.bricks(0)));
  const BrickRow row = file.row(row_number);
  const bool is_known = file.isKnown(row_number);
  const format::PartEntry& part = row.part(PartKind::kSamples);
  const std::size_t bytes = partBytes(spec_, layout_, PartKind::kSamples, 0, brick);
  const auto codec = static_cast<format::Codec>(part.codec);
  out.resize(bytes);
  if (is_known && codec == format::Codec::kConstant) {
    visitVoxelType(spec_.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      std::fill_n(reinterpret_cast<T*>(out.data()), bytes / sizeof(T),
                  static_cast<T>(row.constant));
    });
    return isPossibleConstant(row.constant, spec_);
  }
  if (source_ != nullptr) {
    try {
      source_->bricks().copySamples(brick, out.data());
    } catch (const Cancelled&) {
      throw;
    } catch (const Error&) {
      return false;
    }
    return !is_known || checksum64(out.data(), bytes) == part.checksum;
  }
  std::vector<std::byte> stored;
  return isPossiblePart(row, spec_, layout_, PartKind::kSamples, 0, brick) && isInFile(part) &&
         file.read(part, stored) && decodePart(codec, stored, bytes, out.data());
}

std::optional<std::set<std::int64_t>> TornPyramid::lostBricks(const CancelFlag* cancel) const {
  // Without the table a hostile header may promise any number of bricks.
  if (!super_bricks_ && source_ == nullptr && files_[0].rowCount() < TableRows(layout_).count())
    return std::nullopt;
  std::set<std::int64_t> lost;
  std::vector<std::byte> samples;
  const Index3 bricks = layout_.bricks(0);
  forEachIndex({Index3(0), bricks}, [&](const Index3& brick) {
    if (cancel != nullptr) cancel->check();
    if (!copySamples(brick, samples)) lost.insert(linearIndex(brick, bricks));
  });
  // Bricks of few cells, at the far border, lie in the aprons of their neighbours.
  std::set<std::int64_t> without_apron;
  for (const std::int64_t number : lost) {
    const Index3 brick = indexAt(number, bricks);
    const IndexBox own = layout_.brickOwnSamples(0, brick);
    bool is_covered = std::min({own.count.x, own.count.y, own.count.z}) <= 3;
    const Index3 first = glm::max(brick - Index3(1), Index3(0));
    const IndexBox around{first, glm::min(brick + Index3(2), bricks) - first};
    forEachIndex(is_covered ? own : IndexBox{}, [&](const Index3& voxel) {
      bool is_held = false;
      forEachIndex(around, [&](const Index3& other) {
        is_held = is_held || (!lost.contains(linearIndex(other, bricks)) &&
                              contains(layout_.brickSampleBox(0, other), voxel));
      });
      is_covered = is_covered && is_held;
    });
    if (!is_covered) without_apron.insert(number);
  }
  return without_apron;
}

TornVolume::TornVolume(const TornPyramid& pyramid, const std::string& name) : pyramid_(pyramid) {
  info_.voxels = pyramid.spec().voxels;
  info_.voxel_type = pyramid.spec().voxel_type;
  info_.geometry = pyramid.spec().geometry;
  info_.values = pyramid.spec().values;
  info_.source = name;
  info_.format = "isobrick pyramid";
}

void TornVolume::readBox(const IndexBox& box, void* out) const {
  const BrickLayout& layout = pyramid_.layout();
  const std::int64_t cells = layout.brickCells();
  std::memset(out, 0, static_cast<std::size_t>(box.size()) * voxelBytes(info_.voxel_type));
  const Index3 first = glm::max(box.first - Index3(2), Index3(0)) / cells;
  const Index3 end = glm::min(box.end() / cells + Index3(1), layout.bricks(0));
  std::vector<std::byte> samples;
  forEachIndex({first, end - first}, [&](const Index3& brick) {
    const IndexBox stored = layout.brickSampleBox(0, brick);
    const IndexBox wanted = intersectionOf(stored, box);
    if (wanted.size() == 0 || !pyramid_.copySamples(brick, samples)) return;
    visitVoxelType(info_.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      copyBox(SampleBlock<T>::dense(reinterpret_cast<const T*>(samples.data()), stored), wanted,
              static_cast<T*>(out), box);
    });
  });
}

}  // namespace isobrick
