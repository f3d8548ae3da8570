// Voxels that come out of a stream of bytes and are never held whole.
#include <algorithm>
#include <stdexcept>
#include <utility>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {
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
    return unreadable(files_.back(), "its content ends after " + std::to_string(position_) +
                                         " bytes and the header" +
                                         (files_.size() == 1 ? "" : " '" + files_.front() + "'") +
                                         " needs " + std::to_string(needed) +
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
    throw unreadable(files.front(), "it says that the voxels begin at byte " +
                                        std::to_string(content_offset_bytes) + " and have " +
                                        std::to_string(stored.bytes()) +
                                        " bytes each; correct its header");
  return std::make_unique<StreamSource>(std::move(info), stored, std::move(stream),
                                        content_offset_bytes, std::move(files), strides, cancel);
}

}  // namespace isobrick
