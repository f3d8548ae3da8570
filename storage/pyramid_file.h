// Whether a file is a pyramid, without opening it as one.
#pragma once

#include <string>

namespace isobrick {

// True for a regular file that begins with the magic of a pyramid. Never waits for the other end
// of a pipe.
bool beginsAsPyramid(const std::string& path);

// True for a regular file that begins as a pyramid, or has its ending (.isb), and for a URL, of
// which nothing is read for that.
bool isPyramidFile(const std::string& path);

}  // namespace isobrick
