// The pager keeps its budget, by its own count and by the kernel's: what goes is given back, what
// is held stays.

#include "isobrick/storage/brick_pager.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <fstream>
#include <numeric>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/file_edits.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/plain_bricks.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/refused_part.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

volatile std::uint64_t g_sink;  // keeps reads from being optimised away

constexpr std::uint64_t kPage = 4096;

constexpr std::uint64_t kFaultAround = 64 * 1024;  // Linux: fault_around_bytes

struct PagerFile {
  std::string path;
  std::vector<BrickPager::Part> parts;
  std::vector<std::uint8_t> fill;  // every byte of part i
};

// `count` parts of `bytes` bytes, each beginning at a multiple of `alignment`.
PagerFile makePagerFile(const DiskFolder& folder, std::size_t count, std::uint64_t bytes,
                        std::uint64_t alignment) {
  PagerFile result;
  result.path = folder.file("parts");
  Bytes all;
  for (std::size_t i = 0; i < count; ++i) {
    all.resize((all.size() + alignment - 1) / alignment * alignment);
    const auto value = static_cast<std::uint8_t>(1 + i % 250);
    const std::uint64_t offset = all.size();
    all.resize(offset + bytes, value);
    BrickPager::Part part;
    part.offset = offset;
    part.bytes = bytes;
    part.checksum = checksum64(all.data() + offset, bytes);
    result.parts.push_back(part);
    result.fill.push_back(value);
  }
  writeBytes(result.path, all);
  // A file that was just written lies in the page cache in blocks of up to 2 MiB, and the kernel
  // maps all of a block at the first touch. Read back cold it lies there page by page.
  const int fd = open(result.path.c_str(), O_RDONLY | O_CLOEXEC);
  fsync(fd);
  posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
  close(fd);
  return result;
}

// Bytes of the mapping that the process holds now.
std::uint64_t residentBytesOf(const PagedFile& file) {
  std::ifstream maps("/proc/self/smaps");
  const auto begin = reinterpret_cast<std::uintptr_t>(file.data());
  std::string line;
  std::uint64_t resident = 0;
  bool inside = false;
  while (std::getline(maps, line)) {
    std::uintptr_t first = 0, end = 0;
    char dash = 0;
    std::istringstream range(line);
    if (line.find('-') < line.find(' ') && range >> std::hex >> first >> dash >> end)
      inside = first < begin + file.size() && end > begin;
    else if (inside && line.starts_with("Rss:"))
      resident += std::stoull(line.substr(4)) * 1024;
  }
  return resident;
}

// The bytes that the process maps of the pages around `bytes` bytes from `offset` that one fault
// may bring in together. Right after these were given back there are none, whatever the kernel maps
// around the pages that are touched next.
std::uint64_t mappedBytesAround(const PagedFile& file, std::uint64_t offset, std::uint64_t bytes) {
  const std::uint64_t begin = offset / kFaultAround * kFaultAround;
  const std::uint64_t end =
      std::min((offset + bytes + kFaultAround - 1) / kFaultAround * kFaultAround,
               (file.size() + kPage - 1) / kPage * kPage);
  std::vector<std::uint64_t> pages((end - begin) / kPage);
  const std::uint64_t first = (reinterpret_cast<std::uintptr_t>(file.data()) + begin) / kPage;
  const std::size_t wanted = pages.size() * sizeof pages[0];
  const int pagemap = open("/proc/self/pagemap", O_RDONLY | O_CLOEXEC);
  const ssize_t got =
      pread(pagemap, pages.data(), wanted, static_cast<off_t>(first * sizeof pages[0]));
  close(pagemap);
  if (got != static_cast<ssize_t>(wanted)) throw std::runtime_error("cannot read the page map");
  const auto is_mapped = [](std::uint64_t page) { return page >> 63 != 0; };
  return kPage * static_cast<std::uint64_t>(std::count_if(pages.begin(), pages.end(), is_mapped));
}

