// Runs of voxels behind a header: the bytes of the voxels in one piece of one file, as they are or
// packed as a whole with gzip or zlib. ITK reads most such files only as a whole and takes some
// that were cut short for whole ones; with this they are streamed and their sizes are checked.
// Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

struct RawRun {
  std::string path;         // of the header's own file, or of the file that it names
  std::string header_path;  // empty if the user described the file
  std::uint64_t offset_bytes = 0;
  bool is_deflated = false;
  // The first voxel's byte in the inflated content; 0 for runs that are not deflated.
  std::uint64_t content_offset_bytes = 0;
};

// The result of VolumeSource::files() for a run. `header_path` may be empty, or that of the data.
std::vector<std::string> headerAndData(const std::string& header_path,
                                       const std::string& data_path);

// The voxels of `info`, which the source returns as it is; `stored.delivered()` is its type. Throws
// Error, naming the header's file, if the data end early: at once, or for deflated ones when the
// reading gets there. Bytes after them are ignored, unless the user described the file.
//
// `cancel`, which may be null and outlives the source, is checked while data are inflated: there
// may be gigabytes between two rows that are read.
std::unique_ptr<VolumeSource> openRawRun(VolumeInfo info, const RawRun& run,
                                         const StoredVoxels& stored, const CancelFlag* cancel);

// Bytes of a stream from a row to the next, and from a slice to the next; 0 if they adjoin.
struct RowStrides {
  std::uint64_t row_bytes = 0, slice_bytes = 0;
};

// The same out of any stream, in which the first voxel is at `content_offset_bytes`. `files` are
// those of the source: the first states the number of voxels, the last is named if it is too short.
std::unique_ptr<VolumeSource> openStream(VolumeInfo info, const StoredVoxels& stored,
                                         std::unique_ptr<ByteStream> stream,
                                         std::uint64_t content_offset_bytes,
                                         std::vector<std::string> files, const RowStrides& strides,
                                         const CancelFlag* cancel);

}  // namespace isobrick
