#include "isobrick/preprocess/sources/number_files.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/inflate_stream.h"
#include "isobrick/preprocess/sources/source_checks.h"

namespace isobrick {
namespace {

using Form = NumberFiles::Form;

std::shared_ptr<const InputFile> openNumbers(const NumberFiles& files, const std::string& path) {
  return std::make_shared<const InputFile>(path,
                                           path == files.header_path ? "" : files.header_path);
}

// The characters of a file one by one.
class CharacterReader {
 public:
  CharacterReader(std::shared_ptr<const InputFile> file, std::uint64_t offset)
      : file_(std::move(file)), at_(offset) {}

  // The next one, or -1 at the end.
  int next() {
    if (next_ == filled_) {
      filled_ = file_->readAt(at_, text_.data(), text_.size());
      at_ += filled_;
      next_ = 0;
      if (filled_ == 0) return -1;
    }
    return static_cast<unsigned char>(text_[next_++]);
  }
  // Of the next character.
  std::uint64_t offset() const { return at_ - (filled_ - next_); }
  const std::string& path() const { return file_->path(); }

 private:
  std::shared_ptr<const InputFile> file_;
  std::uint64_t at_;
  std::array<char, 16 << 10> text_;
  std::size_t next_ = 0, filled_ = 0;
};

std::uint64_t behindLines(const std::shared_ptr<const InputFile>& file, const NumberFiles& files) {
  CharacterReader reader(file, files.first_byte);
  std::uint64_t lines = files.skipped_lines;
  while (lines > 0) {
    const int character = reader.next();
    if (character < 0)
      throw unreadable(file->path(),
                       "it has fewer lines than its header skips; correct the header");
    if (character == '\n') --lines;
  }
  return reader.offset();
}

// Numbers that are written as text, between blanks or commas.
class TextNumberStream final : public ByteStream {
 public:
  TextNumberStream(std::shared_ptr<const InputFile> file, std::uint64_t offset, StoredType type)
      : reader_(std::move(file), offset), type_(type) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* to = static_cast<std::byte*>(out);
    std::size_t got = 0;
    while (got < bytes && (left_ > 0 || nextNumber())) {
      const std::size_t part = std::min(left_, bytes - got);
      std::memcpy(to + got, number_.data() + (storedBytes(type_) - left_), part);
      left_ -= part;
      got += part;
    }
    return got;
  }
  std::uint64_t bufferBytes() const override { return sizeof *this; }

 private:
  static bool isBetween(int c) {
    return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == ',';
  }

  // Into number_; false at the end.
  bool nextNumber() {
    std::string word;
    constexpr std::size_t kMostCharacters = 100;
    for (int c = reader_.next(); c >= 0 && word.size() < kMostCharacters; c = reader_.next()) {
      if (!isBetween(c))
        word += static_cast<char>(c);
      else if (!word.empty())
        break;
    }
    if (word.empty()) return false;
    std::string_view digits(word);
    if (digits.starts_with('+')) digits.remove_prefix(1);
    if (!takeNumber(digits))
      throw unreadable(reader_.path(), quotedText(word, 40) + " before byte " +
                                           std::to_string(reader_.offset()) + " is no number of " +
                                           std::string(infoOf(type_).name) +
                                           "; correct the file or its header");
    left_ = storedBytes(type_);
    return true;
  }

  template <typename T>
  bool takeNumberOf(std::string_view digits) {
    const auto number = numberIn<T>(digits);
    if (number) std::memcpy(number_.data(), &*number, sizeof *number);
    return number.has_value();
  }
  bool takeNumber(std::string_view digits) {
    switch (type_) {
      case StoredType::kUint8:
        return takeNumberOf<std::uint8_t>(digits);
      case StoredType::kInt8:
        return takeNumberOf<std::int8_t>(digits);
      case StoredType::kUint16:
        return takeNumberOf<std::uint16_t>(digits);
      case StoredType::kInt16:
        return takeNumberOf<std::int16_t>(digits);
      case StoredType::kUint32:
        return takeNumberOf<std::uint32_t>(digits);
      case StoredType::kInt32:
        return takeNumberOf<std::int32_t>(digits);
      case StoredType::kUint64:
        return takeNumberOf<std::uint64_t>(digits);
      case StoredType::kInt64:
        return takeNumberOf<std::int64_t>(digits);
      case StoredType::kFloat32:
        return takeNumberOf<float>(digits);
      case StoredType::kFloat64:
        return takeNumberOf<double>(digits);
      default:
        return false;  // no text format has it
    }
  }

