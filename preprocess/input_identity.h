// Whether a volume is still the one that was read before.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/preprocess/finite_voxels.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// One line that changes with the source's files: their number, bytes, times of last change, and
// blocks of their content, spread from the first to the last byte; for a source without files, its
// identity(). Reads at most some 200 KiB of each file, and checks `cancel`, which may be null,
// before each. Throws Error if one cannot be opened, and ResumableError if it cannot be read or
// ends before its end.
std::string inputIdentity(const VolumeSource& source, const CancelFlag* cancel = nullptr);

// A source's input from the beginning of a build to its end. Used by one thread at a time.
class InputWatch {
 public:
  // Samples the input, as inputIdentity() does. `cancel`, which is checked then and by
  // checkContent(), outlives this object; the source need not.
  explicit InputWatch(const VolumeSource& source, const CancelFlag* cancel = nullptr);
  const std::string& identity() const { return identity_; }

  // Both throw ResumableError if the input has changed, or if that cannot be told because a file
  // cannot be read. The first compares only the files' times and sizes, and their content if these
  // have changed: all bytes that were read before it returns were of the old content.
  void check();
  void checkContent();

  // For one file: device, inode, bytes, and both times that a change of it changes. The second of
  // them cannot be set back. Zeros for one that cannot be reached.
  using Stamp = std::array<std::int64_t, 7>;
  static std::vector<Stamp> stampsOf(const std::vector<std::string>& files);

 private:
  const std::string name_;
  const CancelFlag* const cancel_;
  const std::vector<std::string> files_;
  std::vector<Stamp> stamps_;
  std::string identity_;
};

// The note about voxels without data.
std::string noteOfMissing(std::uint64_t voxels);

// JSON, valid UTF-8 whatever the names are. `identity` is that of the source and the options,
// `counts`: of voxels that were not finite.
std::string provenanceText(const VolumeSource& source, const BuildOptions& options,
                           const std::string& identity, const NotFiniteCounts& counts);

}  // namespace isobrick
