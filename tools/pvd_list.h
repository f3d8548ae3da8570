// ParaView's list of files that are the steps of one surface (.pvd).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tools/extract_report.h"

namespace isobrick {

inline constexpr std::string_view kPvdEnding = ".pvd";

// Each surface at its step, the surfaces of one step as its parts. Their files lie beside `path`,
// which is replaced as a whole. Throws Error.
void writePvd(const std::string& path, const std::vector<ExtractResult>& surfaces);

}  // namespace isobrick
