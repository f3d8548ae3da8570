// Volumes of TIFF pictures: the pages of a file, or files that are a slice each. Private to
// preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// The pictures of some files.
struct TiffSlices {
  // The facts that all of them share.
  struct Form {
    std::uint64_t width = 0, height = 0;
    std::uint64_t samples = 1;  // numbers of a pixel
    StoredType type = StoredType::kUint8;
    bool is_half = false;      // floating numbers of 16 bits; `type` is kFloat32 then
    bool is_separate = false;  // one number of all pixels lies behind the other
    bool operator==(const Form&) const = default;
  };
  struct Slice {
    std::uint32_t file = 0;     // its place among the paths
    std::uint64_t page_at = 0;  // byte of the file
    bool big_endian = false;    // the file is
    std::optional<std::uint64_t>
        pixels_at;  // byte of the first pixel, if they lie there as they are
  };
  Form form;
  std::vector<Slice> slices;  // in the order of the paths, and of a file's pages

  // Whether all can be read box by box: neither packed nor in tiles, rows one behind the other.
  bool arePlain() const;
};

// Grey pictures, and those of several numbers, whole ones or floating ones of 8 to 64 bits, of one
// form. None: some have another form (palettes, fewer bits, other corners, ...) or a fault, which
// is left to another reader to name. Smaller pictures beside the pages are left out. Reads the tags
// of every page but no pixels, and tells options.progress. Throws Error if the list of pages has no
// end, and ResumableError if the disk fails.
std::optional<TiffSlices> findTiffSlices(const std::vector<std::string>& paths,
                                         const OpenOptions& options);

// Volume, type and notes of `info` are those of `slices`, of which `stored` says what is delivered.
// A packed picture is unpacked as a whole, by libtiff, and read in order. The file may be hostile:
// sizes are checked against those in `slices`. Reading throws Error that names file and slice.
std::unique_ptr<VolumeSource> openTiffSlices(VolumeInfo info, std::vector<std::string> paths,
                                             const TiffSlices& slices, const StoredVoxels& stored,
                                             const OpenOptions& options);

// A single file of several pages. Null: ITK has to read it.
std::unique_ptr<VolumeSource> openTiffFile(const std::string& path, const OpenOptions& options);
// Files of one slice each, in this order. Null: ITK has to read them. `info` has source and notes.
std::unique_ptr<VolumeSource> openTiffStack(VolumeInfo info, const std::vector<std::string>& paths,
                                            const OpenOptions& options);

}  // namespace isobrick
