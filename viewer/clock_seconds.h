// The clock of the viewer.
#pragma once

#include <chrono>

namespace isobrick {

// Seconds of a clock that never goes back.
inline double clockSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace isobrick
