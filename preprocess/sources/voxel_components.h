// Voxels with several values: the choice of one for the volume. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// Throws Error unless there is a choice of one of the values if voxels have several, and no choice
// if they have one.
void checkComponentChoice(const std::string& path, std::uint64_t components,
                          const OpenOptions& options);

// For volumes that never have several.
void refuseComponentChoice(const std::string& path, const OpenOptions& options);

// Applies a checked choice to the decoding in `stored` and to `info`, which otherwise describes
// voxels with one value.
void takeComponent(std::uint64_t components, const OpenOptions& options, StoredVoxels& stored,
                   VolumeInfo& info);

// The magnitude of voxels whose components are volumes of their own, one behind the other in a
// file: `info` as takeComponent() made it. They are read in order, a row of each at a time.
std::unique_ptr<VolumeSource> makeMagnitudeSource(
    VolumeInfo info, std::vector<std::unique_ptr<VolumeSource>> components);

}  // namespace isobrick
