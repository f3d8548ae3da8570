#include "isobrick/preprocess/sources/raw_run.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

namespace {

// Rows of fewer bytes are read with what lies between their parts: a call of the system takes as
// long as copying so many.
constexpr std::uint64_t kShortRow = 4096;
constexpr std::uint64_t kShortRowsAtOnce = std::uint64_t{64} << 10;

}  // namespace

void StoredBlock::read(const IndexBox& box, void* out) const {
  // As few reads as the file allows: rows that adjoin are one.
  const bool has_whole_rows = box.count.x == voxels.x;
  const bool has_whole_slices = has_whole_rows && box.count.y == voxels.y;
  const std::int64_t slices = has_whole_slices ? 1 : box.count.z;
  const std::int64_t rows = has_whole_rows ? 1 : box.count.y;
  const std::int64_t count = box.size() / (slices * rows);
  const std::uint64_t slice_bytes =
      static_cast<std::uint64_t>(voxels.x * voxels.y) * stored.bytes();
  const auto readBytes = [&](std::uint64_t from, std::byte* part, std::size_t n) {
    const std::size_t got = file.readAt(from, part, n);
    if (got < n)
      throw becameShorter(file,
                          first_slice + static_cast<std::int64_t>((from + got - at) / slice_bytes),
                          from + got);
  };
  const std::uint64_t row_bytes = static_cast<std::uint64_t>(voxels.x) * stored.bytes();
  const auto part_bytes = static_cast<std::uint64_t>(count) * stored.bytes();
  const bool are_short = rows > 1 && row_bytes <= kShortRow;
  const auto rows_at_once = static_cast<std::int64_t>(kShortRowsAtOnce / row_bytes);
  std::vector<std::byte> some(are_short ? kShortRowsAtOnce : 0);
  std::uint64_t begin = 0;  // of the rows in it
  auto* to = static_cast<std::byte*>(out);
  for (std::int64_t z = 0; z < slices; ++z)
    for (std::int64_t y = 0; y < rows; ++y) {
      const std::int64_t first = linearIndex(box.first + Index3(0, y, z), voxels);
      std::uint64_t next = at + static_cast<std::uint64_t>(first) * stored.bytes();
      if (are_short && y % rows_at_once == 0) {
        begin = next;
        const auto more = static_cast<std::uint64_t>(std::min(rows - y, rows_at_once) - 1);
        readBytes(begin, some.data(), more * row_bytes + part_bytes);
      }
      decodeVoxels(stored, static_cast<std::size_t>(count), to,
                   [&](std::byte* part, std::size_t n) {
                     if (are_short)
                       std::memcpy(part, some.data() + (next - begin), n);
                     else
                       readBytes(next, part, n);
                     next += n;
                   });
      to += static_cast<std::size_t>(count) * voxelBytes(stored.delivered());
    }
}

Error becameShorter(const InputFile& file, std::int64_t slice, std::uint64_t at) {
  return fileError(file.path(), "cannot read slice ", slice, " of '", file.path(), "' at byte ", at,
                   ": the file became shorter meanwhile; check the file, then run again");
}

namespace {

// The types of a file without a header.
constexpr StoredType kRawTypes[] = {StoredType::kUint8, StoredType::kInt8,    StoredType::kUint16,
                                    StoredType::kInt16, StoredType::kFloat32, StoredType::kUint32,
                                    StoredType::kInt32, StoredType::kFloat64};

StoredType storedType(const std::string& path, const std::string& name) {
  for (const StoredType type : kRawTypes)
    if (name == infoOf(type).name || name == infoOf(type).short_name || name == infoOf(type).c_name)
      return type;
  ListText names;
  for (const std::string& known : rawTypeNames()) names.add(known);
  throw unreadable(path, "unknown voxel type '", name, "'; choose one of ", names.text());
}

// Reads every row or box straight from the file.
class RawSource final : public VolumeSource {
 public:
  RawSource(VolumeInfo info, const RawRun& run, const StoredVoxels& stored)
      : info_(std::move(info)),
        stored_(stored),
        header_path_(run.header_path),
        offset_bytes_(run.offset_bytes),
        file_(run.path, run.header_path == run.path ? "" : run.header_path) {
    checkSize();
  }

