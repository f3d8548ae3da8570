// Building pyramids from Python.
#pragma once

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>

#include <string>

#include "interruptible_call.h"

namespace isobrick::python {

// What `build` of both modules takes, as Python hands it over.
struct BuildRequest {
  std::string out;
  bool force = false;
  BuildOptions options;
  CallOptions call;
};

// A `_BuildSettings` of Python (isobrick/_build.py).
BuildRequest readBuildRequest(const nanobind::object& settings);

// Builds and returns a dict of what was done. `source` is read by the call's threads.
nanobind::object buildFrom(const std::function<std::unique_ptr<VolumeSource>(CallState&)>& open,
                           const BuildRequest& request);

}  // namespace isobrick::python
