#include "isobrick/preprocess/sources/tiff_directory.h"

#include <array>
#include <bit>
#include <string_view>
#include <unordered_set>

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

// The types of values, by their numbers in the file.
enum TiffType : std::uint64_t {
  kByte = 1,
  kText = 2,
  kShort = 3,
  kLong = 4,
  kRational = 5,
  kSignedByte = 6,
  kUndefined = 7,
  kSignedShort = 8,
  kSignedLong = 9,
  kSignedRational = 10,
  kFloat = 11,
  kDouble = 12,
  kOffset = 13,
  kLong8 = 16,
  kSignedLong8 = 17,
  kOffset8 = 18
};

std::uint64_t bytesOfType(std::uint64_t type) {
  switch (type) {
    case kShort:
    case kSignedShort:
      return 2;
    case kLong:
    case kSignedLong:
    case kFloat:
    case kOffset:
      return 4;
    case kRational:
    case kSignedRational:
    case kDouble:
    case kLong8:
    case kSignedLong8:
    case kOffset8:
      return 8;
    default:
      return 1;
  }
}

bool isWholeNumber(std::uint64_t type) {
  return type == kByte || type == kShort || type == kLong || type == kLong8;
}

}  // namespace

TiffDirectory::TiffDirectory(const std::string& path) : file_(path) {
  using namespace std::string_view_literals;
  const std::string begin = text(0, 4);
  if (begin != "II*\0"sv && begin != "MM\0*"sv && begin != "II+\0"sv && begin != "MM\0+"sv)
    throw unreadable(path, "it does not begin as a TIFF; check the path");
  big_endian_ = begin.starts_with("MM");
  is_big_tiff_ = begin.find('+') != std::string::npos;
}

std::uint64_t TiffDirectory::firstPage() const { return number(wordBytes(), wordBytes()); }

std::vector<std::uint64_t> TiffDirectory::pages() const {
  constexpr std::size_t kMostPages = std::size_t{1} << 20;
  std::vector<std::uint64_t> pages;
  std::unordered_set<std::uint64_t> seen;
  for (std::uint64_t page = firstPage(); page != 0; page = pageAfter(page)) {
    if (pages.size() == kMostPages || !seen.insert(page).second) throw cutShort();
    pages.push_back(page);
  }
  return pages;
}

std::uint64_t TiffDirectory::pageAfter(std::uint64_t page) const {
  return number(page + countBytes() + entryCount(page) * entryBytes(), wordBytes());
}

std::uint64_t TiffDirectory::entryCount(std::uint64_t page) const {
  const std::uint64_t count = number(page, countBytes());
  if (count > file_.size() / entryBytes()) throw cutShort();
  return count;
}

std::vector<TiffEntry> TiffDirectory::entries(std::uint64_t page) const {
  const std::uint64_t count = entryCount(page);
  const std::string bytes = text(page + countBytes(), count * entryBytes());
  std::vector<TiffEntry> entries;
  for (std::uint64_t i = 0; i < count; ++i) {
    const char* const at = bytes.data() + i * entryBytes();
    TiffEntry entry{loadUnsigned(at, 2, big_endian_), loadUnsigned(at + 2, 2, big_endian_),
                    loadUnsigned(at + 4, wordBytes(), big_endian_),
                    page + countBytes() + i * entryBytes() + 4 + wordBytes()};
    // Values that do not fit into the entry lie elsewhere.
    if (entry.count > wordBytes() / bytesOfType(entry.type))
      entry.value_at = loadUnsigned(at + 4 + wordBytes(), wordBytes(), big_endian_);
    entries.push_back(entry);
  }
  return entries;
}

std::optional<std::uint64_t> TiffDirectory::wholeNumber(const TiffEntry& entry,
                                                        std::uint64_t i) const {
  if (i >= entry.count || !isWholeNumber(entry.type)) return std::nullopt;
  const std::uint64_t bytes = bytesOfType(entry.type);
  if (i > file_.size() / bytes) throw cutShort();
  return number(entry.value_at + i * bytes, bytes);
}

std::vector<std::uint64_t> TiffDirectory::wholeNumbers(const TiffEntry& entry) const {
  if (!isWholeNumber(entry.type)) return {};
  const std::uint64_t bytes = bytesOfType(entry.type);
  if (entry.count > file_.size() / bytes) throw cutShort();
  const std::string stored = text(entry.value_at, entry.count * bytes);
  std::vector<std::uint64_t> numbers(static_cast<std::size_t>(entry.count));
  for (std::size_t i = 0; i < numbers.size(); ++i)
    numbers[i] = loadUnsigned(stored.data() + i * bytes, bytes, big_endian_);
  return numbers;
}

double TiffDirectory::realNumber(const TiffEntry& entry) const {
  const std::uint64_t at = entry.value_at;
  switch (entry.type) {
    case kFloat:
      return static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(number(at, 4))));
    case kDouble:
      return std::bit_cast<double>(number(at, 8));
    case kRational: {
      const auto over = static_cast<double>(number(at + 4, 4));
      return over == 0 ? 0 : static_cast<double>(number(at, 4)) / over;
    }
    default:
      return 0;
  }
}

std::uint64_t TiffDirectory::number(std::uint64_t offset, std::uint64_t bytes) const {
  std::array<unsigned char, 8> stored = {};
  if (offset > file_.size() || file_.readAt(offset, stored.data(), bytes) != bytes)
    throw cutShort();
  return loadUnsigned(stored.data(), bytes, big_endian_);
}

std::string TiffDirectory::text(std::uint64_t offset, std::uint64_t count) const {
  if (offset > file_.size() || count > file_.size() - offset) throw cutShort();
  std::string bytes(static_cast<std::size_t>(count), '\0');
  if (file_.readAt(offset, bytes.data(), bytes.size()) != count) throw cutShort();
  return bytes;
}

Error TiffDirectory::cutShort() const {
  return unreadable(
      file_.path(),
      "its list of pages leads out of the file, or has no end; get the whole file again");
}

}  // namespace isobrick
