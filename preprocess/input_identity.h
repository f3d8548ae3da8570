// Whether a volume is still the one that was read before.
#pragma once

#include <string>

#include "preprocess/volume_source.h"

namespace isobrick {

// One line that changes with the source's files: their number, bytes, times of last change, and
// blocks of their content, spread from the first to the last byte. Reads at most some 200 KiB of
// each file. Throws ResumableError where one cannot be read.
std::string inputIdentity(const VolumeSource& source);

}  // namespace isobrick