std::uint64_t mappedBytesAround(const PagedFile& file, const BrickPager::Part& part) {
  return mappedBytesAround(file, part.offset, part.bytes);
}

// False if one touched page maps far neighbours too (tmpfs, or a file that stayed in the page cache
// in large blocks): then the resident bytes of the whole file say little about the pager, and the
// tests compare them with nothing. Ends with nothing resident.
bool kernelMapsSinglePages(const PagedFile& file) {
  g_sink = static_cast<std::uint8_t>(file.data()[0]);
  const bool single = residentBytesOf(file) <= kPage;
  file.release(0, file.size() / kPage * kPage);
  return single;
}

const std::byte* mustAcquire(BrickPager& pager, std::size_t id) {
  const std::byte* data = pager.acquire(id);
  if (data == nullptr) throw std::runtime_error("no bytes");
  return data;
}

TEST(BrickPager, KeepsTheBudget) {
  const DiskFolder folder;
  const PagerFile made = makePagerFile(folder, 200, 4 * kPage, kPage);
  const PagedFile file(made.path);
  const std::uint64_t budget = 10 * 4 * kPage;
  const bool single_pages = kernelMapsSinglePages(file);
  BrickPager pager(file, made.parts, budget);
  for (std::size_t i = 0; i < made.parts.size(); ++i) {
    const std::byte* const data = mustAcquire(pager, i);
    ASSERT_LE(pager.heldBytes(), budget);
    if (i >= 10) {  // the one that had to go for it
      ASSERT_EQ(mappedBytesAround(file, made.parts[i - 10]), 0u) << i;
    }
    EXPECT_EQ(static_cast<std::uint8_t>(data[kPage]), made.fill[i]);
    ASSERT_GT(mappedBytesAround(file, made.parts[i]), 0u) << i;
    pager.release(i);
    if (single_pages) {
      ASSERT_LE(residentBytesOf(file), budget) << "after part " << i;
    }
  }
  const BrickPager::Counters counters = pager.counters();
  EXPECT_EQ(counters.parts_read, 200u);
  EXPECT_EQ(counters.bytes_read, 200 * 4 * kPage);
  EXPECT_EQ(counters.parts_released, 190u);
  // The last ten are still in, the others are not.
  for (std::size_t i = 190; i < 200; ++i) {
    mustAcquire(pager, i);
    pager.release(i);
  }
  EXPECT_EQ(pager.counters().parts_read, 200u);
  mustAcquire(pager, 0);
  pager.release(0);
  EXPECT_EQ(pager.counters().parts_read, 201u);
}

