// VTK's ways to an isosurface of a whole volume.
#pragma once

#include <memory>
#include <string>

#include "tools/bench/surface_engine.h"

namespace isobrick {

// `name` is that of the class: vtkFlyingEdges3D, vtkSynchronizedTemplates3D or vtkMarchingCubes;
// nullptr for another. Normals are computed, gradients and scalars are not. Sets the number of
// threads of VTK as a whole.
std::unique_ptr<SurfaceEngine> makeVtkEngine(const std::string& name, const std::string& path,
                                             double isovalue, int threads);

}  // namespace isobrick
