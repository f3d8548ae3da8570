// An HDF5 file that gets a further dataset. Private to preprocess/export/formats/.
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/open_descriptor.h"

namespace isobrick {

// The file stays as it is: all writing goes into a copy, which takes its name in the end. Until
// then the file is locked for writers, as the HDF5 library does it, so that no data of another
// program are lost. Throws Error if it is being written, or cannot be read.
class Hdf5Original {
 public:
  // Nothing if there is no file of that name.
  static std::optional<Hdf5Original> open(const std::string& path);

  std::uint64_t bytes() const { return static_cast<std::uint64_t>(status_.st_size); }
  // All bytes, owner and mode, and progress(bytes so far). If the file system shares blocks, it
  // takes no space; otherwise throws ResumableError if there is too little.
  void copyTo(AtomicFile& copy, const CancelFlag* cancel,
              const std::function<void(std::uint64_t)>& progress) const;
  // Throws Error if a program that does not lock has written to it all the same.
  void refuseChanged() const;

 private:
  Hdf5Original(const std::string& path, int fd);
  void refuseTooLittleSpace(const AtomicFile& copy) const;

  std::string path_;
  OpenDescriptor file_;
  struct stat status_ = {};
};

}  // namespace isobrick
