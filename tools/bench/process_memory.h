// This process's memory as the system counts it, and what of a file is in memory.
#pragma once

#include <cstdint>
#include <string>

namespace isobrick {

// The most memory that was resident at any moment since the process started or forgot its peak.
// Unlike getrusage()'s it does not include the process that started this one.
std::uint64_t peakOfProcess();
// From here on the peak counts anew. If the system does not allow it, the old peak stays.
void forgetPeak();

// The setting (NAME=value) that makes the C library request huge pages in every large allocation of
// a program that starts with it; glibc 2.35 and later.
inline constexpr char kAllocateHugePages[] = "GLIBC_TUNABLES=glibc.malloc.hugetlb=1";

// Makes the system drop the file's pages, after it has written those that wait for the disk. It
// keeps pages that a process has mapped, and some file systems (tmpfs) keep everything: see
// cachedShare(). Both throw Error if the file cannot be opened.
void dropFromPageCache(const std::string& path);

// 0: nothing of the file is in memory; 1: all of it.
double cachedShare(const std::string& path);

}  // namespace isobrick
