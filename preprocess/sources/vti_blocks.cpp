#include "isobrick/preprocess/sources/vti_blocks.h"

#include <lz4.h>
#include <lzma.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

constexpr std::uint64_t kMostBlockBytes = std::uint64_t{1} << 30;

bool unpackLz4(const std::byte* in, std::size_t in_bytes, std::byte* out, std::size_t out_bytes) {
  return LZ4_decompress_safe(reinterpret_cast<const char*>(in), reinterpret_cast<char*>(out),
                             static_cast<int>(in_bytes),
                             static_cast<int>(out_bytes)) == static_cast<int>(out_bytes);
}

bool unpackLzma(const std::byte* in, std::size_t in_bytes, std::byte* out, std::size_t out_bytes) {
  std::uint64_t memory_bytes = std::uint64_t{1} << 28;  // its dictionary takes 64 MiB at most
  std::size_t taken = 0, made = 0;
  return lzma_stream_buffer_decode(
             &memory_bytes, 0, nullptr, reinterpret_cast<const std::uint8_t*>(in), &taken, in_bytes,
             reinterpret_cast<std::uint8_t*>(out), &made, out_bytes) == LZMA_OK &&
         made == out_bytes;
}

class VtiBlocksStream final : public ByteStream {
 public:
  VtiBlocksStream(const std::string& path, std::unique_ptr<ByteStream> sizes,
                  std::unique_ptr<ByteStream> packed, const VtiBlockLayout& layout,
                  UnpackVtiBlock unpack)
      : path_(path),
        sizes_(std::move(sizes)),
        packed_(std::move(packed)),
        layout_(layout),
        unpack_(unpack) {
    if (std::min(layout_.block_bytes, layout_.total_bytes) > kMostBlockBytes)
      throw unusable(path_,
                     "its compressed blocks have more than 1 GiB; save it again with "
                     "smaller ones");
  }

  std::size_t read(void* out, std::size_t bytes) override {
    std::size_t got = 0;
    while (got < bytes && (next_ < block_.size() || loadBlock())) {
      const std::size_t part = std::min(bytes - got, block_.size() - next_);
      std::memcpy(static_cast<std::byte*>(out) + got, block_.data() + next_, part);
      next_ += part;
      got += part;
    }
    return got;
  }

  std::uint64_t bufferBytes() const override {
    return 2 * std::min(layout_.block_bytes, layout_.total_bytes) + sizes_->bufferBytes() +
           packed_->bufferBytes();
  }

 private:
  // False behind the last one.
  bool loadBlock() {
    content_bytes_ += block_.size();
    if (content_bytes_ == layout_.total_bytes) return false;
    block_.resize(static_cast<std::size_t>(
        std::min(layout_.block_bytes, layout_.total_bytes - content_bytes_)));
    next_ = 0;
    std::array<std::byte, 8> word{};
    if (sizes_->read(word.data(), layout_.word_bytes) != layout_.word_bytes)
      throw failed("cut short");
    const std::uint64_t bytes = loadUnsigned(word.data(), layout_.word_bytes, layout_.big_endian);
    // None is much longer than what it holds.
    if (bytes > 2 * kMostBlockBytes || bytes / 2 > block_.size() + 1024) throw failed("damaged");
    in_.resize(static_cast<std::size_t>(bytes));
    if (packed_->read(in_.data(), in_.size()) != in_.size()) throw failed("cut short");
    if (!unpack_(in_.data(), in_.size(), block_.data(), block_.size())) throw failed("damaged");
    return true;
  }

  Error failed(const std::string& how) const {
    return unreadable(path_, "its compressed data are " + how + " after " +
                                 std::to_string(content_bytes_) +
                                 " bytes of content; get the whole file again");
  }

  std::string path_;
  std::unique_ptr<ByteStream> sizes_, packed_;
  VtiBlockLayout layout_;
  UnpackVtiBlock unpack_;
  std::vector<std::byte> in_, block_;
  std::size_t next_ = 0;             // in block_
  std::uint64_t content_bytes_ = 0;  // of the blocks before
};

}  // namespace

UnpackVtiBlock vtiUnpackerNamed(const std::string& compressor) {
  if (compressor == "vtkLZ4DataCompressor") return unpackLz4;
  if (compressor == "vtkLZMADataCompressor") return unpackLzma;
  return nullptr;
}

std::unique_ptr<ByteStream> makeVtiBlocksStream(const std::string& path,
                                                std::unique_ptr<ByteStream> sizes,
                                                std::unique_ptr<ByteStream> packed,
                                                const VtiBlockLayout& layout,
                                                UnpackVtiBlock unpack) {
  return std::make_unique<VtiBlocksStream>(path, std::move(sizes), std::move(packed), layout,
                                           unpack);
}

}  // namespace isobrick