  const VolumeInfo& info() const override { return info_; }

  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    StoredBlock{file_, offset_bytes_, stored_, info_.voxels}.read(box, out);
  }
  std::vector<std::string> files() const override {
    if (header_path_.empty() || header_path_ == file_.path()) return {file_.path()};
    return {header_path_, file_.path()};
  }
  std::uint64_t bufferBytes() const override {
    return stored_.keepsType() ? 0 : kDecodeBufferBytes;
  }

 private:
  // Compares the size of the file with the layout's.
  void checkSize() const {
    const auto voxel_bytes = stored_.bytesOf(elementCount(info_.voxels));
    const std::uint64_t have = file_.size();
    std::uint64_t need = 0;
    const bool overflow =
        !voxel_bytes || __builtin_add_overflow(*voxel_bytes, offset_bytes_, &need);
    const bool may_be_longer = !header_path_.empty();
    if (!overflow && (have == need || (may_be_longer && have > need))) return;
    const std::string needed = overflow ? "more than 2^64" : std::to_string(need);
    const std::string sizes =
        concat("cannot read '", file_.path(), "': it has ", have, " bytes, but an offset of ",
               offset_bytes_, " and ", indexText(info_.voxels, " x "), " voxels of ",
               stored_.bytes(), stored_.bytes() == 1 ? " byte make " : " bytes make ", needed);
    if (!header_path_.empty())
      throw fileError(header_path_, sizes, " (from the header '", header_path_,
                      "'); get the whole file again");
    throw fileError(file_.path(), sizes, "; correct the layout",
                    overflow || have < need ? ", or get the whole file" : "",
                    Remedy::kCorrectRawLayout);
  }

  VolumeInfo info_;
  StoredVoxels stored_;
  std::string header_path_;  // empty if the user described the file
  std::uint64_t offset_bytes_;
  InputFile file_;
};

}  // namespace

std::vector<std::string> rawTypeNames() {
  std::vector<std::string> names;
  for (const StoredType type : kRawTypes) names.emplace_back(infoOf(type).short_name);
  return names;
}

std::unique_ptr<VolumeSource> openRawSource(const std::string& path, const RawLayout& layout) {
  StoredVoxels stored;
  stored.type = storedType(path, layout.type);
  stored.big_endian = layout.big_endian;
  checkVoxelCounts(path, layout.voxels);
  VolumeInfo info;
  info.voxels = layout.voxels;
  info.voxel_type = stored.delivered();
  info.source = path;
  info.format = "raw";
  info.encoding = concat(layout.type, layout.big_endian ? " big-endian" : " little-endian",
                         " at byte ", layout.offset_bytes);
  tidyGeometry(path, info.geometry, info.voxels, info.notes);
  RawRun run;
  run.path = path;
  run.offset_bytes = layout.offset_bytes;
  return std::make_unique<RawSource>(std::move(info), run, stored);
}

std::unique_ptr<VolumeSource> openRawRun(VolumeInfo info, const RawRun& run,
                                         const StoredVoxels& stored) {
  return std::make_unique<RawSource>(std::move(info), run, stored);
}

