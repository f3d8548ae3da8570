// Errors that a user or the calling program can act on.
#pragma once

#include <atomic>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace isobrick {

// The place of a failure, as far as that is known.
struct ErrorPlace {
  std::string path = {};                                // of the file; empty: none
  std::optional<std::uint64_t> offset = {};             // byte in it
  std::optional<int> level = {};                        // of the pyramid
  std::optional<glm::vec<3, std::int64_t>> brick = {};  // of that level
};

// A parameter of the call that would help. The command adds the names of its options.
enum class Remedy {
  kAllowMoreMemory,     // BuildOptions::memory_bytes
  kUseLessMemory,       // the same, or fewer threads
  kOtherFolder,         // for the output
  kPack,                // BuildOptions::codec
  kReplaceNotFinite,    // BuildOptions::nan_as
  kResume,              // BuildOptions::resume
  kBeginAnew,           // without BuildOptions::resume
  kDescribeRawFile,     // OpenOptions::raw
  kCorrectRawLayout,    // the values of OpenOptions::raw
  kDicomAsFloat32,      // OpenOptions::dicom_float32
  kBuildWithCurvature,  // BuildOptions::with_curvature
  kChooseComponent,     // OpenOptions::component
  kWholeFloats,         // ExportOptions::vdb_half
  kPackMesh,            // MeshFileOptions::meshopt
  kChooseStack,         // OpenOptions::grid
  kChooseTime,          // OpenOptions::time
  kChooseVariant,       // OpenOptions::channel
  kChooseSeries,        // OpenOptions::series
  kChooseImage,         // OpenOptions::image
};

// A failed run. `what()` is one line that says what went wrong, at which place (path,
// offset, brick, voxel) and what to do; place() and remedies() say the same to a program.
// Programming mistakes are asserted, never reported through this class.
class Error : public std::runtime_error {
 public:
  // `what`: see what().
  explicit Error(const std::string& what, ErrorPlace place = {}, std::vector<Remedy> remedies = {})
      : std::runtime_error(what), place_(std::move(place)), remedies_(std::move(remedies)) {}

  // The place of the failure.
  const ErrorPlace& place() const { return place_; }
  // Parameters that may help; often none.
  const std::vector<Remedy>& remedies() const { return remedies_; }

 private:
  ErrorPlace place_;
  std::vector<Remedy> remedies_;
};

// A failure of the moment, not of the input: a full disk, a read that failed. The same run may
// succeed later, so the work so far is worth keeping.
class ResumableError : public Error {
 public:
  // Takes the arguments of Error.
  using Error::Error;
};

// The user (or the caller, through a CancelFlag) asked the run to stop.
class Cancelled : public Error {
 public:
  Cancelled() : Error("interrupted; nothing was left behind") {}
  // `what` names the files that were left behind.
  using Error::Error;
};

// A request to stop that long work checks. It is set by one thread (or a signal handler: the flag
// is lock-free), and checked by the workers between pieces of work of at most some milliseconds.
class CancelFlag {
 public:
  // Requests a stop, which cannot be taken back.
  void request() noexcept { requested_.store(true, std::memory_order_relaxed); }
  // Whether a stop was requested.
  bool requested() const noexcept { return requested_.load(std::memory_order_relaxed); }
  // Throws Cancelled once a stop was requested.
  void check() const {
    if (requested()) throw Cancelled();
  }

 private:
  std::atomic<bool> requested_{false};
};

}  // namespace isobrick
