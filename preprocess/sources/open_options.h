// What the functions that open volumes take beside the path.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "isobrick/storage/cancel.h"
#include "isobrick/storage/grid.h"

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

struct OpenOptions {
  // Given: the file has no header, whatever its name.
  std::optional<RawLayout> raw;
  // Looked at while the volume is opened, and by the source whenever it is read: it outlives the
  // source. Both throw Cancelled after a request.
  const CancelFlag* cancel = nullptr;
  // Called now and then on the caller's thread while the volume is opened, where that takes long:
  // what is being done, and how much of it is done, 0 .. 1. Not called once the volume is open.
  std::function<void(std::string_view phase, double fraction)> progress;
  // A DICOM series becomes float32, whatever its headers say: for one with values that do not fit
  // the type that they suggest (dicom_values.h).
  bool dicom_float32 = false;

  void checkCancel() const {
    if (cancel != nullptr) cancel->check();
  }
  void report(std::string_view phase, double fraction) const {
    if (progress) progress(phase, fraction);
  }
};

}  // namespace isobrick