  CharacterReader reader_;
  StoredType type_;
  std::array<std::byte, 8> number_ = {};
  std::size_t left_ = 0;  // bytes of number_ that were not read
};

// Two digits a byte; other characters mean nothing.
class HexStream final : public ByteStream {
 public:
  HexStream(std::shared_ptr<const InputFile> file, std::uint64_t offset)
      : reader_(std::move(file), offset) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* const to = static_cast<std::byte*>(out);
    for (std::size_t got = 0; got < bytes; ++got) {
      const int high = nextDigit(), low = high < 0 ? -1 : nextDigit();
      if (low < 0) return got;
      to[got] = static_cast<std::byte>(high << 4 | low);
    }
    return bytes;
  }
  std::uint64_t bufferBytes() const override { return sizeof *this; }

 private:
  int nextDigit() {
    for (int c = reader_.next(); c >= 0; c = reader_.next()) {
      if (c >= '0' && c <= '9') return c - '0';
      if (c >= 'a' && c <= 'f') return c - 'a' + 10;
      if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    }
    return -1;
  }

  CharacterReader reader_;
};

// Half a byte a number, the lower half first; each row begins with a byte of its own.
class NibbleStream final : public ByteStream {
 public:
  NibbleStream(std::shared_ptr<const InputFile> file, std::uint64_t offset, std::uint64_t row)
      : reader_(std::move(file), offset), row_(row) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* const to = static_cast<std::uint8_t*>(out);
    for (std::size_t got = 0; got < bytes; ++got, ++at_) {
      const std::uint64_t x = at_ % row_;
      if (x % 2 == 0) pair_ = reader_.next();
      if (pair_ < 0) return got;
      to[got] = static_cast<std::uint8_t>(x % 2 == 0 ? pair_ & 15 : pair_ >> 4);
    }
    return bytes;
  }

 private:
  CharacterReader reader_;
  std::uint64_t row_;
  std::uint64_t at_ = 0;  // of the next number
  int pair_ = 0;
};

// The content of one file, with nothing skipped but lines.
std::unique_ptr<ByteStream> contentStream(const NumberFiles& files,
                                          std::shared_ptr<const InputFile> file,
                                          std::uint64_t offset, StoredType type) {
  const std::string path = file->path();
  switch (files.form) {
    case Form::kGzip:
      return makeInflateStream(path, makeFileStream(std::move(file), offset));
    case Form::kBzip2:
      return makeBunzipStream(path, makeFileStream(std::move(file), offset));
    case Form::kText:
      return std::make_unique<TextNumberStream>(std::move(file), offset, type);
    case Form::kHex:
      return std::make_unique<HexStream>(std::move(file), offset);
    case Form::kBytes:
    case Form::kNibbles:
      break;
  }
  return makeFileStream(std::move(file), offset);
}

