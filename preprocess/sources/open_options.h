// What the functions that open volumes take beside the path.
#pragma once

#include <functional>
#include <string_view>

#include "storage/cancel.h"

namespace isobrick {

struct OpenOptions {
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
