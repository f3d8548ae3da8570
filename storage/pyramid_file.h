// Whether a file is a pyramid, without opening it as one.
#pragma once

#include <string>

namespace isobrick {

// True for a regular file that begins with the magic of a pyramid. Never waits for the other end
// of a pipe.
bool beginsAsPyramid(const std::string& path);

// True for a regular file that begins as a pyramid, or is called one (.isb), and for a URL, behind
// which nothing else is read.
bool isPyramidFile(const std::string& path);

}  // namespace isobrick
