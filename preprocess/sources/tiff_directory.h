// The tags of a TIFF file, page by page. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// A tag of a page: `count` values of one type.
struct TiffEntry {
  std::uint64_t tag = 0, type = 0, count = 0;
  std::uint64_t value_at = 0;  // byte of the first value in the file
};

// Classic TIFF and BigTIFF of either byte order. Everything that is read is checked against the
// file's size; all members throw Error that names the file if it ends too early.
class TiffDirectory {
 public:
  // Throws Error that names the file too if its first bytes are not those of a TIFF.
  explicit TiffDirectory(const std::string& path);

  const InputFile& file() const { return file_; }
  bool isBigEndian() const { return big_endian_; }

  // The offset of the first page; 0: there is none.
  std::uint64_t firstPage() const;
  // Those of all pages, in their order, at most 2^20. Throws Error if they lead in a circle.
  std::vector<std::uint64_t> pages() const;
  // Of the page.
  std::vector<TiffEntry> entries(std::uint64_t page) const;

  // The entry's value number `i`; none: there are fewer, or they are no whole numbers.
  std::optional<std::uint64_t> wholeNumber(const TiffEntry& entry, std::uint64_t i = 0) const;
  // All of them; empty: they are no whole numbers.
  std::vector<std::uint64_t> wholeNumbers(const TiffEntry& entry) const;
  // The entry's first value as a number; 0 if it is none.
  double realNumber(const TiffEntry& entry) const;
  // A number of `bytes` bytes, 1 to 8, in the file's byte order.
  std::uint64_t number(std::uint64_t offset, std::uint64_t bytes) const;
  // `count` bytes from `offset` on.
  std::string text(std::uint64_t offset, std::uint64_t count) const;

  // The error of a file that ends too early.
  Error cutShort() const;

 private:
  std::uint64_t pageAfter(std::uint64_t page) const;
  std::uint64_t entryCount(std::uint64_t page) const;
  std::uint64_t wordBytes() const { return is_big_tiff_ ? 8 : 4; }
  std::uint64_t countBytes() const { return is_big_tiff_ ? 8 : 2; }
  std::uint64_t entryBytes() const { return is_big_tiff_ ? 20 : 12; }

  InputFile file_;
  bool big_endian_ = false, is_big_tiff_ = false;
};

}  // namespace isobrick
