// A file that appears under its name only when it is whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace isobrick {

// Writes to "<path>.partial" in the same folder; commit() makes the bytes durable and gives them
// their name, replacing an older file in one step. An AtomicFile that is destroyed without commit()
// removes its temporary, so a failed or cancelled run leaves nothing behind. A temporary that a
// killed process left is taken over; one that a living process writes is refused.
//
// Every failure (no space, no permission, missing folder, ...) throws Error with the path, the
// reason and what to do. Nothing is buffered: hand over blocks of some 64 KiB or more.
// pwrite() may be called from several threads at once; all other members from one at a time.
class AtomicFile {
 public:
  explicit AtomicFile(const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  // Open for reading and writing; owned by this object, and closed by commit().
  int fd() const { return fd_; }
  const std::string& path() const { return path_; }
  const std::string& temporaryPath() const { return temporary_path_; }

  // Appends after the bytes of all earlier write() calls.
  void write(const void* data, std::size_t bytes);
  // Writes at `offset`, which may be anywhere; does not move position().
  void pwrite(const void* data, std::size_t bytes, std::uint64_t offset);
  // Where the next write() goes: the number of bytes given to write() so far.
  std::uint64_t position() const { return position_; }

  // fsync, rename, fsync of the folder. Once, and nothing may be written afterwards.
  void commit();

 private:
  void closeAndRemove() noexcept;

  std::string path_;
  std::string temporary_path_;
  int fd_ = -1;
  std::uint64_t position_ = 0;
};

}  // namespace isobrick
