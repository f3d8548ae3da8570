#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/unpack_block.h"
#include "isobrick/preprocess/sources/vti_header.h"

namespace isobrick {
namespace {

struct VtiBlockLayout {
  std::uint64_t block_bytes = 0;  // of each, unpacked, but for the last one
  std::uint64_t total_bytes = 0;
  std::uint64_t file_bytes = 0;
  std::size_t word_bytes = 8;  // of a number in the list of sizes
  bool big_endian = false;
};

constexpr std::uint64_t kMostBlockBytes = std::uint64_t{1} << 30;

// Unpacks one block after the other. `sizes` has the packed size of each, `packed` the blocks.
// Holds a block, packed and unpacked. Throws Error, naming `path`, if a block is damaged, cut
// short, or larger than 1 GiB.
class VtiBlocksStream final : public PieceStream {
 public:
  VtiBlocksStream(const std::string& path, std::unique_ptr<ByteStream> sizes,
                  std::unique_ptr<ByteStream> packed, const VtiBlockLayout& layout,
                  BlockCodec codec)
      : path_(path),
        sizes_(std::move(sizes)),
        packed_(std::move(packed)),
        layout_(layout),
        codec_(codec) {
    if (std::min(layout_.block_bytes, layout_.total_bytes) > kMostBlockBytes)
      throw unusable(path_,
                     "its compressed blocks have more than 1 GiB; save it again with smaller ones");
  }

  std::uint64_t bufferBytes() const override {
    return 2 * std::min(layout_.block_bytes, layout_.total_bytes) + sizes_->bufferBytes() +
           packed_->bufferBytes();
  }

 private:
  bool refill() override {
    content_bytes_ += piece_.size();
    if (content_bytes_ == layout_.total_bytes) return false;
    const std::uint64_t wanted =
        std::min(layout_.block_bytes, layout_.total_bytes - content_bytes_);
    std::array<std::byte, 8> word{};
    if (sizes_->read(word.data(), layout_.word_bytes) != layout_.word_bytes)
      throw failed("cut short");
    const std::uint64_t bytes = loadUnsigned(word.data(), layout_.word_bytes, layout_.big_endian);
    // None is much longer than what it holds, or holds more than its codec can pack.
    if (bytes > 2 * kMostBlockBytes || bytes / 2 > wanted + 1024 ||
        wanted > mostUnpackedBytes(codec_, bytes))
      throw failed("damaged");
    if (bytes > layout_.file_bytes) throw failed("cut short");
    in_.resize(static_cast<std::size_t>(bytes));
    if (packed_->read(in_.data(), in_.size()) != in_.size()) throw failed("cut short");
    piece_.resize(static_cast<std::size_t>(wanted));
    if (!unpackBlock(codec_, in_, piece_).empty()) throw failed("damaged");
    return true;
  }

  Error failed(const std::string& how) const {
    return unreadable(path_, "its compressed data are ", how, " after ", content_bytes_,
                      " bytes of content; get the whole file again");
  }

  std::string path_;
  std::unique_ptr<ByteStream> sizes_, packed_;
  VtiBlockLayout layout_;
  BlockCodec codec_;
  std::vector<std::byte> in_;
  std::uint64_t content_bytes_ = 0;  // of the blocks before
};

// Of a compressor by its name in the file; none for others.
std::optional<BlockCodec> vtiCodecNamed(const std::string& compressor) {
  if (compressor == "vtkZLibDataCompressor") return BlockCodec::kZlib;
  if (compressor == "vtkLZ4DataCompressor") return BlockCodec::kLz4;
  if (compressor == "vtkLZMADataCompressor") return BlockCodec::kLzma;
  return std::nullopt;
}

class VtiVoxels {
 public:
  VtiVoxels(std::shared_ptr<const InputFile> file, const VtiHeader& header, const VtiArray& array,
            const StoredVoxels& stored, const CancelFlag* cancel)
      : file_(std::move(file)), header_(header), array_(array), stored_(stored), cancel_(cancel) {}

  std::unique_ptr<VolumeSource> open(VolumeInfo info) {
    const auto bytes = stored_.bytesOf(elementCount(info.voxels));
    if (!bytes) throw wrongSize("less than 2^64");
    need_bytes_ = *bytes;
    if (array_.format == "ascii")
      return openStream(std::move(info), stored_,
                        makeTextNumbers(file_, array_.text_at, stored_.type,
                                        need_bytes_ / storedBytes(stored_.type)),
                        0, {file_->path()}, {}, cancel_);
    if (array_.type == "Bit")
      throw cannotUseVti(file_->path(),
                         "its bits are packed, and only those written as text are read");
    if (array_.format == "bare") {
      at_ = array_.text_at;
      return openPlain(std::move(info));
    }
    locate();
    const std::uint64_t first_word = readWord();
    if (header_.compressor.empty()) {
      if (first_word != need_bytes_) throw wrongSize(std::to_string(first_word));
      return openPlain(std::move(info));
    }
    return openBlocks(std::move(info), first_word);
  }

