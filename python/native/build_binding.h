// Building pyramids from Python.
#pragma once

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>

#include <cstddef>
#include <optional>
#include <string>

#include "interruptible_call.h"

namespace isobrick::python {

// The arguments of `build` in both modules, as Python hands them over.
struct BuildRequest {
  std::string out;
  bool force = false;
  bool index = false;  // leaves level 0 in the source
  BuildOptions options;
  std::optional<std::size_t> super_brick;  // of a divided pyramid, whose folder `out` is
  CallOptions call;
};

// A `_BuildSettings` of Python (isobrick/_build.py).
BuildRequest readBuildRequest(const nanobind::object& settings);

// `label` and `denoise` of a `_FileInput` or `_ArrayDescription` of Python (isobrick/_build.py).
Derivation readDerivation(const nanobind::object& from);

// Throws Error if something has the name of the output, unless by `force`.
void refuseReplacing(const std::string& out, bool force);

// The files of super-bricks, a tuple each: name, first voxel and voxels, (x, y, z).
nanobind::list superBricks(const VolumeInfo& info, const BuildRequest& request);

// Adds join() to the module.
void bindJoin(nanobind::module_& module);

// Builds and returns a dict of what was done. `source` is read by the call's threads.
nanobind::object buildFrom(const std::function<std::unique_ptr<VolumeSource>(CallState&)>& open,
                           const BuildRequest& request);

}  // namespace isobrick::python
