#include "isobrick/preprocess/sources/text_numbers.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"

namespace isobrick {
namespace {

constexpr std::size_t kMostWordBytes = 400;  // a double in full has some more than 300 digits

class TextNumbers final : public ByteStream {
 public:
  TextNumbers(std::shared_ptr<const InputFile> file, std::uint64_t offset, StoredType type,
              std::uint64_t count)
      : file_(std::move(file)), at_(offset), type_(type), left_(count) {}

  std::size_t read(void* out, std::size_t bytes) override {
    std::size_t got = 0;
    while (got < bytes && (next_ < numbers_.size() || refill())) {
      const std::size_t part = std::min(bytes - got, numbers_.size() - next_);
      std::memcpy(static_cast<std::byte*>(out) + got, numbers_.data() + next_, part);
      next_ += part;
      got += part;
    }
    return got;
  }

  std::uint64_t bufferBytes() const override { return 5 * kTextBytes; }

 private:
  static constexpr std::size_t kTextBytes = std::size_t{32} << 10;
  static constexpr std::string_view kBlanks = " \t\r\n";

  // Reads the words of the next piece of text; false if there is none.
  bool refill() {
    numbers_.clear();
    next_ = 0;
    std::string text;
    while (numbers_.empty() && !ended_ && left_ > 0) {
      text.resize(kTextBytes);
      text.resize(file_->readAt(at_, text.data(), text.size()));
      const std::size_t end = text.find('<');
      ended_ = end != std::string::npos || text.size() < kTextBytes;
      const std::size_t taken = takeWords(std::string_view(text).substr(0, end));
      if (taken == 0 && !ended_) throw noNumber(text, 0);
      at_ += taken;
    }
    return !numbers_.empty();
  }

  // All but the last one, which may go on in the text behind. Returns where that begins.
  std::size_t takeWords(std::string_view text) {
    std::size_t at = 0;
    for (;;) {
      const std::size_t begin = std::min(text.find_first_not_of(kBlanks, at), text.size());
      const std::size_t end = text.find_first_of(kBlanks, begin);
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
        if (word.size() <= kMostWordBytes) number = numberIn<T>(word);
      if (!number) throw noNumber(word, begin);
      const std::size_t size = numbers_.size();
      numbers_.resize(size + sizeof(T));
      std::memcpy(numbers_.data() + size, &*number, sizeof(T));
      --left_;
    });
  }

  Error noNumber(std::string_view word, std::size_t offset) const {
    return unreadable(file_->path(), "its word " + quotedText(std::string(word), 40) + " at byte " +
                                         std::to_string(at_ + offset) +
                                         " is no number of its type; correct it");
  }

  std::shared_ptr<const InputFile> file_;
  std::uint64_t at_;  // of the text that is read next
  StoredType type_;
  std::uint64_t left_;  // numbers that were not read yet
  std::vector<std::byte> numbers_;
  std::size_t next_ = 0;  // in numbers_
  bool ended_ = false;
};

}  // namespace

std::unique_ptr<ByteStream> makeTextNumbers(std::shared_ptr<const InputFile> file,
                                            std::uint64_t offset, StoredType type,
                                            std::uint64_t count) {
  return std::make_unique<TextNumbers>(std::move(file), offset, type, count);
}

}  // namespace isobrick
