// The connected components of a surface, for people and for programs.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/extract/sinks/surface_components.h"
#include "tools/json_output.h"

namespace isobrick {

// All of them, the largest area first.
Json jsonOfComponents(const SurfaceComponents& components);

// The ones of the largest area on stdout, numbered from 0 on, how many more there are, and how many
// are kept, with the measure by which they were chosen; empty: none.
void printComponents(const SurfaceComponents& components, const std::vector<std::uint8_t>& is_kept,
                     const std::string& ranked_by);

}  // namespace isobrick