// At a fault the kernel maps whatever of the aligned 64 KiB around lies in the page cache, and
// tile ranges and curvature share their first and last pages with neighbours. All that a part
// brought in must go with it, or the process ends up holding the whole file: a 2048^3 volume has
// 10^5 parts.
TEST(BrickPager, KeepsTheBudgetAmongCachedNeighbours) {
  const DiskFolder folder;
  const std::uint64_t bytes = 8200;
  const PagerFile made = makePagerFile(folder, 4000, bytes, 64);
  const PagedFile file(made.path);
  const bool single_pages = kernelMapsSinglePages(file);
  const std::uint64_t budget = 20 * bytes;
  BrickPager pager(file, made.parts, budget);
  Random random(14);
  std::vector<std::size_t> order(made.parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::shuffle(order.begin(), order.end(), random);
  for (std::size_t n = 0; n < order.size(); ++n) {
    const std::size_t i = order[n];
    const std::byte* const data = mustAcquire(pager, i);
    if (n >= 20) {
      ASSERT_EQ(mappedBytesAround(file, made.parts[order[n - 20]]), 0u) << n;
    }
    EXPECT_EQ(static_cast<std::uint8_t>(*data), made.fill[i]);
    pager.release(i);
  }
  if (single_pages) {
    EXPECT_LE(residentBytesOf(file), budget + 20 * 2 * kFaultAround) << "the budget is " << budget;
  }
}

TEST(BrickPager, NestedHoldsStayResident) {
  const DiskFolder folder;
  const PagerFile made = makePagerFile(folder, 8, 64 * kPage, kPage);
  const PagedFile file(made.path);
  const bool single_pages = kernelMapsSinglePages(file);
  BrickPager pager(file, made.parts, 0);  // nothing may stay that is not in use
  const std::byte* data = mustAcquire(pager, 3);
  EXPECT_EQ(mustAcquire(pager, 3), data);
  EXPECT_EQ(mustAcquire(pager, 3), data);
  EXPECT_EQ(pager.counters().parts_read, 1u);
  pager.release(3);
  pager.release(3);
  EXPECT_EQ(pager.counters().parts_released, 0u);
  // More is in use than the budget allows: nothing waits, nothing in use goes.
  mustAcquire(pager, 4);
  EXPECT_EQ(pager.counters().parts_released, 0u);
  EXPECT_EQ(static_cast<std::uint8_t>(data[5]), made.fill[3]);
  EXPECT_GT(mappedBytesAround(file, made.parts[3]), 0u);
  pager.release(3);
  EXPECT_EQ(pager.counters().parts_released, 1u);
  EXPECT_EQ(mappedBytesAround(file, made.parts[3]), 0u);
  pager.release(4);
  EXPECT_EQ(pager.counters().parts_released, 2u);
  EXPECT_EQ(mappedBytesAround(file, made.parts[4]), 0u);
  if (single_pages) {
    EXPECT_LE(residentBytesOf(file), kFaultAround);
  }
  mustAcquire(pager, 3);
  pager.release(3);
  EXPECT_EQ(pager.counters().parts_read, 3u);
}

TEST(BrickPager, LetsTheOldestGoFirst) {
  const DiskFolder folder;
  const PagerFile made = makePagerFile(folder, 6, kPage, kPage);
  const PagedFile file(made.path);
  BrickPager pager(file, made.parts, 3 * kPage);
  const auto touch = [&](std::size_t id) {
    mustAcquire(pager, id);
    pager.release(id);
    return pager.counters().parts_read;
  };
  touch(0), touch(1), touch(2);
  EXPECT_EQ(touch(0), 3u);  // 0 is now the newest, 1 the oldest
  EXPECT_EQ(touch(3), 4u);  // 1 goes
  EXPECT_EQ(touch(0), 4u);
  EXPECT_EQ(touch(2), 4u);
  EXPECT_EQ(touch(1), 5u);
}

TEST(BrickPager, DamageIsSaidEveryTime) {
  const DiskFolder folder;
  PagerFile made = makePagerFile(folder, 3, kPage, kPage);
  made.parts[1].checksum ^= 1;
  const PagedFile file(made.path);
  BrickPager pager(file, made.parts, 10 * kPage);
  for (int round = 0; round < 2; ++round)
    EXPECT_NE(whyRefused(pager, 1).find("checksum"), std::string::npos);
  EXPECT_EQ(pager.counters().parts_read, 0u);
}

// The same through Pyramid: several readers, a budget of a few bricks, every value checked.
void readWithinABudget(format::Codec codec) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, codec);
  const PlainPyramid plain = readPlainPyramid(path);
  const Pyramid pyramid(path, 64 * 1024);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < 3; ++t)
    threads.emplace_back([&, t] {
      Random random(t);
      for (int round = 0; round < 300; ++round) {
        const PlainBrick& brick = plain.bricks[randomBelow(random, plain.bricks.size())];
        const BrickSamples samples = pyramid.samples(brick.level, indexOf(brick));
        if (!areSamplesOf<std::uint16_t>(brick, samples)) ++wrong;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(pyramid.parts().counters().parts_released, 0u);
}

TEST(BrickPager, PyramidReadersWithinABudget) {
  for (const format::Codec codec : kCodecs) readWithinABudget(codec);
}

}  // namespace
}  // namespace isobrick::test
