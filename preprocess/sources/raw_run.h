// Voxels that lie in a file as they are, or come out of a stream row by row. Private to
// preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// A block of `voxels`, x fastest, whose first one is at byte `at` of `file`. Messages count its
// slices from `first_slice`.
struct StoredBlock {
  const InputFile& file;
  std::uint64_t at = 0;
  StoredVoxels stored;
  Index3 voxels{0};
  std::int64_t first_slice = 0;

  // Delivers the voxels of `box` to `out`. Throws Error that names the slice if the file ends.
  void read(const IndexBox& box, void* out) const;
};

// The file ended at byte `at`, and was longer when it was opened.
Error becameShorter(const InputFile& file, std::int64_t slice, std::uint64_t at);

struct RawRun {
  std::string path;         // of the header's own file, or of the file that it names
  std::string header_path;  // empty if the user described the file
  std::uint64_t offset_bytes = 0;
};

// The voxels of `info`, which the source returns as it is; `stored.delivered()` is its type. Throws
// Error, naming the header's file, if the data end early. Bytes after them are ignored, unless the
// user described the file.
std::unique_ptr<VolumeSource> openRawRun(VolumeInfo info, const RawRun& run,
                                         const StoredVoxels& stored);

// Bytes of a stream from a row to the next, and from a slice to the next; 0 if they adjoin.
struct RowStrides {
  std::uint64_t row_bytes = 0, slice_bytes = 0;
};

// The same out of any stream, in which the first voxel is at `content_offset_bytes`. `files` are
// those of the source: the first states the number of voxels, the last is named if it is too short.
// `cancel`, which may be null and outlives the source, is checked after each MiB: there may be
// gigabytes between two rows that are read.
std::unique_ptr<VolumeSource> openStream(VolumeInfo info, const StoredVoxels& stored,
                                         std::unique_ptr<ByteStream> stream,
                                         std::uint64_t content_offset_bytes,
                                         std::vector<std::string> files, const RowStrides& strides,
                                         const CancelFlag* cancel);

}  // namespace isobrick
