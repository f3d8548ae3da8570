#include "tools/bench/process_memory.h"

#include <fmt/format.h>
#include <sys/prctl.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// The value, in KiB, of a line such as "VmHWM:     1234 kB"; 0 where there is none.
std::uint64_t bytesInLine(const char* path, const std::string& name) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);)
    if (line.rfind(name + ":", 0) == 0)
      return 1024 * std::strtoull(line.c_str() + name.size() + 1, nullptr, 10);
  return 0;
}

}  // namespace

std::uint64_t peakOfProcess() { return bytesInLine("/proc/self/status", "VmHWM"); }

void forgetPeak() { std::ofstream("/proc/self/clear_refs") << "5"; }

std::uint64_t hugePageBytes() { return bytesInLine("/proc/self/smaps_rollup", "AnonHugePages"); }

void refuseHugePages() {
  if (prctl(PR_SET_THP_DISABLE, 1, 0, 0, 0) != 0)
    throw Error(fmt::format("cannot go without huge pages: {}; leave out --huge-pages off",
                            std::strerror(errno)));
}

}  // namespace isobrick
