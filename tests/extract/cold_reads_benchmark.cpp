// The time to read the samples of a plan's bricks from the disk, by itself: by threads
// that populate the map, by threads with pread, and by one thread with io_uring. In the order of
// the plan, the file dropped from the page cache before each. Argument 1: map (0), pread (1) or
// io_uring (2); argument 2: how many threads, or requests at once.
// ISOBRICK_BENCHMARK_PYRAMID: the file (needed); ISOBRICK_BENCHMARK_ISOVALUE (600).
#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <linux/io_uring.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tools/bench/process_memory.h"

namespace isobrick {
namespace {

struct StoredPart {
  std::uint64_t offset, bytes;
};

std::vector<StoredPart> samplesOfPlan(const std::string& path, double isovalue) {
  const Pyramid pyramid(path);
  Query query;
  query.isovalue = isovalue;
  std::vector<StoredPart> parts;
  const ExtractionPlan plan = Extractor(pyramid).plan(query);
  for (const BrickWork& work : plan.bricks()) {
    const BrickRow row = pyramid.parts().brickRowOf(work.level, work.brick);
    const format::PartEntry& part = row.part(PartKind::kSamples);
    if (part.stored_bytes > 0) parts.push_back({part.offset, part.stored_bytes});
  }
  return parts;
}

// work(part number) for all, on some threads.
template <typename Work>
void onThreads(std::size_t threads, std::size_t parts, Work&& work) {
  std::atomic<std::size_t> next{0};
  std::vector<std::thread> pool;
  for (std::size_t t = 0; t < threads; ++t)
    pool.emplace_back([&] {
      for (std::size_t n = next++; n < parts; n = next++) work(n);
    });
  for (std::thread& thread : pool) thread.join();
}

bool readMapped(int fd, std::uint64_t file_bytes, const std::vector<StoredPart>& parts,
                std::size_t threads) {
  void* const map = mmap(nullptr, file_bytes, PROT_READ, MAP_SHARED, fd, 0);
  if (map == MAP_FAILED) return false;
  madvise(map, file_bytes, MADV_RANDOM);
  std::atomic<bool> is_good{true};
  onThreads(threads, parts.size(), [&](std::size_t n) {
    const std::uint64_t begin = parts[n].offset / 4096 * 4096;
    char* const from = static_cast<char*>(map) + begin;
    const std::uint64_t bytes = parts[n].offset + parts[n].bytes - begin;
    madvise(from, bytes, MADV_WILLNEED);
    if (madvise(from, bytes, MADV_POPULATE_READ) != 0) is_good = false;
  });
  munmap(map, file_bytes);
  return is_good;
}

bool readByThreads(int fd, const std::vector<StoredPart>& parts, std::uint64_t greatest,
                   std::size_t threads) {
  std::atomic<bool> is_good{true};
  onThreads(threads, parts.size(), [&](std::size_t n) {
    thread_local std::vector<char> buffer;
    buffer.resize(greatest);
    const ssize_t got =
        pread(fd, buffer.data(), parts[n].bytes, static_cast<off_t>(parts[n].offset));
    if (got != static_cast<ssize_t>(parts[n].bytes)) is_good = false;
  });
  return is_good;
}

// The rings of one io_uring, as the kernel lays them out (linux/io_uring.h).
class Uring {
 public:
  explicit Uring(unsigned entries) {
    fd_ = static_cast<int>(syscall(SYS_io_uring_setup, entries, &params_));
    if (fd_ < 0) return;
    const std::size_t ring_bytes =
        std::max<std::size_t>(params_.sq_off.array + params_.sq_entries * sizeof(unsigned),
                              params_.cq_off.cqes + params_.cq_entries * sizeof(io_uring_cqe));
    ring_ = map(ring_bytes, IORING_OFF_SQ_RING);
    requests_ = static_cast<io_uring_sqe*>(
        static_cast<void*>(map(params_.sq_entries * sizeof(io_uring_sqe), IORING_OFF_SQES)));
  }
  ~Uring() {
    for (const auto& [address, bytes] : maps_) munmap(address, bytes);
    if (fd_ >= 0) close(fd_);
  }
  Uring(const Uring&) = delete;
  bool isThere() const { return fd_ >= 0 && (params_.features & IORING_FEAT_SINGLE_MMAP) != 0; }

