// Arrays of a file with more axes than a volume has: the files that hold their numbers, which axes
// are the volume's, and the choice of one time step, component or image. Private to
// preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

struct NumberFiles {
  enum class Form { kBytes, kGzip, kBzip2, kText, kHex, kNibbles };

  std::string header_path;
  std::vector<std::string> paths;  // in the order of their numbers; at least one
  Form form = Form::kBytes;        // kGzip: gzip or zlib; kNibbles: 4 bits a number
  std::uint64_t row_numbers = 0;   // of kNibbles: each row begins with a new byte
  std::uint64_t first_byte = 0;    // behind a header in the same file, or one of their own
  // In front of the numbers of each file: lines, then bytes. Bytes are skipped in the content if it
  // is packed. kAllBefore: all that are in front of as many bytes as the numbers take.
  std::uint64_t skipped_lines = 0;
  std::int64_t skipped_bytes = 0;
  static constexpr std::int64_t kAllBefore = -1;

  // The header, if it is a file of its own, and the others.
  std::vector<std::string> all() const;
  // Where the numbers begin in the only file, if they are bytes in one file. Throws Error if it
  // has not `bytes` of them.
  std::optional<std::uint64_t> offsetOfBytes(std::uint64_t bytes) const;
};

struct StoredAxis {
  // kValues: of voxels with several; the file does not say whether they are components, channels or
  // time steps if it is kUnnamed.
  enum class Use { kSpace, kValues, kUnnamed, kTime, kImages };
  std::int64_t size = 1;
  Use use = Use::kSpace;
};

struct StoredArray {
  std::vector<StoredAxis> axes;  // fastest first; three of space at most, which are x, y, z
  StoredVoxels stored;           // of one number
  NumberFiles files;
};

// The voxels along the axes of space. Throws Error for volumes that are too small or too large.
Index3 volumeVoxels(const std::string& path, const std::vector<StoredAxis>& axes);

// The volume that the options choose. `info` has source, format, voxels and geometry; its type,
// encoding and notes of the choice are added. Of time steps the first is taken without a choice,
// with a note. Throws Error if another choice is missing, with what there is; if one is given that
// the array has no axis for; and if the files are too short.
std::unique_ptr<VolumeSource> openStoredArray(VolumeInfo info, const StoredArray& array,
                                              const OpenOptions& options);

}  // namespace isobrick
