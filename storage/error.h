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

// A failure of the moment, not of the input: a full disk, a read that failed. The same run may
// succeed later, so what was done so far is worth keeping.
class ResumableError : public Error {
 public:
  using Error::Error;
};

// The user (or the caller, through a CancelFlag) asked the run to stop.
class Cancelled : public Error {
 public:
  Cancelled() : Error("interrupted; nothing was left behind") {}
  // `what` says what was left behind.
  explicit Cancelled(const std::string& what) : Error(what) {}
};

}  // namespace isobrick
