// Which part of a file the system holds in its page cache.
#pragma once

#include <string>

namespace isobrick {

// Asks the system to forget the file's pages, after it has written those that wait for the disk.
// It keeps what a process has mapped, and some file systems (tmpfs) keep everything: see
// cachedShare(). Both throw Error where the file cannot be opened.
void dropFromPageCache(const std::string& path);

// 0: nothing of the file is in memory; 1: all of it.
double cachedShare(const std::string& path);

}  // namespace isobrick
