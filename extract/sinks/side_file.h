// Bytes that wait until those before them are written.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// A temporary file in the mesh's folder, which loses its name at once and vanishes with the
// process: faces wait in it for the last vertex. Throws Error, with the path, if it cannot be made,
// written or read.
class SideFile {
 public:
  // Its name, as long as it has one: "<mesh_path>.<what>." and six letters.
  SideFile(const std::string& mesh_path, const std::string& what);
  ~SideFile();
  SideFile(const SideFile&) = delete;
  SideFile& operator=(const SideFile&) = delete;

  // From any thread, as read().
  void pwrite(const void* data, std::size_t bytes, std::uint64_t offset);
  // Bytes that were written; fewer would be an Error.
  void read(void* out, std::size_t bytes, std::uint64_t offset) const;
  // The first `bytes` bytes; stops with Cancelled.
  void appendTo(AtomicFile& file, std::uint64_t bytes, const CancelFlag* cancel) const;

 private:
  [[noreturn]] void fail(const std::string& why) const;

  std::string path_;
  int fd_ = -1;
};

}  // namespace isobrick
