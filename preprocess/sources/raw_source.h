// Voxels in a file without a header.
#pragma once

#include <memory>
#include <string>

#include "preprocess/volume_source.h"

namespace isobrick {

// How to read a file that has no header.
struct RawLayout {
  Index3 voxels{0};
  // "u8", "i8", "u16", "i16", "f32"; also "u32", "i32" and "f64", which become float32 with a note.
  std::string type;
  bool big_endian = false;
  glm::dvec3 spacing{1.0};
  std::uint64_t offset_bytes = 0;
};

// Opens a raw file. Throws Error where the file is shorter than offset + voxels, where it is longer
// (wrong dimensions are the usual reason; the message names both sizes), or where an axis has
// fewer than 2 voxels.
std::unique_ptr<VolumeSource> openRawSource(const std::string& path, const RawLayout& layout);

}  // namespace isobrick
