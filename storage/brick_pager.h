// The parts of a file that the process holds, and for how long.
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/buffer_slab.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/paged_file.h"
#include "isobrick/storage/residence_policy.h"
#include "isobrick/storage/source_bricks.h"

namespace isobrick {

// Hands out parts of a file, each checked against its checksum when it comes in, and keeps
// the sum of those that stay resident within a budget: residence_policy.h says who goes first.
// Parts in use never go, so a budget smaller than what is in use at one moment is exceeded by just
// that, and nothing waits for room.
//
// A part is absent, loading, or resident, and a resident one may be in use. A thread that wants a
// part which another one is loading waits for it: nothing is read or unpacked twice at once. The
// loading thread never waits for another. A thread that may be cancelled leaves loading to threads
// of the pager, so that it need not stay until the part has come.
//
// A stored part of a mapped file is used in place: what it costs is its pages of the map, which are
// given back to the system. One that lies in the source of an index is made there in a buffer, and
// what the source holds counts against the budget from its first part on. Any other is read, past
// the map, into a buffer, a packed one unpacked on the way: what it costs is that buffer (rounded
// up by 3 % at most), and, while it is being unpacked, one for a copy of its packed bytes, on which
// alone checksum and decoder work. Buffers lie in a slab as large as the budget (buffer_slab.h). If
// its free pieces are too short, more parts go; if all are in use, the heap serves. The slab gives
// back to the system as much as parts beside it need of the budget. So the memory that was touched
// is at most the budget, rounded up to a huge page, and a granule of the slab for each free run.
// Unpacking itself takes up to 3 MiB for each thread in it. A part that has left the sum may be on
// its way out for a moment yet: one for each thread that makes room.
//
// All members are thread-safe. Reading, checking, unpacking and giving back happen outside all
// locks. A hit takes the lock of one of many shards and makes no system call.
class BrickPager {
 public:
  struct Part {
    std::uint64_t offset = 0;  // of kInSource: the number of the brick in level 0, x fastest
    std::uint64_t bytes = 0;   // in the file; 0: nothing is stored; never acquired
    std::uint64_t checksum = 0;
    std::uint32_t unpacked_bytes = 0;  // of a packed part
    format::Codec codec = format::Codec::kStored;
  };
  // The place of part `id` in the file: called by any thread when the part comes in, with the same
  // result each time. May throw Error; then the part cannot be acquired.
  using PartOf = std::function<Part(std::size_t id)>;

  struct Counters {
    std::uint64_t hits = 0;          // parts acquired that were resident
    std::uint64_t misses = 0;        // and that were not
    std::uint64_t loads_joined = 0;  // and that another thread was loading
    std::uint64_t parts_read = 0;    // how often a part came in
    std::uint64_t bytes_read = 0;    // of the file
    std::uint64_t bytes_unpacked = 0;
    std::uint64_t parts_released = 0;    // how often one went for the budget
    std::uint64_t buffers_beside = 0;    // how often a buffer was of the heap
    std::uint64_t wait_nanoseconds = 0;  // of all threads, in acquire() for misses and joined loads
    std::uint64_t parts_fetched = 0;     // how often one came in ahead of need
    std::uint64_t fetched_unused = 0;    // and went before it was acquired
  };

  // `source`, which outlives the pager, has the parts that are kInSource; null if there are none.
  // Bricks of level 0 are so many along each axis.
  BrickPager(const PagedFile& file, PartOf part_of, std::uint64_t budget_bytes,
             Level0Source* source = nullptr, const Index3& source_bricks = Index3(0));
  BrickPager(const PagedFile& file, std::vector<Part> parts, std::uint64_t budget_bytes);
  ~BrickPager();
  BrickPager(const BrickPager&) = delete;
  BrickPager& operator=(const BrickPager&) = delete;

