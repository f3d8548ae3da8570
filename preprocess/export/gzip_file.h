// A file packed with gzip as it is written. Private to preprocess/export/.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// Packs its input and appends it to `file`, which outlives it. Holds 256 KiB of packed bytes and
// zlib's window. One thread. Throws what AtomicFile::write() throws, and Cancelled.
class GzipFile {
 public:
  explicit GzipFile(AtomicFile& file);
  ~GzipFile();
  GzipFile(const GzipFile&) = delete;
  GzipFile& operator=(const GzipFile&) = delete;

  void write(std::span<const std::byte> bytes, const CancelFlag* cancel);
  // The end of the gzip member, with its checksum. Once, and last.
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace isobrick
