// The connected components of a surface, for people and for programs.
#pragma once

#include <cstddef>

#include "isobrick/extract/sinks/surface_components.h"
#include "tools/json_output.h"

namespace isobrick {

// All of them, the largest area first.
Json jsonOfComponents(const SurfaceComponents& components);

// The largest ones on stdout, numbered from 0 on, how many more there are, and that the first
// `kept` are kept.
void printComponents(const SurfaceComponents& components, std::size_t kept);

}  // namespace isobrick
