#include "isobrick/preprocess/sources/inflate_stream.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <new>
#include <utility>
#include <vector>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Members end with an end mark: they are those of a gzip file, or the blocks of a VTK file.
class InflateStream final : public ByteStream {
 public:
  InflateStream(const std::string& path, std::unique_ptr<ByteStream> packed,
                std::uint64_t block_bytes, std::uint64_t total_bytes)
      : path_(path),
        packed_(std::move(packed)),
        block_bytes_(block_bytes),
        total_bytes_(total_bytes),
        input_(kInputBytes) {
    constexpr int kAnyWindow = 15, kGzipOrZlib = 32;
    if (inflateInit2(&zlib_, kAnyWindow + kGzipOrZlib) != Z_OK) throw std::bad_alloc();
  }
  ~InflateStream() override { inflateEnd(&zlib_); }
  InflateStream(const InflateStream&) = delete;
  InflateStream& operator=(const InflateStream&) = delete;

  std::size_t read(void* out, std::size_t bytes) override {
    std::size_t got = 0;
    while (got < bytes && (in_member_ || beginMember()))
      got += inflatePart(static_cast<Bytef*>(out) + got, bytes - got);
    return got;
  }

  void finish() override {
    // If the content is longer than the part that was needed, its checksum is too far.
    std::array<Bytef, 4096> rest;
    for (int parts = 0; in_member_ && parts < 16; ++parts) inflatePart(rest.data(), rest.size());
  }

  std::uint64_t bufferBytes() const override {
    constexpr std::uint64_t kZlibBytes = 48 << 10;  // its window and its tables
    return kInputBytes + kZlibBytes + packed_->bufferBytes();
  }

 private:
  static constexpr std::size_t kInputBytes = std::size_t{256} << 10;

  bool isBlocks() const { return block_bytes_ != 0; }

  // False if the content ends with the member before.
  bool beginMember() {
    const bool is_first = !began_;
    began_ = true;
    // The first one is there: if it is empty, that is an end before the end mark.
    if (!is_first && (isBlocks() ? content_bytes_ >= total_bytes_ : !atGzipMagic())) return false;
    if (!is_first && inflateReset(&zlib_) != Z_OK) throw damaged();
    in_member_ = true;
    return true;
  }

  bool atGzipMagic() {
    while (zlib_.avail_in < 2 && refill()) {
    }
    return zlib_.avail_in >= 2 && zlib_.next_in[0] == 0x1f && zlib_.next_in[1] == 0x8b;
  }

  // Writes up to `bytes`; returns how many, which may be 0.
  std::size_t inflatePart(Bytef* out, std::size_t bytes) {
    if (zlib_.avail_in == 0 && !refill())
      throw unreadable(path_, "its compressed data are cut short after " +
                                  std::to_string(content_bytes_) +
                                  " bytes of content; get the whole file again");
    const uInt most = static_cast<uInt>(std::min(bytes, std::size_t{1} << 30));
    zlib_.next_out = out;
    zlib_.avail_out = most;
    const int result = inflate(&zlib_, Z_NO_FLUSH);
    const std::size_t got = most - zlib_.avail_out;
    content_bytes_ += got;
    if (result == Z_STREAM_END) {
      in_member_ = false;
      if (isBlocks() && content_bytes_ % block_bytes_ != 0 && content_bytes_ != total_bytes_)
        throw damaged();
    } else if (result == Z_MEM_ERROR) {
      throw std::bad_alloc();
    } else if (result != Z_OK && result != Z_BUF_ERROR) {
      // Z_BUF_ERROR is no progress: more input is needed, which the next call fetches or misses.
      throw damaged();
    }
    return got;
  }

  // Appends to the input that zlib has not taken yet; false at the end.
  bool refill() {
    if (zlib_.avail_in > 0) std::memmove(input_.data(), zlib_.next_in, zlib_.avail_in);
    const std::size_t got =
        packed_->read(input_.data() + zlib_.avail_in, input_.size() - zlib_.avail_in);
    zlib_.next_in = input_.data();
    zlib_.avail_in += static_cast<uInt>(got);
    return got > 0;
  }

  Error damaged() const {
    return unreadable(path_, "its compressed data are damaged after " +
                                 std::to_string(content_bytes_) +
                                 " bytes of content; get the whole file again");
  }

  std::string path_;
  std::unique_ptr<ByteStream> packed_;
  std::uint64_t block_bytes_, total_bytes_;  // of VTK's blocks; 0 for gzip
  std::vector<Bytef> input_;
  z_stream zlib_ = {};
  std::uint64_t content_bytes_ = 0;
  bool began_ = false, in_member_ = false;
};

}  // namespace

std::unique_ptr<ByteStream> makeInflateStream(const std::string& path,
                                              std::unique_ptr<ByteStream> packed) {
  return std::make_unique<InflateStream>(path, std::move(packed), 0, 0);
}

std::unique_ptr<ByteStream> makeInflateBlocksStream(const std::string& path,
                                                    std::unique_ptr<ByteStream> packed,
                                                    std::uint64_t block_bytes,
                                                    std::uint64_t total_bytes) {
  return std::make_unique<InflateStream>(path, std::move(packed), block_bytes, total_bytes);
}

}  // namespace isobrick
