// A folder that appears under its name only when all in it is complete.
#pragma once

#include <filesystem>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {

// Files are written into temporaryPath(), "<path>.isobrick.partial"; commit() makes them durable
// and gives the folder its name. An AtomicFolder that is destroyed without commit() removes it with
// all that is in it. A temporary folder that a killed process left is emptied; one that a living
// process writes is refused. Throws Error and ResumableError as AtomicFile does.
class AtomicFolder {
 public:
  explicit AtomicFolder(const std::string& path);
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;

  const std::string& temporaryPath() const { return temporary_path_.native(); }

  // Makes a folder in it, and those above.
  void makeFolder(const std::string& name);
  // A file in it that grows piece by piece; if that fails, the folder is of no use, as with
  // writeFile(). The folder outlives it; files of one folder may grow in several threads at once.
  class File {
   public:
    File(const AtomicFolder& folder, const std::string& name);
    void append(const void* data, std::size_t bytes);
    // Once, behind the last piece: a disk may refuse the bytes as late as this.
    void close();

   private:
    const AtomicFolder& folder_;
    OpenDescriptor file_;
  };
  // Writes a file in it. Thread-safe.
  void writeFile(const std::string& name, const void* data, std::size_t bytes);

  // Puts a file of another folder there too, by a second name if the file system has those, else a
  // copy. Makes the folders above it.
  void takeFile(const std::filesystem::path& from, const std::filesystem::path& name);

  // Waits for the disk and gives the folder its name. A file or folder of that name is replaced,
  // and removed with all that is in it: the caller has checked it.
  void commit(const CancelFlag* cancel = nullptr);

 private:
  AtomicFolder(const std::string& path, const std::string& temporary_path);

  std::string path_;
  std::filesystem::path temporary_path_;  // no text, so that to remove it takes no memory
  int fd_ = -1;                           // of the temporary folder, locked
};

}  // namespace isobrick
