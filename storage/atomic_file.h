// A file that appears under its name only when it is complete.
#pragma once

#include <sys/uio.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {

// The ending of a file that is being written; no other program has files of such names. A pyramid,
// whose build can be resumed, has one of its own, "<path>.partial" (pyramid_writer.h).
inline constexpr char kTemporaryEnding[] = ".isobrick.partial";

// Throws the error of a failed write, with what to do: ResumableError if the failure can pass, else
// Error. `error` is the errno.
[[noreturn]] void failWriting(const std::string& path, int error,
                              std::optional<std::uint64_t> offset = {});

// The folder of the file: "." for a name alone.
std::string folderOf(const std::string& path);

// Waits until the names in that folder are on the disk. Returns the errno of a failure, 0 also if
// the folder may not be read or its file system cannot do that.
int syncFolderOf(const std::string& path);

// Writes to "<path>.isobrick.partial" in the same folder; commit() makes the bytes durable and
// gives them their name, replacing an older file in one step. An AtomicFile that is destroyed
// without commit() removes its temporary file, so a failed or cancelled run leaves nothing behind,
// unless keepTemporary(true) was called. A temporary file that a killed process left is taken over;
// one that a living process writes is refused, and so is another user's, a link and what is no
// file. A file that replaces another one has its permissions.
//
// Failures that can pass (no space, ...) throw ResumableError, others Error, with the path, the
// reason and what to do. Nothing is buffered: pass blocks of some 64 KiB or more. pwrite() may be
// called from several threads at once; all other members from one at a time.
class AtomicFile {
 public:
  // The fate of the bytes in a temporary file that a killed process left.
  enum class Leftover { kEmpty, kKeep };
  explicit AtomicFile(const std::string& path, Leftover leftover = Leftover::kEmpty,
                      const char* temporary_ending = kTemporaryEnding);
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
  // As write(), of several spans of memory one after the other; changes `spans`.
  void writeGathered(std::span<iovec> spans);
  // Where the next write() goes: the number of bytes given to write() so far.
  std::uint64_t position() const { return position_; }
  // Appends after `position` from now on; what lies behind it is overwritten or cut off.
  void continueFrom(std::uint64_t position) { position_ = position; }

  // Free bytes of the file system for this process, or nothing if it cannot tell.
  std::optional<std::uint64_t> freeBytes() const;
  // Makes sure that the file can grow to `bytes`: if the file system supports it, the space is
  // taken now. The file is that long until cutAfterPosition(). File systems in memory (tmpfs) are
  // left alone: there it would take the memory that the build saves.
  void reserve(std::uint64_t bytes, const CancelFlag* cancel = nullptr);
  void cutAfterPosition();

  // The destructor leaves the temporary file in place.
  void keepTemporary(bool keep) { keep_ = keep; }

  // Waits for the disk, gives the file its name, waits for the folder. Once, and nothing may be
  // written afterwards. Checks `cancel` while it waits for the disk: throws Cancelled, and the file
  // does not get its name.
  void commit(const CancelFlag* cancel = nullptr);

 private:
  void close() noexcept;
  void drain(const CancelFlag& cancel);
  void beginWriteback(std::uint64_t bytes);

  std::string path_;
  std::string temporary_path_;
  int fd_ = -1;
  std::uint64_t position_ = 0;
  std::atomic<std::uint64_t> written_ = 0;  // since the last writeback began, about
  bool keep_ = false;
};

}  // namespace isobrick
