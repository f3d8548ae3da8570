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
               std::uint64_t content_offset_bytes, std::string path, std::string header_path,
               const CancelFlag* cancel)
      : info_(std::move(info)),
        stored_(stored),
        stream_(std::move(stream)),
        content_offset_bytes_(content_offset_bytes),
        path_(std::move(path)),
        header_path_(std::move(header_path)),
        cancel_(cancel) {}

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const auto row_voxels = static_cast<std::size_t>(info_.voxels.x);
    const std::uint64_t at =
        content_offset_bytes_ + static_cast<std::uint64_t>(first) * row_voxels * stored_.bytes();
    if (at < position_) throw std::logic_error("rows of a stream are asked for in ascending order");
    skipTo(at);
    decodeVoxels(stored_, static_cast<std::size_t>(count) * row_voxels, out,
                 [&](std::byte* to, std::size_t bytes) { readBytes(to, bytes); });
    if (first + count == info_.voxels.y * info_.voxels.z) stream_->finish();
  }

  std::vector<std::string> files() const override { return headerAndData(header_path_, path_); }
  std::uint64_t bufferBytes() const override {
    return stream_->bufferBytes() + (stored_.keepsType() ? 0 : kDecodeBufferBytes);
  }

 private:
  // A request to cancel is checked after so many bytes: some milliseconds of inflating.
  static constexpr std::size_t kBytesPerLook = std::size_t{1} << 20;

  void checkCancel() const {
    if (cancel_ != nullptr) cancel_->check();
  }

  void skipTo(std::uint64_t at) {
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
    const std::uint64_t needed =
        content_offset_bytes_ +
        static_cast<std::uint64_t>(elementCount(info_.voxels)) * stored_.bytes();
    return unreadable(path_, "its content ends after " + std::to_string(position_) +
                                 " bytes and the header" +
                                 (header_path_ == path_ ? "" : " '" + header_path_ + "'") +
                                 " needs " + std::to_string(needed) + "; get the whole file again");
  }

  VolumeInfo info_;
  StoredVoxels stored_;
  std::unique_ptr<ByteStream> stream_;
  std::uint64_t content_offset_bytes_;
  std::string path_, header_path_;
  const CancelFlag* cancel_;
  std::uint64_t position_ = 0;  // bytes of content that were read
};

}  // namespace

std::unique_ptr<VolumeSource> openStream(VolumeInfo info, const StoredVoxels& stored,
                                         std::unique_ptr<ByteStream> stream,
                                         std::uint64_t content_offset_bytes,
                                         const std::string& path, const std::string& header_path,
                                         const CancelFlag* cancel) {
  const auto bytes = stored.bytesOf(elementCount(info.voxels));
  if (!bytes || content_offset_bytes > UINT64_MAX - *bytes)
    throw unreadable(header_path, "it says that the voxels begin at byte " +
                                      std::to_string(content_offset_bytes) + " and have " +
                                      std::to_string(stored.bytes()) +
                                      " bytes each; correct its header");
  return std::make_unique<StreamSource>(std::move(info), stored, std::move(stream),
                                        content_offset_bytes, path, header_path, cancel);
}

}  // namespace isobrick
