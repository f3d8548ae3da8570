// Runs of raw voxels behind a header. ITK reads NRRD files only as a whole and takes a MetaImage
// that was cut short for a whole one; with this, uncompressed files of both formats are streamed
// and their sizes are checked. Private to preprocess/.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "preprocess/volume_source.h"

namespace isobrick {

struct RawRun {
  std::string path;  // of the header's own file, or of the file that it names
  std::uint64_t offset_bytes = 0;
  bool big_endian = false;
};

// Nothing where the header is not that of a volume in one run of raw bytes: compressed or text
// encodings, several data files, skipped lines, or anything unusual. Never throws.
std::optional<RawRun> findNrrdRun(const std::string& header_path);
std::optional<RawRun> findMetaImageRun(const std::string& header_path);

// Reads `voxels` of `type` (a name of RawLayout) from the run. Throws Error, naming the header's
// file, where the data end early; bytes after them are ignored, as both formats allow.
std::unique_ptr<VolumeSource> openRawRun(const std::string& header_path, const RawRun& run,
                                         const Index3& voxels, const std::string& type);

}  // namespace isobrick