// A share of each file, one behind the other; one file is open at a time.
class NumberStream final : public ByteStream {
 public:
  NumberStream(NumberFiles files, StoredType type, std::uint64_t bytes)
      : files_(std::move(files)), type_(type), share_bytes_(bytes / files_.paths.size()) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* to = static_cast<std::byte*>(out);
    std::size_t got = 0;
    while (got < bytes && (left_ > 0 || openNext())) {
      const auto part = static_cast<std::size_t>(std::min<std::uint64_t>(left_, bytes - got));
      const std::size_t read = content_->read(to + got, part);
      got += read;
      left_ -= read;
      if (read == part) continue;
      if (files_.paths.size() == 1) break;  // the source has a message of its own
      throw tooShort(share_bytes_ - left_);
    }
    return got;
  }

  void finish() override {
    if (content_ != nullptr) content_->finish();
  }
  std::uint64_t bufferBytes() const override {
    constexpr std::uint64_t kInflateBytes = 320 << 10;
    constexpr std::uint64_t kBunzipBytes = 4 << 20;
    if (files_.form == Form::kBzip2) return kBunzipBytes;
    return files_.form == Form::kGzip ? kInflateBytes : sizeof(TextNumberStream);
  }

 private:
  Error tooShort(std::uint64_t have) const {
    return unreadable(files_.paths[next_ - 1],
                      "it has " + std::to_string(have) + " bytes of numbers, and the header '" +
                          files_.header_path + "' needs " + std::to_string(share_bytes_) +
                          "; get the whole file again");
  }

  bool openNext() {
    if (next_ == files_.paths.size()) return false;
    const std::string& path = files_.paths[next_++];
    const auto file = openNumbers(files_, path);
    const std::uint64_t offset = behindLines(file, files_);
    std::uint64_t skipped =
        static_cast<std::uint64_t>(std::max<std::int64_t>(files_.skipped_bytes, 0));
    if (files_.skipped_bytes == NumberFiles::kAllBefore) {
      const std::uint64_t have =
          files_.form == Form::kBytes
              ? file->size() - offset
              : skipBytes(*contentStream(files_, file, offset, type_), UINT64_MAX);
      if (have < share_bytes_) throw tooShort(have);
      skipped = have - share_bytes_;
    }
    if (files_.form == Form::kBytes || files_.form == Form::kNibbles) {
      if (files_.form == Form::kBytes)
        content_ = makeFileStream(file, offset + skipped);
      else
        content_ = std::make_unique<NibbleStream>(file, offset + skipped, files_.row_numbers);
    } else {
      content_ = contentStream(files_, file, offset, type_);
      skipBytes(*content_, skipped);
    }
    left_ = share_bytes_;
    return true;
  }

  NumberFiles files_;
  StoredType type_;
  std::uint64_t share_bytes_;
  std::size_t next_ = 0;  // of files_.paths
  std::unique_ptr<ByteStream> content_;
  std::uint64_t left_ = 0;  // bytes of the share
};

}  // namespace

std::vector<std::string> NumberFiles::all() const {
  std::vector<std::string> files;
  if (paths.front() != header_path) files.push_back(header_path);
  files.insert(files.end(), paths.begin(), paths.end());
  return files;
}

std::optional<std::uint64_t> NumberFiles::offsetOfBytes(std::uint64_t bytes) const {
  if (form != Form::kBytes || paths.size() != 1) return std::nullopt;
  const auto file = openNumbers(*this, paths.front());
  const std::uint64_t lines = behindLines(file, *this);
  const std::uint64_t have = file->size();
  const auto skipped = static_cast<std::uint64_t>(std::max<std::int64_t>(skipped_bytes, 0));
  if (have < lines || have - lines < skipped || have - lines - skipped < bytes)
    throw unreadable(paths.front(),
                     "it has " + std::to_string(have) + " bytes, and its header" +
                         (paths.front() == header_path ? "" : " '" + header_path + "'") +
                         " needs " + std::to_string(bytes) + " behind byte " +
                         std::to_string(lines + skipped) + "; get the whole file again");
  return skipped_bytes == kAllBefore ? have - bytes : lines + skipped;
}

std::unique_ptr<ByteStream> makeNumberStream(const NumberFiles& files, StoredType type,
                                             std::uint64_t bytes) {
  // Whatever is missing is missed before the first number is read.
  for (const std::string& path : files.paths) {
    const auto file = openNumbers(files, path);
    const std::uint64_t needed = files.first_byte + bytes / files.paths.size();
    if (files.form == Form::kBytes && file->size() < needed)
      throw unreadable(path, "it has " + std::to_string(file->size()) + " bytes, and the header '" +
                                 files.header_path + "' needs " + std::to_string(needed) +
                                 "; get the whole file again");
  }
  return std::make_unique<NumberStream>(files, type, bytes);
}

}  // namespace isobrick
