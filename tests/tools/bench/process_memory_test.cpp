#include "tools/bench/process_memory.h"

#include <gtest/gtest.h>
#include <linux/magic.h>
#include <sys/mman.h>
#include <sys/vfs.h>

#include <cstring>

#include "isobrick/storage/error.h"
#include "tests/support/child_process.h"
#include "tests/support/file_bytes.h"
#include "tests/support/test_paths.h"

namespace isobrick {
namespace {

using namespace test;

constexpr std::size_t kBytes = std::size_t{64} << 20;

// Written to, so that all of it is resident for a moment.
void touchMemory() {
  void* const memory =
      mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  std::memset(memory, 1, kBytes);
  munmap(memory, kBytes);
}

TEST(ProcessMemory, ThePeakStaysUntilItIsForgotten) {
  expectChildLeavesWith(0, [] {
    const std::uint64_t before = peakOfProcess();
    touchMemory();
    const std::uint64_t peak = peakOfProcess();
    if (peak < before + kBytes / 2) return 1;
    forgetPeak();
    return peakOfProcess() < peak - kBytes / 2 ? 0 : 2;
  });
}

// On the disk, where the tests' folders are not: what lies in memory only cannot be dropped.
TEST(PageCache, WhatIsReadIsInItAndWhatIsDroppedIsNot) {
  const std::string path = isobrickCommand() + "_page_cache_test";
  writeBytes(path, std::string(1 << 20, 'x'));
  EXPECT_EQ(cachedShare(path), 1.0);
  dropFromPageCache(path);
  struct statfs system {};
  statfs(path.c_str(), &system);
  if (system.f_type != TMPFS_MAGIC) {
    EXPECT_LT(cachedShare(path), 1.0);
  }
  EXPECT_EQ(readBytes(path).size(), std::size_t{1} << 20);
  EXPECT_EQ(cachedShare(path), 1.0);
  std::filesystem::remove(path);
  EXPECT_THROW(dropFromPageCache(path), Error);
  EXPECT_THROW(cachedShare(path), Error);
}

}  // namespace
}  // namespace isobrick
