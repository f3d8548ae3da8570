// The voxels of an array in a VTK file. Private to preprocess/sources/.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/sources/vti_header.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// Whether blocks packed by the compressor of that name can be read, or it is "".
bool knowsVtiCompressor(const std::string& compressor);

// `info` is that of the source; its voxels are all that the array has, numbers of `stored`.
// `cancel`, which may be null, outlives the source. Throws Error if the array has another number of
// bytes.
std::unique_ptr<VolumeSource> openVtiVoxels(std::shared_ptr<const InputFile> file,
                                            const VtiHeader& header, const VtiArray& array,
                                            const StoredVoxels& stored, VolumeInfo info,
                                            const CancelFlag* cancel);

}  // namespace isobrick
