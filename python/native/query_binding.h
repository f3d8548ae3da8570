// Queries, meshes and sessions in Python.
#pragma once

#include <nanobind/nanobind.h>

namespace isobrick::python {

// Adds classes Session and MeshHandle to the module.
void bindQueries(nanobind::module_& module);

}  // namespace isobrick::python
