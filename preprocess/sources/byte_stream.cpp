#include "isobrick/preprocess/sources/byte_stream.h"

#include <bzlib.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <new>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"

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

class Base64Stream final : public PieceStream {
 public:
  Base64Stream(std::shared_ptr<const InputFile> file, std::uint64_t offset)
      : file_(std::move(file)), at_(offset), text_(kTextBytes) {}

  std::uint64_t bufferBytes() const override { return kTextBytes + kDecodedBytes; }

 private:
  static constexpr std::size_t kTextBytes = std::size_t{64} << 10;
  // A group that began in the text before may end in this one.
  static constexpr std::size_t kDecodedBytes = kTextBytes / 4 * 3 + 3;

  bool refill() override {
    piece_.resize(kDecodedBytes);
    filled_ = 0;
    while (!ended_ && filled_ == 0) {
      const std::size_t got = file_->readAt(at_, text_.data(), text_.size());
      if (got == 0) ended_ = true;
      decode(got);
      at_ += got;
    }
    piece_.resize(filled_);
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
        throw unreadable(file_->path(), "its base64 data are damaged at byte ", at_ + i,
                         "; get the whole file again");
      }
    }
  }

  void endGroup() {
    for (int i = 0; i < 3 - paddings_; ++i)
      piece_[filled_++] = static_cast<std::byte>(group_ >> (16 - 8 * i) & 0xff);
    group_ = 0;
    digits_ = paddings_ = 0;
  }

  std::shared_ptr<const InputFile> file_;
  std::uint64_t at_;  // of the text that is decoded next
  std::vector<unsigned char> text_;
  std::size_t filled_ = 0;  // bytes of the piece
  // Four digits, some of them padding, are a group of three bytes or fewer.
  std::uint32_t group_ = 0;
  int digits_ = 0, paddings_ = 0;
  bool ended_ = false;
};

constexpr std::size_t kMostWordBytes = 400;  // a double in full has some more than 300 digits

class TextNumbers final : public PieceStream {
 public:
  TextNumbers(std::shared_ptr<const InputFile> file, std::uint64_t offset, StoredType type,
              std::uint64_t count)
      : file_(std::move(file)), at_(offset), type_(type), left_(count) {}

  std::uint64_t bufferBytes() const override { return 5 * kTextBytes; }

 private:
  static constexpr std::size_t kTextBytes = std::size_t{32} << 10;
  static constexpr std::string_view kBetween = " \t\r\n,";

  bool refill() override {
    piece_.clear();
    std::string text;
    while (piece_.empty() && !ended_ && left_ > 0) {
      text.resize(kTextBytes);
      text.resize(file_->readAt(at_, text.data(), text.size()));
      const std::size_t end = text.find('<');
      ended_ = end != std::string::npos || text.size() < kTextBytes;
      const std::size_t taken = takeWords(std::string_view(text).substr(0, end));
      if (taken == 0 && !ended_) throw noNumber(text, 0);
      at_ += taken;
    }
    return !piece_.empty();
  }

  // All but the last one, which may go on in the text behind. Returns where that begins.
  std::size_t takeWords(std::string_view text) {
    std::size_t at = 0;
    for (;;) {
      const std::size_t begin = std::min(text.find_first_not_of(kBetween, at), text.size());
      const std::size_t end = text.find_first_of(kBetween, begin);
      if (begin == text.size() || left_ == 0) return begin;
      if (end == std::string_view::npos && !ended_) return begin;
      append(text, begin, std::min(end, text.size()));
      at = std::min(end, text.size());
    }
  }

  void append(std::string_view text, std::size_t begin, std::size_t end) {
    const std::string_view word = text.substr(begin, end - begin);
    visitStoredType(type_, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      std::optional<T> number;
      if constexpr (std::is_arithmetic_v<T>)
        if (word.size() <= kMostWordBytes)
          number = numberIn<T>(word.substr(word.starts_with('+') ? 1 : 0));
      if (!number) throw noNumber(word, begin);
      const std::size_t size = piece_.size();
      piece_.resize(size + sizeof(T));
      std::memcpy(piece_.data() + size, &*number, sizeof(T));
      --left_;
    });
  }

  Error noNumber(std::string_view word, std::size_t offset) const {
    return unreadable(file_->path(), "its word ", quotedText(std::string(word), 40), " at byte ",
                      at_ + offset, " is no number of its type; correct it");
  }

  std::shared_ptr<const InputFile> file_;
  std::uint64_t at_;  // of the text that is read next
  StoredType type_;
  std::uint64_t left_;  // numbers that were not read yet
  bool ended_ = false;
};

}  // namespace