 private:
  // Opens the stream of the array's bytes in the file: numbers of its own, then the voxels.
  void locate() {
    is_base64_ = true;
    at_ = array_.text_at;
    if (array_.format == "appended") {
      if (header_.appended_encoding != "raw" && header_.appended_encoding != "base64")
        throw cannotUseVti(file_->path(), header_.appended_encoding.empty()
                                              ? "it has no appended data, which its array needs"
                                              : "the encoding " +
                                                    inQuotes(header_.appended_encoding) +
                                                    " of its appended data is unknown");
      is_base64_ = header_.appended_encoding == "base64";
      if (array_.offset > file_->size() - header_.appended_at)
        throw cannotUseVti(file_->path(), "the offset ", array_.offset,
                           " of its array lies behind the end of the file");
      at_ = header_.appended_at + array_.offset;
    } else if (array_.format != "binary") {
      throw cannotUseVti(file_->path(), "its voxels are in the format ", inQuotes(array_.format),
                         ", and only appended, binary and ascii are known");
    }
    const auto open = [&] {
      return is_base64_ ? makeBase64Stream(file_, at_) : makeFileStream(file_, at_);
    };
    stream_ = open();
    sizes_ = open();
  }

  std::uint64_t wordBytes() const { return header_.header_type == "UInt64" ? 8 : 4; }

  std::uint64_t readWord() {
    std::array<unsigned char, 8> bytes = {};
    const auto count = static_cast<std::size_t>(wordBytes());
    if (stream_->read(bytes.data(), count) != count)
      throw cannotUseVti(file_->path(), "its voxels are cut short at their beginning");
    at_ += count;
    return loadUnsigned(bytes.data(), count, stored_.big_endian);
  }

  std::unique_ptr<VolumeSource> openPlain(VolumeInfo info) {
    if (is_base64_)
      return openStream(std::move(info), stored_, std::move(stream_), 0, {file_->path()}, {},
                        cancel_);
    RawRun run;
    run.path = run.header_path = file_->path();
    run.offset_bytes = at_;
    return openRawRun(std::move(info), run, stored_);
  }

  std::unique_ptr<VolumeSource> openBlocks(VolumeInfo info, std::uint64_t blocks) {
    skipBytes(*sizes_, 3 * wordBytes());
    const std::uint64_t block_bytes = readWord();
    const std::uint64_t last_bytes = readWord();  // 0 if the last block is whole
    std::uint64_t whole_bytes = 0, have = 0;
    const std::uint64_t whole_blocks = blocks - (blocks > 0 && last_bytes > 0 ? 1 : 0);
    const bool fits = block_bytes > 0 && last_bytes <= block_bytes &&
                      !__builtin_mul_overflow(whole_blocks, block_bytes, &whole_bytes) &&
                      !__builtin_add_overflow(whole_bytes, last_bytes, &have);
    if (blocks == 0 || !fits || have != need_bytes_)
      throw wrongSize(fits ? std::to_string(have)
                           : std::to_string(blocks) + " blocks of " + std::to_string(block_bytes));
    // There are at most as many blocks as bytes in the file: no product overflows.
    if (blocks > file_->size() / wordBytes() ||
        skipBytes(*stream_, blocks * wordBytes()) != blocks * wordBytes())
      throw cannotUseVti(file_->path(), "its list of ", blocks, " blocks is cut short");
    auto unpacked = std::make_unique<VtiBlocksStream>(
        file_->path(), std::move(sizes_), std::move(stream_),
        VtiBlockLayout{block_bytes, need_bytes_, file_->size(),
                       static_cast<std::size_t>(wordBytes()), stored_.big_endian},
        *vtiCodecNamed(header_.compressor));
    return openStream(std::move(info), stored_, std::move(unpacked), 0, {file_->path()}, {},
                      cancel_);
  }

  Error wrongSize(const std::string& have) const {
    return cannotUseVti(file_->path(), "its array ", inQuotes(array_.name), " has ", have,
                        " bytes and its extent needs ", need_bytes_);
  }

  std::shared_ptr<const InputFile> file_;
  const VtiHeader& header_;
  const VtiArray& array_;
  StoredVoxels stored_;
  const CancelFlag* cancel_;
  std::uint64_t need_bytes_ = 0;
  // For the array: its encoding, and the first unread byte of it. at_ is that byte of the file only
  // if nothing is encoded.
  bool is_base64_ = false;
  std::uint64_t at_ = 0;
  std::unique_ptr<ByteStream> stream_;
  std::unique_ptr<ByteStream> sizes_;  // the same, for the list of the sizes of blocks
};

}  // namespace

bool knowsVtiCompressor(const std::string& compressor) {
  return compressor.empty() || vtiCodecNamed(compressor).has_value();
}

std::unique_ptr<VolumeSource> openVtiVoxels(std::shared_ptr<const InputFile> file,
                                            const VtiHeader& header, const VtiArray& array,
                                            const StoredVoxels& stored, VolumeInfo info,
                                            const CancelFlag* cancel) {
  return VtiVoxels(std::move(file), header, array, stored, cancel).open(std::move(info));
}

}  // namespace isobrick
