// The place of the voxels of a NIfTI or Analyze file and how they are stored. ITK silently fills
// missing bytes of such a file with zeros; so it reads the geometry only. The NIfTI library itself
// neither gives the first byte of the voxels in a file that inflates nor streams them; so the few
// fields of the header that matter here are read by hand. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/stored_voxels.h"

namespace isobrick {

struct NiftiRun {
  RawRun run;
  StoredVoxels stored;  // of one number; slope and intercept included
  // Numbers of a voxel that lie together: of colours and complex numbers. Vectors are volumes of
  // their components, one behind the other.
  std::size_t numbers_together = 1;
  std::string length_unit;  // of spacing and origin, such as "micrometer"; "" if none is stated
};

// `path` is a file that ITK took for NIfTI: .nii, or .hdr or .img of a pair; gzipped or not. Throws
// Error if the header is damaged or unusual, or the other file of the pair is missing.
NiftiRun findNiftiRun(const std::string& path);

// Opens info.source, such a file, which ITK has described in `info`: the spacing in millimetres,
// and the origin too if `is_origin_scaled`. Its numbers are those of ITK, and the options choose
// among them. Throws Error that names the file if there is no such choice, and if the header
// contradicts itself.
std::unique_ptr<VolumeSource> openNiftiVolume(VolumeInfo info, bool is_origin_scaled,
                                              std::uint64_t components, std::uint64_t time_steps,
                                              const OpenOptions& options);

// If `path` ends in .nii or .nii.gz, throws Error for a header that the NIfTI library would refuse
// with a line of its own on the standard error.
void checkNiftiHeader(const std::string& path);

}  // namespace isobrick