std::size_t PieceStream::read(void* out, std::size_t bytes) {
  std::size_t got = 0;
  while (got < bytes) {
    if (next_ == piece_.size()) {
      next_ = 0;
      if (!refill()) {
        piece_.clear();
        break;
      }
    }
    const std::size_t part = std::min(bytes - got, piece_.size() - next_);
    std::memcpy(static_cast<std::byte*>(out) + got, piece_.data() + next_, part);
    next_ += part;
    got += part;
  }
  return got;
}

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

namespace {

// Members end with an end mark.
class InflateStream final : public ByteStream {
 public:
  InflateStream(const std::string& path, std::unique_ptr<ByteStream> packed)
      : path_(path), packed_(std::move(packed)), input_(kInputBytes) {
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

  // False if the content ends with the member before.
  bool beginMember() {
    const bool is_first = !began_;
    began_ = true;
    // The first one is there: if it is empty, that is an end before the end mark.
    if (!is_first && !atGzipMagic()) return false;
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
      throw unreadable(path_, "its compressed data are cut short after ", content_bytes_,
                       " bytes of content; get the whole file again");
    const uInt most = static_cast<uInt>(std::min(bytes, std::size_t{1} << 30));
    zlib_.next_out = out;
    zlib_.avail_out = most;
    const int result = inflate(&zlib_, Z_NO_FLUSH);
    const std::size_t got = most - zlib_.avail_out;
    content_bytes_ += got;
    if (result == Z_STREAM_END) {
      in_member_ = false;
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
    return unreadable(path_, "its compressed data are damaged after ", content_bytes_,
                      " bytes of content; get the whole file again");
  }

  std::string path_;
  std::unique_ptr<ByteStream> packed_;
  std::vector<Bytef> input_;
  z_stream zlib_ = {};
  std::uint64_t content_bytes_ = 0;
  bool began_ = false, in_member_ = false;
};

}  // namespace

std::unique_ptr<ByteStream> makeInflateStream(const std::string& path,
                                              std::unique_ptr<ByteStream> packed) {
  return std::make_unique<InflateStream>(path, std::move(packed));
}

namespace {

class BunzipStream final : public ByteStream {
 public:
  BunzipStream(const std::string& path, std::unique_ptr<ByteStream> packed)
      : path_(path), packed_(std::move(packed)), input_(std::size_t{256} << 10) {
    if (BZ2_bzDecompressInit(&bzip_, 0, 0) != BZ_OK) throw std::bad_alloc();
  }
  ~BunzipStream() override { BZ2_bzDecompressEnd(&bzip_); }
  BunzipStream(const BunzipStream&) = delete;

  std::size_t read(void* out, std::size_t bytes) override {
    std::size_t got = 0;
    while (got < bytes && !has_ended_) {
      if (bzip_.avail_in == 0) {
        bzip_.next_in = input_.data();
        bzip_.avail_in = static_cast<unsigned>(packed_->read(input_.data(), input_.size()));
      }
      const bool is_cut = bzip_.avail_in == 0;
      const auto most = static_cast<unsigned>(std::min(bytes - got, std::size_t{1} << 30));
      bzip_.next_out = static_cast<char*>(out) + got;
      bzip_.avail_out = most;
      const int result = BZ2_bzDecompress(&bzip_);
      got += most - bzip_.avail_out;
      has_ended_ = result == BZ_STREAM_END;
      if (!has_ended_ && (result != BZ_OK || (is_cut && bzip_.avail_out == most)))
        throw unreadable(path_, "its compressed data are ", is_cut ? "cut short" : "damaged",
                         "; get the whole file again");
    }
    return got;
  }
  void finish() override {  // reads the checksum, if it is near
    char rest[4096];
    read(rest, sizeof rest);
  }

 private:
  std::string path_;
  std::unique_ptr<ByteStream> packed_;
  std::vector<char> input_;
  bz_stream bzip_ = {};
  bool has_ended_ = false;
};

}  // namespace

std::unique_ptr<ByteStream> makeBunzipStream(const std::string& path,
                                             std::unique_ptr<ByteStream> packed) {
  return std::make_unique<BunzipStream>(path, std::move(packed));
}

std::unique_ptr<ByteStream> makeTextNumbers(std::shared_ptr<const InputFile> file,
                                            std::uint64_t offset, StoredType type,
                                            std::uint64_t count) {
  return std::make_unique<TextNumbers>(std::move(file), offset, type, count);
}

}  // namespace isobrick
