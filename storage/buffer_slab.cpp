#include "isobrick/storage/buffer_slab.h"

#include <sys/mman.h>

#include <algorithm>
#include <bit>

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/asan_interface.h>
#endif

namespace isobrick {
namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr std::uint64_t kRedZoneBytes = 64;
void forbid(const void* begin, std::uint64_t bytes) { __asan_poison_memory_region(begin, bytes); }
void permit(const void* begin, std::uint64_t bytes) { __asan_unpoison_memory_region(begin, bytes); }
#else
constexpr std::uint64_t kRedZoneBytes = 0;
void forbid(const void*, std::uint64_t) {}
void permit(const void*, std::uint64_t) {}
#endif

// Reserved addresses count for nothing, not even if the system promises no more than it has
// (vm.overcommit_memory=2); as far as buffers reach it is opened, so much at once.
constexpr std::uint64_t kOpenStep = std::uint64_t{32} << 20;

std::uint64_t roundedUp(std::uint64_t bytes, std::uint64_t step) {
  return (bytes + step - 1) / step * step;
}

}  // namespace

BufferSlab::BufferSlab(std::uint64_t budget_bytes)
    : bytes_(budget_bytes < kMostBytes ? roundedUp(budget_bytes, kHugePageBytes) : kMostBytes) {}

BufferSlab::~BufferSlab() {
  if (map_ == nullptr) return;
  permit(base_, std::min<std::uint64_t>(touched_.size() * kHugePageBytes, bytes_));
  munmap(map_, bytes_ + kHugePageBytes);
}

// 32 sizes for each power of two, as bricks at the border are a little smaller than the others.
// With 8 sizes the loss to rounding up made sweeps at half the working set read up to 30 % more.
std::uint64_t BufferSlab::runBytes(std::uint64_t bytes) {
  bytes += kRedZoneBytes;
  return roundedUp(bytes, std::bit_floor(bytes | 2048u) / 32);
}

