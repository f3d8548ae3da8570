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

struct SlicePictureOrder {
  IndexPlane plane;
  int most_pixels = 512;  // to the longer side
  std::array<double, 2> window{0.0, 1.0};
  std::vector<SliceContour> contours;
  std::optional<double> least;  // pixels below it, or without a value, are transparent
};
// Throws Error for words that are no slice of the volume.
SlicePictureOrder slicePictureOrder(const Asked& words, const Pyramid& pyramid);
// PNG. Throws Error, and Cancelled.
std::string slicePicture(const Pyramid& pyramid, const SlicePictureOrder& order,
                         const CancelFlag& cancel);

}  // namespace isobrick
