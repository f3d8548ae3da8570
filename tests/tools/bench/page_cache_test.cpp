#include "tools/bench/page_cache.h"

#include <gtest/gtest.h>
#include <linux/magic.h>
#include <sys/vfs.h>

#include <filesystem>

#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/test_paths.h"

namespace isobrick {
namespace {

using namespace test;

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
