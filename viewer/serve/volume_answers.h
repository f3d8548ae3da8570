// What is computed for one request: the surface as a file, and slices as pictures. Words are
// checked before anything is opened, as far as that goes: Refusal for those that are none.
#pragma once

#include <functional>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

// Extracts it into `path`, in the calling TBB arena. Throws Error, and Cancelled.
using SurfaceFile = std::function<void(const Pyramid&, const std::string& path, const CancelFlag&)>;
// `extension`: ".glb", ".ply" or ".stl".
SurfaceFile surfaceFileOf(const Asked& words, const std::string& extension);
// The same surface and format of the same file have the same one.
std::string surfaceTag(const OpenedVolume& volume, const Asked& words,
                       const std::string& extension);

// Returns PNG. Throws Refusal if the slice does not lie in the volume, Error, and Cancelled.
using SlicePicture = std::function<std::string(const Pyramid&, const CancelFlag&)>;
SlicePicture slicePictureOf(const Asked& words);

}  // namespace isobrick
