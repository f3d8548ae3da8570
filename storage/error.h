// Errors that a user can act on.
#pragma once

#include <stdexcept>
#include <string>

namespace isobrick {

// A failed run. `what()` is one line that says what went wrong, where (path, offset, brick, voxel)
// and what to do. Programming mistakes are asserted, never reported through this class.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// The user (or the caller, through a CancelFlag) asked the run to stop; nothing is left behind.
class Cancelled : public Error {
 public:
  Cancelled() : Error("interrupted; nothing was left behind") {}
};

}  // namespace isobrick
