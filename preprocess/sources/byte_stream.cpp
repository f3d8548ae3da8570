#include "isobrick/preprocess/sources/byte_stream.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

class FileStream final : public ByteStream {
 public:
  FileStream(std::shared_ptr<const InputFile> file, std::uint64_t offset)
      : file_(std::move(file)), at_(offset) {}

  std::size_t read(void* out, std::size_t bytes) override {
    const std::size_t got = file_->readAt(at_, out, bytes);
    at_ += got;
    return got;
  }

 private:
  std::shared_ptr<const InputFile> file_;
  std::uint64_t at_;
};

// The meaning of a character of base64 text: 0 .. 63, or one of these.
constexpr std::uint8_t kBlank = 64, kPadding = 65, kEnd = 66, kForeign = 67;

constexpr std::array<std::uint8_t, 256> makeMeanings() {
  std::array<std::uint8_t, 256> meanings{};
  meanings.fill(kForeign);
  constexpr const char* kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::uint8_t i = 0; i < 64; ++i) meanings[static_cast<unsigned char>(kDigits[i])] = i;
  for (const char blank : {' ', '\t', '\r', '\n'})
    meanings[static_cast<unsigned char>(blank)] = kBlank;
  meanings['='] = kPadding;
  meanings['<'] = kEnd;
  return meanings;
}
constexpr std::array<std::uint8_t, 256> kMeanings = makeMeanings();

class Base64Stream final : public ByteStream {
 public:
  Base64Stream(std::shared_ptr<const InputFile> file, std::uint64_t offset)
      : file_(std::move(file)), at_(offset), text_(kTextBytes), decoded_(kDecodedBytes) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* to = static_cast<std::byte*>(out);
    std::size_t got = 0;
    while (got < bytes) {
      if (next_ == filled_ && !refill()) break;
      const std::size_t part = std::min(bytes - got, filled_ - next_);
      std::memcpy(to + got, decoded_.data() + next_, part);
      got += part;
      next_ += part;
    }
    return got;
  }

  std::uint64_t bufferBytes() const override { return kTextBytes + kDecodedBytes; }

 private:
  static constexpr std::size_t kTextBytes = std::size_t{64} << 10;
  // A group that began in the text before may end in this one.
  static constexpr std::size_t kDecodedBytes = kTextBytes / 4 * 3 + 3;

  // Decodes the next piece of text; false if there is none.
  bool refill() {
    next_ = filled_ = 0;
    while (!ended_ && filled_ == 0) {
      const std::size_t got = file_->readAt(at_, text_.data(), text_.size());
      if (got == 0) ended_ = true;
      decode(got);
      at_ += got;
    }
    return filled_ > 0;
  }

  void decode(std::size_t count) {
    for (std::size_t i = 0; i < count && !ended_; ++i) {
      const std::uint8_t meaning = kMeanings[text_[i]];
      if (meaning < 64 && paddings_ == 0) {
        group_ = group_ << 6 | meaning;
        if (++digits_ == 4) endGroup();
      } else if (meaning == kEnd) {
        ended_ = true;
      } else if (meaning == kPadding && digits_ >= 2) {
        group_ <<= 6;
        ++paddings_;
        if (++digits_ == 4) endGroup();
      } else if (meaning != kBlank) {
        throw unreadable(file_->path(), "its base64 data are damaged at byte " +
                                            std::to_string(at_ + i) + "; get the whole file again");
      }
    }
  }

  void endGroup() {
    for (int i = 0; i < 3 - paddings_; ++i)
      decoded_[filled_++] = static_cast<std::byte>(group_ >> (16 - 8 * i) & 0xff);
    group_ = 0;
    digits_ = paddings_ = 0;
  }

  std::shared_ptr<const InputFile> file_;
  std::uint64_t at_;  // of the text that is decoded next
  std::vector<unsigned char> text_;
  std::vector<std::byte> decoded_;  // of which [next_, filled_) was not yet read
  std::size_t next_ = 0, filled_ = 0;
  // Four digits, some of them padding, are a group of three bytes or fewer.
  std::uint32_t group_ = 0;
  int digits_ = 0, paddings_ = 0;
  bool ended_ = false;
};

}  // namespace

std::uint64_t skipBytes(ByteStream& stream, std::uint64_t bytes) {
  std::vector<std::byte> scratch(std::min<std::uint64_t>(bytes, std::uint64_t{64} << 10));
  std::uint64_t skipped = 0;
  while (skipped < bytes) {
    const std::size_t part = std::min<std::uint64_t>(bytes - skipped, scratch.size());
    const std::size_t got = stream.read(scratch.data(), part);
    skipped += got;
    if (got < part) break;
  }
  return skipped;
}

std::unique_ptr<ByteStream> makeFileStream(std::shared_ptr<const InputFile> file,
                                           std::uint64_t offset) {
  return std::make_unique<FileStream>(std::move(file), offset);
}

std::unique_ptr<ByteStream> makeBase64Stream(std::shared_ptr<const InputFile> file,
                                             std::uint64_t offset) {
  return std::make_unique<Base64Stream>(std::move(file), offset);
}

}  // namespace isobrick
