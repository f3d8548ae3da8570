// Voxels with several values: which become a volume. Private to preprocess/sources/.
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

// Throws Error unless there is a choice where voxels have several values and none where they have
// one, and the choice is one of them.
void checkComponentChoice(const std::string& path, std::uint64_t components,
                          const OpenOptions& options);

// For volumes that never have several.
void refuseComponentChoice(const std::string& path, const OpenOptions& options);

// Brings a checked choice into how voxels are decoded and what is said of them; `info` says
// otherwise all of voxels with one value.
void takeComponent(std::uint64_t components, const OpenOptions& options, StoredVoxels& stored,
                   VolumeInfo& info);

// The magnitude of voxels whose components are volumes of their own, one behind the other in a
// file: `info` as takeComponent() made it. They are read in order, a row of each at a time.
std::unique_ptr<VolumeSource> makeMagnitudeSource(
    VolumeInfo info, std::vector<std::unique_ptr<VolumeSource>> components);

}  // namespace isobrick
