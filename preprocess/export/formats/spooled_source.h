// A source that is read in order, made one of boxes. Private to preprocess/export/formats/.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Reads all of `source` into a temporary file in `folder`, which is as long as the volume and is
// removed with the result. Throws ResumableError if there is no room for it, Cancelled, and what
// the source throws.
std::unique_ptr<VolumeSource> makeSpooledSource(std::unique_ptr<VolumeSource> source,
                                                const std::string& folder,
                                                const VolumeWriteOptions& options);

}  // namespace isobrick
