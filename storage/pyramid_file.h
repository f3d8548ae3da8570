// Whether a file is a pyramid, without opening it as one.
#pragma once

#include <string>

namespace isobrick {

// True for a regular file that begins with the magic of a pyramid. Never waits for the other end
// of a pipe.
bool beginsAsPyramid(const std::string& path);

// True for a URL that names an OME-Zarr store, or a group or array in it, by the look of it: a name
// in its path ends in .zarr, .ozx or .zip, or it ends with a slash; and no name of a pyramid comes
// last.
bool isRemoteVolume(const std::string& path);

// True for a regular file that begins as a pyramid, or has its ending (.isb), for a folder that is
// a divided pyramid, or has its ending (.isbs), and for a URL that is no isRemoteVolume(); of a URL
// nothing is read for that.
bool isPyramidFile(const std::string& path);

// The file to open for `path`: of a folder, also behind a URL, that is a divided pyramid, its
// index.
std::string pyramidFileOf(const std::string& path);

// The path or URL of a file in the folder of another one; it takes the query of a URL over.
std::string besidePath(const std::string& path, const std::string& name);

}  // namespace isobrick