namespace {

class StreamSource final : public VolumeSource {
 public:
  StreamSource(VolumeInfo info, const StoredVoxels& stored, std::unique_ptr<ByteStream> stream,
               std::uint64_t content_offset_bytes, std::vector<std::string> files,
               const RowStrides& strides, const CancelFlag* cancel)
      : info_(std::move(info)),
        stored_(stored),
        stream_(std::move(stream)),
        content_offset_bytes_(content_offset_bytes),
        files_(std::move(files)),
        strides_(strides),
        cancel_(cancel) {
    const std::uint64_t row = static_cast<std::uint64_t>(info_.voxels.x) * stored_.bytes();
    if (strides_.row_bytes == 0) strides_.row_bytes = row;
    const std::uint64_t slice = strides_.row_bytes * static_cast<std::uint64_t>(info_.voxels.y);
    if (strides_.slice_bytes == 0) strides_.slice_bytes = slice;
    is_dense_ = strides_.row_bytes == row && strides_.slice_bytes == slice;
  }

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const std::int64_t rows_together = is_dense_ ? count : 1;
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t row = first; row < first + count; row += rows_together) {
      skipTo(rowAt(row));
      const auto voxels = static_cast<std::size_t>(rows_together * info_.voxels.x);
      decodeVoxels(stored_, voxels, to,
                   [&](std::byte* part, std::size_t bytes) { readBytes(part, bytes); });
      to += voxels * voxelBytes(stored_.delivered());
    }
    if (first + count == info_.voxels.y * info_.voxels.z) stream_->finish();
  }

  std::vector<std::string> files() const override { return files_; }
  std::uint64_t bufferBytes() const override {
    return stream_->bufferBytes() + (stored_.keepsType() ? 0 : kDecodeBufferBytes);
  }

 private:
  // A request to cancel is checked after so many bytes: some milliseconds of inflating.
  static constexpr std::size_t kBytesPerLook = std::size_t{1} << 20;

  void checkCancel() const {
    if (cancel_ != nullptr) cancel_->check();
  }

  std::uint64_t rowAt(std::int64_t row) const {
    const auto y = static_cast<std::uint64_t>(row % info_.voxels.y);
    const auto z = static_cast<std::uint64_t>(row / info_.voxels.y);
    return content_offset_bytes_ + z * strides_.slice_bytes + y * strides_.row_bytes;
  }

  void skipTo(std::uint64_t at) {
    if (at < position_) throw std::logic_error("rows of a stream are asked for in ascending order");
    while (position_ < at) {
      checkCancel();
      const std::uint64_t part = std::min<std::uint64_t>(at - position_, kBytesPerLook);
      const std::uint64_t skipped = skipBytes(*stream_, part);
      position_ += skipped;
      if (skipped < part) throw tooShort();
    }
  }

  void readBytes(std::byte* to, std::size_t bytes) {
    while (bytes > 0) {
      checkCancel();
      const std::size_t part = std::min(bytes, kBytesPerLook);
      const std::size_t got = stream_->read(to, part);
      position_ += got;
      if (got < part) throw tooShort();
      to += part;
      bytes -= part;
    }
  }

  Error tooShort() const {
    const std::uint64_t needed = rowAt(info_.voxels.y * info_.voxels.z - 1) +
                                 static_cast<std::uint64_t>(info_.voxels.x) * stored_.bytes();
    return unreadable(files_.back(), "its content ends after ", position_, " bytes and the header",
                      files_.size() == 1 ? "" : " '" + files_.front() + "'", " needs ", needed,
                      "; get the whole file again");
  }

  VolumeInfo info_;
  StoredVoxels stored_;
  std::unique_ptr<ByteStream> stream_;
  std::uint64_t content_offset_bytes_;
  std::vector<std::string> files_;
  RowStrides strides_;
  bool is_dense_ = true;
  const CancelFlag* cancel_;
  std::uint64_t position_ = 0;  // bytes of content that were read
};

}  // namespace

std::unique_ptr<VolumeSource> openStream(VolumeInfo info, const StoredVoxels& stored,
                                         std::unique_ptr<ByteStream> stream,
                                         std::uint64_t content_offset_bytes,
                                         std::vector<std::string> files, const RowStrides& strides,
                                         const CancelFlag* cancel) {
  const auto bytes = stored.bytesOf(elementCount(info.voxels));
  if (!bytes || content_offset_bytes > UINT64_MAX - *bytes)
    throw unreadable(files.front(), "it says that the voxels begin at byte ", content_offset_bytes,
                     " and have ", stored.bytes(), " bytes each; correct its header");
  return std::make_unique<StreamSource>(std::move(info), stored, std::move(stream),
                                        content_offset_bytes, std::move(files), strides, cancel);
}

}  // namespace isobrick
