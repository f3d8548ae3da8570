// Queries, meshes and sessions in Python.
#pragma once

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>

#include <functional>

#include "interruptible_call.h"

namespace isobrick::python {

// Fills a mesh of level 0 of the volume `info`, as a `_QuerySettings` of Python says, by `extract`,
// on a thread of its own. Returns a MeshHandle.
using MeshExtraction =
    std::function<ExtractionReport(const Query& query, SurfaceMesh& mesh, CallState& state)>;
nanobind::object isosurfaceOf(const VolumeInfo& info, const nanobind::object& settings,
                              const MeshExtraction& extract);

// Adds classes Session and MeshHandle to the module.
void bindQueries(nanobind::module_& module);

}  // namespace isobrick::python