  // Makes part `id` resident and keeps it so until release(id); counts nest. The memory, aligned
  // to 64 bytes if the part is, stays valid that long; in a buffer it does not change, in place it
  // changes if the file is written to. Throws ReadFailure if the bytes are damaged or cannot be
  // read; another try may succeed. Throws Cancelled some milliseconds after that was requested; a
  // part that is being read comes in all the same.
  [[nodiscard]] const std::byte* acquire(std::size_t id, const CancelFlag* cancel = nullptr);
  // The same if the part is resident now; nullptr if it would have to be read, or is damaged.
  [[nodiscard]] const std::byte* acquireIfResident(std::size_t id);
  void release(std::size_t id) noexcept;

  // The result of fetch(): the part cannot be read, has no room, was resident or is being loaded,
  // or came in.
  enum class Fetched : std::uint8_t { kNever, kNoRoom, kBefore, kNow };
  // Bytes of the budget that are set aside for parts to come; what is left of them is free again
  // when this object goes. Used by one thread at a time; the pager outlives it.
  class Room {
   public:
    Room(const Room&) = delete;
    Room& operator=(const Room&) = delete;
    ~Room() { pager_.held_bytes_ -= bytes_; }

   private:
    friend class BrickPager;
    Room(BrickPager& pager, std::uint64_t since) : pager_(pager), since_(since) {}
    // Makes it at least that large; false if it cannot be.
    bool grow(std::uint64_t bytes);

    BrickPager& pager_;
    std::uint64_t since_;
    std::uint64_t bytes_ = 0;
  };
  // Sets aside the room that these parts need to come in, but for those that are resident. The only
  // parts that go for it are not in use, and no query from number `since` on (beginQuery()) took or
  // fetched them. Null, and nothing is set aside, if that is too little. Any number of threads that
  // reserve at once never have more than the budget together. Throws Error from `part_of`.
  std::shared_ptr<Room> reserve(std::span<const std::size_t> ids, std::uint64_t since);
  // Makes part `id` resident ahead of need, and waits for that unless another thread does it. It
  // stays until it is acquired or another query begins, as far as room can be made elsewhere.
  // acquire() says why a part cannot be read. Throws std::bad_alloc, and Cancelled like acquire().
  //
  // With `room` the part comes into that, which grows as by reserve() if it is too small; a part
  // that another thread loads is waited for. After Cancelled a part that is being read comes in all
  // the same, and the room lives until it is there.
  Fetched fetch(std::size_t id, const CancelFlag* cancel = nullptr,
                const std::shared_ptr<Room>& room = nullptr);

  // Says that these parts will be fetched or acquired soon: the system begins to read those that
  // are absent, or the server to send them. Waits for nothing, and counts nowhere.
  void announce(std::span<const std::size_t> ids);

  // Takes a fetch() of this query back: the part is not kept for it any more, and unless the next
  // query takes it, it is among the first to go then.
  void withdraw(std::size_t id);

  // Whether the part is used in the file's map.
  bool isInPlace(const Part& part) const {
    return part.codec == format::Codec::kStored && file_.isMapped();
  }
  // Asks the file whether it was written to (PagedFile::edition()), and returns how often it was.
  // After that every part that is used in place is checked anew when it is acquired or fetched
  // next.
  std::uint64_t noticeChanges();

  // From here on parts are taken for another query: what neither it nor the one before takes goes
  // first (see ResidencePolicy). Returns the query's number, larger than all before.
  std::uint64_t beginQuery();

  Counters counters() const;
  std::uint64_t missCount() const { return misses_.load(std::memory_order_relaxed); }
  // The bytes that a part counts against the budget while it is resident.
  std::uint64_t costOf(const Part& part) const;
  // The bytes that count against the budget now.
  std::uint64_t heldBytes() const { return held_bytes_.load(); }

