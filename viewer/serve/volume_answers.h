// What is computed for one request: the surface as a file, and slices as pictures.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/error.h"
#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick {

// A surface that is asked for, checked.
struct SurfaceFileOrder {
  Query query;
  MeshFileOptions options;
};
// Throws Error for words that are no query. `extension`: ".glb", ".ply" or ".stl".
SurfaceFileOrder surfaceFileOrder(const Asked& words, const std::string& extension);
// Extracts it into `path`, in the calling TBB arena. Throws Error, and Cancelled.
void writeSurfaceFile(const Pyramid& pyramid, SurfaceFileOrder order, const std::string& path,
                      const CancelFlag& cancel);

// The same surface and format of the same file have the same one.
std::string surfaceTag(const OpenedVolume& volume, const Asked& words,
                       const std::string& extension);

// A slice that is asked for, checked as far as that goes without the volume.
struct SlicePictureOrder {
  std::optional<IndexPlane> plane;  // else that across `axis` at `position`, or in the middle
  int axis = 2;
  std::optional<double> position;
  int most_pixels = 512;                        // to the longer side
  std::optional<std::array<double, 2>> window;  // else all values
  std::vector<SliceContour> contours;
  std::optional<double> least;  // pixels below it, or without a value, are transparent
};
// Throws Error for words that are no slice.
SlicePictureOrder slicePictureOrder(const Asked& words);
// Throws Error if it does not lie in the volume.
IndexPlane planeOf(const SlicePictureOrder& order, const Pyramid& pyramid);
// PNG. Throws Error, and Cancelled.
std::string slicePicture(const Pyramid& pyramid, const SlicePictureOrder& order,
                         const CancelFlag& cancel);

}  // namespace isobrick