// If the system refuses, there is no slab, and no further call tries again.
bool BufferSlab::reserve() {
  if (bytes_ == 0) return false;
  void* const map = mmap(nullptr, bytes_ + kHugePageBytes, PROT_NONE,
                         MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (map == MAP_FAILED) {
    bytes_ = 0;
    return false;
  }
  try {
    FreeRuns::node_type none;
    runs_.emplace(0, Run{bytes_, std::move(none)});
    free_runs_.emplace(bytes_, 0);
  } catch (...) {
    runs_.clear();
    munmap(map, bytes_ + kHugePageBytes);
    throw;
  }
  map_ = map;
  base_ = static_cast<std::byte*>(map);
  base_ += -reinterpret_cast<std::uintptr_t>(base_) % kHugePageBytes;
  madvise(base_, bytes_, MADV_HUGEPAGE);  // if it is refused, small pages do
  return true;
}

std::byte* BufferSlab::take(std::uint64_t bytes) {
  const std::uint64_t wanted = runBytes(bytes);
  const std::lock_guard lock(mutex_);
  if (base_ == nullptr && !reserve()) return nullptr;
  const auto found = free_runs_.lower_bound({wanted, 0});
  if (found == free_runs_.end()) return nullptr;
  const auto [length, begin] = *found;
  // All that may throw comes first.
  if (const std::uint64_t open = touched_.size() * kHugePageBytes; begin + wanted > open) {
    const std::uint64_t end = std::min(roundedUp(begin + wanted, kOpenStep), bytes_);
    touched_.resize(end / kHugePageBytes);
    if (mprotect(base_ + open, end - open, PROT_READ | PROT_WRITE) != 0) {
      touched_.resize(open / kHugePageBytes);
      return nullptr;
    }
  }
  const auto run = runs_.find(begin);
  if (length > wanted) {
    FreeRuns rest = {{length - wanted, begin + wanted}};
    runs_.emplace_hint(std::next(run), begin + wanted, Run{length - wanted, {}});
    free_runs_.insert(rest.extract(rest.begin()));
  }
  run->second.bytes = wanted;
  run->second.free_node = free_runs_.extract(found);
  taken_bytes_ += wanted;
  touch(begin, wanted);
  permit(base_ + begin, bytes);
  forbid(base_ + begin + bytes, wanted - bytes);
  return base_ + begin;
}

void BufferSlab::giveBack(const std::byte* buffer) noexcept {
  const std::lock_guard lock(mutex_);
  auto run = runs_.find(static_cast<std::uint64_t>(buffer - base_));
  forbid(buffer, run->second.bytes);
  taken_bytes_ -= run->second.bytes;
  FreeRuns::node_type node = std::move(run->second.free_node);
  const auto join = [&](auto before, auto after) {
    before->second.bytes += after->second.bytes;
    runs_.erase(after);
  };
  if (const auto next = std::next(run); next != runs_.end() && next->second.isFree()) {
    free_runs_.erase({next->second.bytes, next->first});
    join(run, next);
  }
  if (run != runs_.begin() && std::prev(run)->second.isFree()) {
    const auto before = std::prev(run);
    free_runs_.erase({before->second.bytes, before->first});
    join(before, run);
    run = before;
  }
  node.value() = {run->second.bytes, run->first};
  free_runs_.insert(std::move(node));
}

// The first touch of a huge page brings all of it.
void BufferSlab::touch(std::uint64_t begin, std::uint64_t bytes) {
  for (std::uint64_t at = begin; at < begin + bytes;) {
    std::uint32_t& granules = touched_[at / kHugePageBytes];
    const std::uint64_t first = at % kHugePageBytes / kGranuleBytes;
    const std::uint64_t end = std::min(begin + bytes, roundedUp(at + 1, kHugePageBytes));
    const std::uint64_t last = (end - 1) % kHugePageBytes / kGranuleBytes;
    const std::uint32_t taken = (~std::uint32_t{0} >> (31 - last)) & (~std::uint32_t{0} << first);
    const std::uint32_t now = granules == 0 ? ~std::uint32_t{0} : granules | taken;
    touched_bytes_ += kGranuleBytes * static_cast<std::uint64_t>(std::popcount(now ^ granules));
    granules = now;
    at = end;
  }
}

std::uint64_t BufferSlab::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

std::uint64_t BufferSlab::idleBytes() const {
  const std::lock_guard lock(mutex_);
  return touched_bytes_ - taken_bytes_;
}

void BufferSlab::trim(std::uint64_t bytes) noexcept {
  const std::lock_guard lock(mutex_);
  for (auto run = free_runs_.rbegin(); run != free_runs_.rend() && bytes > 0; ++run) {
    if (run->first < kGranuleBytes) return;
    bytes -= giveBackGranules(run->second, run->first, bytes);
  }
}

// The touched part of a free run; returns how much of `most` that was.
std::uint64_t BufferSlab::giveBackGranules(std::uint64_t begin, std::uint64_t bytes,
                                           std::uint64_t most) {
  const std::uint64_t end =
      std::min((begin + bytes) / kGranuleBytes * kGranuleBytes, touched_.size() * kHugePageBytes);
  std::uint64_t given = 0;
  for (std::uint64_t at = roundedUp(begin, kGranuleBytes); at < end && given < most;) {
    std::uint32_t& granules = touched_[at / kHugePageBytes];
    const std::uint64_t page_end = std::min(end, roundedUp(at + 1, kHugePageBytes));
    const std::uint64_t first = at % kHugePageBytes / kGranuleBytes;
    const std::uint64_t last = (page_end - 1) % kHugePageBytes / kGranuleBytes;
    const std::uint32_t idle =
        granules & (~std::uint32_t{0} >> (31 - last)) & (~std::uint32_t{0} << first);
    if (idle != 0) {
      madvise(base_ + at, page_end - at, MADV_DONTNEED);
      granules &= ~idle;
      given += kGranuleBytes * static_cast<std::uint64_t>(std::popcount(idle));
    }
    at = page_end;
  }
  touched_bytes_ -= given;
  return std::min(given, most);
}

}  // namespace isobrick