 private:
  static constexpr std::size_t kShards = 64;
  enum class State : std::uint8_t { kLoading, kResident, kFailed };
  // A part that is loading or resident. The lock of its shard guards state, users, is_used,
  // is_ahead, query, edition and failure; `part` and `buffer` are the loader's until the part is
  // resident, and then do not change.
  struct Entry : ResidencePolicy::Member {
    Part part;
    State state = State::kLoading;
    bool is_used = false;       // again, since the policy looked at it
    bool is_ahead = false;      // fetched, and not acquired yet
    std::uint64_t query = 0;    // that took it last
    std::uint64_t edition = 0;  // of the file, that its bytes were checked in
    std::uint32_t users = 1;
    std::exception_ptr failure;  // of a failed one
    PartBuffer buffer;           // of one that is not used in place
    std::shared_ptr<Entry> next_leaving;
  };
  struct alignas(64) Shard {
    mutable std::mutex mutex;
    std::condition_variable loaded;
    std::unordered_map<std::size_t, std::shared_ptr<Entry>> entries;
    std::uint64_t hits = 0;
    std::uint64_t loads_joined = 0;
  };

  Shard& shardOf(std::size_t id) { return shards_[id * 0x9E3779B97F4A7C15u >> 58]; }
  const std::byte* dataOf(const Entry& entry) const;
  bool isReachable(std::size_t id) const;
  // For a resident part.
  bool isToBeChecked(const Entry& entry) const {
    return isInPlace(entry.part) && entry.edition != edition_.load(std::memory_order_relaxed);
  }
  const std::byte* take(Shard& shard, std::unique_lock<std::mutex>& lock,
                        const std::shared_ptr<Entry>& slot);
  const std::byte* wait(Shard& shard, std::unique_lock<std::mutex>& lock, Entry& entry,
                        const CancelFlag* cancel);
  const std::byte* loadOrLeave(Shard& shard, const std::shared_ptr<Entry>& entry,
                               const CancelFlag* cancel,
                               const std::shared_ptr<Room>& room = nullptr);
  void loadForOthers(Shard& shard, const std::shared_ptr<Entry>& entry, Room* room) noexcept;
  const std::byte* load(Shard& shard, const std::shared_ptr<Entry>& entry, Room* room);
  const std::byte* checkAnew(Shard& shard, Entry& entry);
  void bringIn(Entry& entry, Room* room);
  void checkInPlace(const Part& part) const;
  void readPart(const Part& part, std::byte* out) const;
  void countSource();
  bool isReached(const Part& part) const {
    return part.codec == format::Codec::kInSource || file_.reaches(part.offset, part.bytes);
  }
  void unpackPart(const Part& part, std::byte* out, bool may_displace);
  PartBuffer takeBuffer(std::uint64_t bytes, bool may_displace);
  static std::uint64_t copyBytes(const Part& part);
  bool isAbsent(std::size_t id);
  void makeRoom(std::uint64_t bytes);
  bool letGo(std::shared_ptr<Entry> leaving) const;
  void trimSlab();
  bool takeFreeRoom(std::uint64_t bytes, std::uint64_t since);
  std::shared_ptr<Entry> takeVictims(std::uint64_t bytes);
  std::shared_ptr<Entry> takeOneVictim();
  std::shared_ptr<Entry> takeVictim();
  template <typename MayGo>
  std::shared_ptr<Entry> takeOut(const ResidencePolicy::Member& member, MayGo&& may_go);

  const PagedFile& file_;
  const PartOf part_of_;
  const std::uint64_t budget_bytes_;
  Level0Source* const source_;
  const Index3 source_bricks_;
  std::once_flag source_is_counted_;
  BufferSlab slab_;  // before the entries, whose buffers lie in it
  std::array<Shard, kShards> shards_;
  std::mutex policy_mutex_;  // taken before that of a shard, never while one is held
  ResidencePolicy policy_;
  std::atomic<std::uint64_t> query_{0};    // the latest
  std::atomic<std::uint64_t> edition_{0};  // of the file, as far as noticed
  std::atomic<std::uint64_t> held_bytes_{0};
  std::atomic<std::uint64_t> misses_{0}, parts_read_{0}, bytes_read_{0}, bytes_unpacked_{0},
      parts_released_{0}, buffers_beside_{0}, wait_nanoseconds_{0}, parts_fetched_{0},
      fetched_unused_{0};
  LoadThreads load_threads_;  // last: they use all of the above
};

}  // namespace isobrick
