// A whole file as text.
#pragma once

#include <string>

namespace isobrick {

// `what` it is, for the error: "view". Throws Error if it cannot be read.
std::string readTextFile(const std::string& path, const char* what);

}  // namespace isobrick
