// Numbers that no pyramid holds as voxels: doubles, and integers of 32 and 64 bits.
#pragma once

#include <functional>
#include <memory>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// `numbers`, or, if no pyramid holds its numbers, a source that makes voxels of them as
// VolumeSource::chooseVoxels() says: integers whose range fits 16 bits stay integers, less an
// offset; others become float32 around an offset, so that their rounding is a part of their range
// and not of their magnitude. `open` gives the same source anew, to be read from its beginning.
std::unique_ptr<VolumeSource> withVoxels(std::unique_ptr<VolumeSource> numbers,
                                         std::function<std::unique_ptr<VolumeSource>()> open);

}  // namespace isobrick
