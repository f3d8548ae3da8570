// One range of memory in huge pages, cut into buffers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <set>
#include <utility>
#include <vector>

namespace isobrick {

// Memory that is touched for the first time comes from the system page by page, and each page costs
// a fault and is cleared: for a brick that is unpacked into fresh memory that is as long again as
// unpacking. Here buffers are runs of one range in huge pages that keeps the touched memory.
//
// The range is as large as its owner's budget, in whole huge pages, and so bounds the touched
// memory; it is reserved with the first buffer, as addresses alone. Runs that are given back join
// free neighbours; a buffer takes the smallest free run that holds it. If there is none, or no
// addresses are left, the buffer has to come from elsewhere. Under AddressSanitizer memory that is
// not taken may not be touched.
//
// All members are thread-safe, and take one lock for a time that grows with the logarithm of the
// number of runs; trim() holds it longer. No thread may use the object while it is made or
// destroyed.
class BufferSlab {
 public:
  static constexpr std::uint64_t kHugePageBytes = std::uint64_t{2} << 20;
  static constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 38;

  // Room for `budget_bytes`, rounded up to huge pages, but at most kMostBytes; none for a budget of
  // 0.
  explicit BufferSlab(std::uint64_t budget_bytes);
  ~BufferSlab();
  BufferSlab(const BufferSlab&) = delete;
  BufferSlab& operator=(const BufferSlab&) = delete;

  // The size of a buffer for so many bytes: a little more, so that runs of nearly the same size can
  // take each other's place.
  static std::uint64_t runBytes(std::uint64_t bytes);

  // A buffer of at least 1 byte, aligned to 64, until giveBack(). Its contents are left over from
  // others. nullptr if no free run is long enough. Throws std::bad_alloc.
  [[nodiscard]] std::byte* take(std::uint64_t bytes);
  void giveBack(const std::byte* buffer) noexcept;

  // The size of all together; 0 once it is known that the system gives no addresses.
  std::uint64_t bytes() const;
  // The memory that was touched, and not given back to the system, beyond the runs that are taken.
  // Counts a huge page as a whole.
  std::uint64_t idleBytes() const;
  // Gives about so many of them back, those of the longest runs first, or as many as there are in
  // whole granules.
  void trim(std::uint64_t bytes) noexcept;

 private:
  // 32 in a huge page. Less is not given back on its own.
  static constexpr std::uint64_t kGranuleBytes = kHugePageBytes / 32;

  using FreeRuns = std::set<std::pair<std::uint64_t, std::uint64_t>>;  // length and begin
  struct Run {
    std::uint64_t bytes = 0;
    FreeRuns::node_type free_node;  // of a taken one, for when it is free again
    bool isFree() const { return free_node.empty(); }
  };

  bool reserve();
  void touch(std::uint64_t begin, std::uint64_t bytes);
  std::uint64_t giveBackGranules(std::uint64_t begin, std::uint64_t bytes, std::uint64_t most);

  mutable std::mutex mutex_;  // guards all below
  std::uint64_t bytes_;
  void* map_ = nullptr;                // the reserved range
  std::byte* base_ = nullptr;          // from here on, at a huge page
  std::map<std::uint64_t, Run> runs_;  // by begin; without gaps
  FreeRuns free_runs_;
  std::vector<std::uint32_t> touched_;  // for each huge page up to the last touched, its granules
  std::uint64_t touched_bytes_ = 0;
  std::uint64_t taken_bytes_ = 0;
};

// A buffer of a slab, which lives as long, or of the heap.
struct PartBufferDeleter {
  static constexpr std::align_val_t kAlignment{64};

  BufferSlab* slab = nullptr;

  void operator()(std::byte* buffer) const {
    if (slab != nullptr)
      slab->giveBack(buffer);
    else
      ::operator delete[](buffer, kAlignment);
  }
};
using PartBuffer = std::unique_ptr<std::byte[], PartBufferDeleter>;

}  // namespace isobrick
