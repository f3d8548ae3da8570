// The header of a legacy VTK file (.vtk). Private to preprocess/sources/.
#pragma once

#include "isobrick/preprocess/sources/vti_header.h"

namespace isobrick {

// As of a VTI file with the same arrays of points and cells, in one piece; their format is "ascii",
// or "bare" for bytes in order of the network from VtiArray::text_at on. Bytes between headers are
// passed over. Throws Error, naming the byte, for anything but STRUCTURED_POINTS.
VtiHeader readVtkLegacyHeader(const InputFile& file);

}  // namespace isobrick