  void submitRead(int file, const StoredPart& part, char* out, std::uint64_t number) {
    unsigned& tail = field(params_.sq_off.tail);
    const unsigned place = tail & field(params_.sq_off.ring_mask);
    io_uring_sqe& request = requests_[place] = {};
    request.opcode = IORING_OP_READ;
    request.fd = file;
    request.off = part.offset;
    request.addr = reinterpret_cast<std::uint64_t>(out);
    request.len = static_cast<unsigned>(part.bytes);
    request.user_data = number;
    (&field(params_.sq_off.array))[place] = place;
    std::atomic_ref(tail).store(tail + 1, std::memory_order_release);
    syscall(SYS_io_uring_enter, fd_, 1, 0, 0, nullptr, 0);
  }
  // Waits for one.
  io_uring_cqe take() {
    unsigned& head = field(params_.cq_off.head);
    while (std::atomic_ref(field(params_.cq_off.tail)).load(std::memory_order_acquire) == head)
      syscall(SYS_io_uring_enter, fd_, 0, 1, IORING_ENTER_GETEVENTS, nullptr, 0);
    const auto* const done = reinterpret_cast<const io_uring_cqe*>(ring_ + params_.cq_off.cqes);
    const io_uring_cqe result = done[head & field(params_.cq_off.ring_mask)];
    std::atomic_ref(head).store(head + 1, std::memory_order_release);
    return result;
  }

 private:
  char* map(std::size_t bytes, off_t offset) {
    void* const address =
        mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd_, offset);
    maps_.emplace_back(address, bytes);
    return static_cast<char*>(address);
  }
  unsigned& field(unsigned offset) { return *reinterpret_cast<unsigned*>(ring_ + offset); }

  io_uring_params params_{};
  int fd_ = -1;
  char* ring_ = nullptr;
  io_uring_sqe* requests_ = nullptr;
  std::vector<std::pair<void*, std::size_t>> maps_;
};

bool readByUring(int fd, const std::vector<StoredPart>& parts, std::uint64_t greatest,
                 std::size_t depth) {
  Uring uring(static_cast<unsigned>(depth));
  if (!uring.isThere()) return false;
  std::vector<std::vector<char>> buffers(depth, std::vector<char>(greatest));
  std::vector<std::size_t> part_of(depth);
  std::size_t next = 0;
  bool is_good = true;
  const auto submit = [&](std::size_t slot) {
    part_of[slot] = next++;
    uring.submitRead(fd, parts[part_of[slot]], buffers[slot].data(), slot);
  };
  for (std::size_t slot = 0; slot < depth && next < parts.size(); ++slot) submit(slot);
  for (std::size_t done = 0; done < parts.size(); ++done) {
    const io_uring_cqe result = uring.take();
    const auto slot = static_cast<std::size_t>(result.user_data);
    is_good = is_good && result.res == static_cast<std::int64_t>(parts[part_of[slot]].bytes);
    if (next < parts.size()) submit(slot);
  }
  return is_good;
}

void coldReads(benchmark::State& state) {
  const char* const path = std::getenv("ISOBRICK_BENCHMARK_PYRAMID");
  if (path == nullptr) {
    state.SkipWithError("set ISOBRICK_BENCHMARK_PYRAMID to a file");
    return;
  }
  const char* const isovalue = std::getenv("ISOBRICK_BENCHMARK_ISOVALUE");
  const std::vector<StoredPart> parts =
      samplesOfPlan(path, isovalue != nullptr ? std::atof(isovalue) : 600);
  std::uint64_t bytes = 0, greatest = 0;
  for (const StoredPart& part : parts) {
    bytes += part.bytes;
    greatest = std::max(greatest, part.bytes);
  }
  const auto depth = static_cast<std::size_t>(state.range(1));
  const int fd = open(path, O_RDONLY | O_CLOEXEC);
  const auto file_bytes = static_cast<std::uint64_t>(lseek(fd, 0, SEEK_END));
  std::vector<double> milliseconds;
  for (auto _ : state) {
    dropFromPageCache(path);
    const auto begin = std::chrono::steady_clock::now();
    const bool is_good = state.range(0) == 0   ? readMapped(fd, file_bytes, parts, depth)
                         : state.range(0) == 1 ? readByThreads(fd, parts, greatest, depth)
                                               : readByUring(fd, parts, greatest, depth);
    const auto end = std::chrono::steady_clock::now();
    if (!is_good) {
      state.SkipWithError("the parts cannot be read in this way here");
      break;
    }
    milliseconds.push_back(std::chrono::duration<double, std::milli>(end - begin).count());
  }
  close(fd);
  if (milliseconds.empty()) return;
  std::sort(milliseconds.begin(), milliseconds.end());
  state.counters["median_ms"] = milliseconds[milliseconds.size() / 2];
  state.counters["least_ms"] = milliseconds.front();
  state.counters["MB"] = 1e-6 * static_cast<double>(bytes);
}
BENCHMARK(coldReads)
    ->ArgsProduct({{0, 1, 2}, {1, 4, 16, 64}})
    ->Unit(benchmark::kMillisecond)
    ->Iterations(9);

}  // namespace
}  // namespace isobrick
