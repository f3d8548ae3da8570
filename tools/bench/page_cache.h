// What of a file is in memory.
#pragma once

#include <string>

namespace isobrick {

// Makes the system drop the file's pages, after it has written those that wait for the disk. It
// keeps pages that a process has mapped, and some file systems (tmpfs) keep everything: see
// cachedShare(). Both throw Error if the file cannot be opened.
void dropFromPageCache(const std::string& path);

// 0: nothing of the file is in memory; 1: all of it.
double cachedShare(const std::string& path);

}  // namespace isobrick
