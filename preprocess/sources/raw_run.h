// Runs of voxels behind a header: the bytes of the voxels in one piece of one file, as they are or
// packed as a whole with gzip or zlib. ITK reads most such files only as a whole and takes some
// that were cut short for whole ones; with this they are streamed and their sizes are checked.
// Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
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
  bool big_endian = false;
};

// The result of VolumeSource::files() for a run. `header_path` may be empty, or that of the data.
std::vector<std::string> headerAndData(const std::string& header_path,
                                       const std::string& data_path);

// Nothing if the header is not that of a volume in one run: other encodings, several data files,
// skipped lines, or anything unusual. Never throws. `components` and `voxels` are those that ITK
// read from the header: if voxels have several values, these lie together.
std::optional<RawRun> findNrrdRun(const std::string& header_path, std::uint64_t components,
                                  const Index3& voxels);
std::optional<RawRun> findMetaImageRun(const std::string& header_path);

// The voxels of `info`, which the source returns as it is; `stored.delivered()` is its type. Throws
// Error, naming the header's file, if the data end early: at once, or for deflated ones when the
// reading gets there. Bytes after them are ignored, unless the user described the file.
//
// `cancel`, which may be null and outlives the source, is checked while data are inflated: there
// may be gigabytes between two rows that are read.
std::unique_ptr<VolumeSource> openRawRun(VolumeInfo info, const RawRun& run,
                                         const StoredVoxels& stored, const CancelFlag* cancel);

// The same out of any stream, in which the first voxel is at `content_offset_bytes`. `path` is the
// file's for messages, `header_path` that of the file that states the number of voxels.
std::unique_ptr<VolumeSource> openStream(VolumeInfo info, const StoredVoxels& stored,
                                         std::unique_ptr<ByteStream> stream,
                                         std::uint64_t content_offset_bytes,
                                         const std::string& path, const std::string& header_path,
                                         const CancelFlag* cancel);

}  // namespace isobrick
