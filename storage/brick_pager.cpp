#include "isobrick/storage/brick_pager.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <new>
#include <utility>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

constexpr const char* kWrongChecksum = "is damaged (checksum mismatch)";

// A part has no room beside what is in use.
struct NoRoom : std::exception {};

bool isPacked(const BrickPager::Part& part) {
  return part.codec != format::Codec::kStored && part.codec != format::Codec::kInSource;
}

// Adds the time of its life to a sum.
class WaitClock {
 public:
  explicit WaitClock(std::atomic<std::uint64_t>& sum) : sum_(sum) {}
  ~WaitClock() {
    sum_ += static_cast<std::uint64_t>(
        std::chrono::nanoseconds(std::chrono::steady_clock::now() - begin_).count());
  }
  WaitClock(const WaitClock&) = delete;

 private:
  std::atomic<std::uint64_t>& sum_;
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace

BrickPager::BrickPager(const PagedFile& file, PartOf part_of, std::uint64_t budget_bytes,
                       Level0Source* source, const Index3& source_bricks)
    : file_(file),
      part_of_(std::move(part_of)),
      budget_bytes_(budget_bytes),
      source_(source),
      source_bricks_(source_bricks),
      slab_(budget_bytes),
      policy_(budget_bytes) {}

BrickPager::BrickPager(const PagedFile& file, std::vector<Part> parts, std::uint64_t budget_bytes)
    : BrickPager(
          file, [parts = std::move(parts)](std::size_t id) { return parts[id]; }, budget_bytes) {}

BrickPager::~BrickPager() = default;

// A resident part may have lost its pages too.
bool BrickPager::isReachable(std::size_t id) const {
  if (file_.isWhole()) return true;
  return isReached(part_of_(id));
}

const std::byte* BrickPager::acquire(std::size_t id, const CancelFlag* cancel) try {
  if (!isReachable(id)) throw ReadFailure();
  Shard& shard = shardOf(id);
  std::unique_lock lock(shard.mutex);
  const auto found = shard.entries.find(id);
  if (found != shard.entries.end() && found->second->state == State::kResident)
    return take(shard, lock, found->second);
  const WaitClock clock(wait_nanoseconds_);
  if (found != shard.entries.end()) {
    const std::shared_ptr<Entry> joined = found->second;
    ++shard.loads_joined;
    ++joined->users;
    joined->is_used = !std::exchange(joined->is_ahead, false);
    return wait(shard, lock, *joined, cancel);
  }
  const auto entry = std::make_shared<Entry>();
  entry->id = id;
  entry->query = query_;
  shard.entries.emplace(id, entry);
  lock.unlock();
  ++misses_;
  return loadOrLeave(shard, entry, cancel);
} catch (const std::bad_alloc&) {
  throw ReadFailure("cannot be held (no memory is left)");
}

const std::byte* BrickPager::acquireIfResident(std::size_t id) try {
  if (!isReachable(id)) return nullptr;
  Shard& shard = shardOf(id);
  std::unique_lock lock(shard.mutex);
  const auto found = shard.entries.find(id);
  if (found == shard.entries.end() || found->second->state != State::kResident) return nullptr;
  return take(shard, lock, found->second);
} catch (const ReadFailure&) {
  return nullptr;
}

// One that is resident. The lock may be given back.
const std::byte* BrickPager::take(Shard& shard, std::unique_lock<std::mutex>& lock,
                                  const std::shared_ptr<Entry>& slot) {
  ++shard.hits;
  ++slot->users;
  // The first use of what was fetched is what it came for.
  slot->is_used = !std::exchange(slot->is_ahead, false);
  slot->query = query_.load(std::memory_order_relaxed);
  if (!isToBeChecked(*slot)) return dataOf(*slot);
  const std::shared_ptr<Entry> entry = slot;  // NOLINT(performance-*): it stays while it is checked
  lock.unlock();
  return checkAnew(shard, *entry);
}

BrickPager::Fetched BrickPager::fetch(std::size_t id, const CancelFlag* cancel,
                                      const std::shared_ptr<Room>& room) {
  if (!isReachable(id)) return Fetched::kNever;
  const auto entry = std::make_shared<Entry>();
  entry->id = id;
  entry->query = query_;
  entry->is_ahead = true;
  Shard& shard = shardOf(id);
  std::unique_lock lock(shard.mutex);
  const auto [found, is_new] = shard.entries.try_emplace(id, entry);
  const std::shared_ptr<Entry> there = found->second;
  try {
    if (is_new) {
      lock.unlock();
      loadOrLeave(shard, entry, cancel, room);
      ++parts_fetched_;
      release(id);
      return Fetched::kNow;
    }
    if (there->is_ahead) there->query = entry->query;
    if (there->state == State::kResident && isToBeChecked(*there)) {
      ++there->users;
      lock.unlock();
      checkAnew(shard, *there);
      release(id);
    } else if (there->state == State::kLoading && room != nullptr) {
      ++there->users;
      wait(shard, lock, *there, cancel);
      lock.unlock();
      release(id);
    }
    return Fetched::kBefore;
  } catch (const Cancelled&) {
    throw;
  } catch (const NoRoom&) {
    return Fetched::kNoRoom;
  } catch (const std::exception&) {
    return Fetched::kNever;
  }
}

void BrickPager::announce(std::span<const std::size_t> ids) try {
  std::vector<ByteRange> ranges;
  std::vector<Index3> in_source;
  for (const std::size_t id : ids) {
    if (!isAbsent(id)) continue;
    const Part part = part_of_(id);
    if (part.codec == format::Codec::kInSource)
      in_source.push_back(indexAt(static_cast<std::int64_t>(part.offset), source_bricks_));
    else if (!file_.isKept(part.checksum, part.bytes))
      ranges.push_back({part.offset, part.bytes});
  }
  file_.announce(ranges);
  if (!in_source.empty()) source_->bricks().announce(in_source);
} catch (const std::exception&) {  // such as of part_of_: acquire() says so
}

// For a part that is being loaded. The caller is among its users, but not after an exception.
const std::byte* BrickPager::wait(Shard& shard, std::unique_lock<std::mutex>& lock, Entry& entry,
                                  const CancelFlag* cancel) {
  // A signal handler can set the flag and nothing more, so nothing wakes this thread.
  constexpr auto kBetweenLooks = std::chrono::milliseconds(1);
  const auto is_done = [&] { return entry.state != State::kLoading; };
  if (cancel == nullptr) shard.loaded.wait(lock, is_done);
  while (!is_done()) {
    if (cancel->requested()) {
      --entry.users;
      throw Cancelled();
    }
    shard.loaded.wait_for(lock, kBetweenLooks, is_done);
  }
  if (entry.state == State::kFailed) std::rethrow_exception(entry.failure);
  return dataOf(entry);
}

// Loads the caller's part; on another thread if the caller may be cancelled.
const std::byte* BrickPager::loadOrLeave(Shard& shard, const std::shared_ptr<Entry>& entry,
                                         const CancelFlag* cancel,
                                         const std::shared_ptr<Room>& room) {
  const auto leave = [&]() noexcept {
    try {
      return load_threads_.run(
          [this, &shard, entry, room] { loadForOthers(shard, entry, room.get()); });
    } catch (const std::bad_alloc&) {
      return false;
    }
  };
  if (cancel == nullptr || !leave()) return load(shard, entry, room.get());
  std::unique_lock lock(shard.mutex);
  return wait(shard, lock, *entry, cancel);
}

void BrickPager::loadForOthers(Shard& shard, const std::shared_ptr<Entry>& entry,
                               Room* room) noexcept {
  {
    const std::lock_guard lock(shard.mutex);
    if (entry->users == 0) {  // no thread waits any more
      entry->state = State::kFailed;
      shard.entries.erase(entry->id);
      return;
    }
    ++entry->users;
  }
  try {
    load(shard, entry, room);
    release(entry->id);
  } catch (...) {  // the threads that wait throw it
  }
}

// Threads that joined the load wait for its end, and throw what it throws.
const std::byte* BrickPager::load(Shard& shard, const std::shared_ptr<Entry>& entry, Room* room) {
  std::exception_ptr failure;
  bool lacks_room = false;
  try {
    bringIn(*entry, room);
  } catch (const NoRoom&) {
    lacks_room = true;
    failure = std::current_exception();
  } catch (...) {
    failure = std::current_exception();
  }
  if (failure == nullptr) {
    ++parts_read_;
    bytes_read_ += entry->part.bytes;
    bytes_unpacked_ += entry->part.unpacked_bytes;
    const std::lock_guard lock(policy_mutex_);
    policy_.add(*entry);
  }
  {
    const std::lock_guard lock(shard.mutex);
    // A thread has joined that needs the part, and does not ask for room.
    const bool is_needed = lacks_room && !entry->is_ahead;
    if (!is_needed) {
      entry->state = failure == nullptr ? State::kResident : State::kFailed;
      entry->failure = failure;
      if (failure != nullptr) shard.entries.erase(entry->id);
      room = nullptr;
    }
  }
  if (room != nullptr) return load(shard, entry, nullptr);
  shard.loaded.notify_all();
  if (failure != nullptr) std::rethrow_exception(failure);
  return dataOf(*entry);
}

// For a resident part that the caller holds. If its bytes have changed, releases it.
const std::byte* BrickPager::checkAnew(Shard& shard, Entry& entry) {
  const std::uint64_t edition = edition_;
  try {
    checkInPlace(entry.part);
  } catch (const ReadFailure&) {
    release(entry.id);
    throw;
  }
  const std::lock_guard lock(shard.mutex);
  entry.edition = edition;
  return dataOf(entry);
}

std::uint64_t BrickPager::costOf(const Part& part) const {
  if (isPacked(part)) return BufferSlab::runBytes(part.unpacked_bytes);
  return isInPlace(part) ? part.bytes : BufferSlab::runBytes(part.bytes);
}

// The copy of a packed part that checksum and decoder work on.
std::uint64_t BrickPager::copyBytes(const Part& part) {
  return isPacked(part) ? BufferSlab::runBytes(part.bytes) : 0;
}

// The cost is counted if it succeeds, or was set aside in `room`. The pages of other parts go after
// one that is used in place has come: with it, the kernel may map pages around it that they had.
void BrickPager::bringIn(Entry& entry, Room* room) {
  try {
    entry.part = part_of_(entry.id);
  } catch (const Error&) {
    throw ReadFailure("is at an unknown place (its row in the table is damaged)");
  }
  const Part& part = entry.part;
  entry.bytes = costOf(part);
  entry.edition = edition_;
  if (!isReached(part)) throw ReadFailure();
  if (part.codec == format::Codec::kInSource) countSource();
  const bool may_displace = room == nullptr;
  const std::uint64_t copy_bytes = copyBytes(part);
  if (!may_displace && !room->grow(copy_bytes + entry.bytes)) throw NoRoom();
  if (isInPlace(part)) {
    checkInPlace(part);
    if (may_displace)
      makeRoom(entry.bytes);
    else
      room->bytes_ -= entry.bytes;
    trimSlab();
    return;
  }
  if (may_displace) makeRoom(copy_bytes + entry.bytes);
  try {
    entry.buffer = takeBuffer(isPacked(part) ? part.unpacked_bytes : part.bytes, may_displace);
    if (isPacked(part))
      unpackPart(part, entry.buffer.get(), may_displace);
    else
      readPart(part, entry.buffer.get());
  } catch (...) {
    entry.buffer.reset();
    if (may_displace) held_bytes_ -= copy_bytes + entry.bytes;
    throw;
  }
  if (may_displace)
    held_bytes_ -= copy_bytes;
  else
    room->bytes_ -= entry.bytes;
}

void BrickPager::checkInPlace(const Part& part) const {
  if (!isChecksum(file_.checksum(part.offset, part.bytes), part.checksum))
    throw ReadFailure(kWrongChecksum);
}

void BrickPager::countSource() {
  const std::uint64_t bytes = source_->bricks().heldBytes();
  std::call_once(source_is_counted_, [&] { makeRoom(bytes); });
}

void BrickPager::readPart(const Part& part, std::byte* out) const {
  if (part.codec == format::Codec::kInSource) {
    source_->bricks().copySamples(indexAt(static_cast<std::int64_t>(part.offset), source_bricks_),
                                  out);
    if (!isChecksum(checksum64(out, part.bytes), part.checksum))
      throw ReadFailure("are not what they were when '" + file_.path() + "' was built");
    return;
  }
  if (file_.readKept(part.checksum, part.bytes, out)) return;
  file_.read(part.offset, part.bytes, out);
  if (!isChecksum(checksum64(out, part.bytes), part.checksum)) throw ReadFailure(kWrongChecksum);
  file_.keep(part.checksum, part.bytes, out);
}

// Everything is done with a copy: the decoder gets the bytes that the checksum and the checks of
// the Blosc buffer have seen, even while the file is written to.
void BrickPager::unpackPart(const Part& part, std::byte* out, bool may_displace) {
  const PartBuffer packed = takeBuffer(part.bytes, may_displace);
  readPart(part, packed.get());
  if (!decodePart(part.codec, {packed.get(), part.bytes}, part.unpacked_bytes, out))
    throw ReadFailure("is damaged (cannot be unpacked)");
}

void BrickPager::release(std::size_t id) noexcept {
  Shard& shard = shardOf(id);
  {
    const std::lock_guard lock(shard.mutex);
    if (--shard.entries.find(id)->second->users > 0) return;
  }
  if (held_bytes_.load() > budget_bytes_) makeRoom(0);
}

void BrickPager::withdraw(std::size_t id) {
  Shard& shard = shardOf(id);
  const std::lock_guard lock(shard.mutex);
  const auto found = shard.entries.find(id);
  // As if the query before had fetched it.
  if (found != shard.entries.end() && found->second->is_ahead) found->second->query = query_ - 1;
}

std::uint64_t BrickPager::noticeChanges() {
  const std::uint64_t edition = file_.edition();
  std::uint64_t known = edition_;
  while (known < edition && !edition_.compare_exchange_weak(known, edition)) {
  }
  return edition;
}

std::uint64_t BrickPager::beginQuery() {
  const std::lock_guard lock(policy_mutex_);
  policy_.beginQuery();
  return ++query_;
}

bool BrickPager::isAbsent(std::size_t id) {
  Shard& shard = shardOf(id);
  const std::lock_guard lock(shard.mutex);
  return !shard.entries.contains(id);
}

std::shared_ptr<BrickPager::Room> BrickPager::reserve(std::span<const std::size_t> ids,
                                                      std::uint64_t since) {
  std::uint64_t kept_bytes = 0, copy_bytes = 0;  // they come one after the other
  for (const std::size_t id : ids) {
    if (!isAbsent(id)) continue;
    const Part part = part_of_(id);
    kept_bytes += costOf(part);
    copy_bytes = std::max(copy_bytes, copyBytes(part));
  }
  std::shared_ptr<Room> room(new Room(*this, since));
  return room->grow(kept_bytes + copy_bytes) ? room : nullptr;
}

bool BrickPager::Room::grow(std::uint64_t bytes) {
  if (bytes <= bytes_) return true;
  if (!pager_.takeFreeRoom(bytes - bytes_, since_)) return false;
  bytes_ = bytes;
  return true;
}

BrickPager::Counters BrickPager::counters() const {
  Counters sum{.misses = misses_,
               .parts_read = parts_read_,
               .bytes_read = bytes_read_,
               .bytes_unpacked = bytes_unpacked_,
               .parts_released = parts_released_,
               .buffers_beside = buffers_beside_,
               .wait_nanoseconds = wait_nanoseconds_,
               .parts_fetched = parts_fetched_,
               .fetched_unused = fetched_unused_};
  for (const Shard& shard : shards_) {
    const std::lock_guard lock(shard.mutex);
    sum.hits += shard.hits;
    sum.loads_joined += shard.loads_joined;
  }
  return sum;
}

const std::byte* BrickPager::dataOf(const Entry& entry) const {
  return entry.buffer ? entry.buffer.get() : file_.data() + entry.part.offset;
}

// The bytes are counted already. The slab is as long as the budget unless it is capped or was
// refused: so if no run of it is free, it is full of parts that may go, or are in use.
PartBuffer BrickPager::takeBuffer(std::uint64_t bytes, bool may_displace) {
  while (true) {
    if (std::byte* const run = slab_.take(bytes)) return PartBuffer(run, {&slab_});
    if (!may_displace) break;
    const std::uint64_t slab_bytes = slab_.bytes();
    if (slab_bytes < budget_bytes_ || slab_bytes < BufferSlab::runBytes(bytes)) break;
    if (!letGo(takeOneVictim())) break;
  }
  ++buffers_beside_;
  PartBuffer buffer(new (PartBufferDeleter::kAlignment) std::byte[bytes]);
  trimSlab();
  return buffer;
}

// The slab may keep for later as much of the budget as is not held elsewhere.
void BrickPager::trimSlab() {
  const std::uint64_t kept = held_bytes_.load() + slab_.idleBytes();
  const std::uint64_t most = budget_bytes_ + BufferSlab::kHugePageBytes;
  if (most > budget_bytes_ && kept > most) slab_.trim(kept - most);
}

// Counts `bytes` more, and gives back what exceeds the budget then.
void BrickPager::makeRoom(std::uint64_t bytes) { letGo(takeVictims(bytes)); }

// Gives back the pages of this entry and of all that follow; false if there is none.
bool BrickPager::letGo(std::shared_ptr<Entry> leaving) const {
  const bool is_any = leaving != nullptr;
  for (; leaving != nullptr; leaving = std::move(leaving->next_leaving))
    if (isInPlace(leaving->part)) file_.release(leaving->part.offset, leaving->part.bytes);
  return is_any;
}

// Counts `bytes` more if they fit beside what is in use.
bool BrickPager::takeFreeRoom(std::uint64_t bytes, std::uint64_t since) {
  if (bytes > budget_bytes_) return false;
  std::shared_ptr<Entry> leaving;
  bool is_room = false;
  {
    const std::lock_guard lock(policy_mutex_);
    const auto lacks = [&] { return held_bytes_.load() > budget_bytes_ - bytes; };
    policy_.takeWhile(lacks, [&](const ResidencePolicy::Member& member) {
      std::shared_ptr<Entry> taken =
          takeOut(member, [&](const Entry& entry) { return entry.query < since; });
      if (taken == nullptr) return false;
      taken->next_leaving = std::move(leaving);
      leaving = std::move(taken);
      return true;
    });
    is_room = !lacks();
    if (is_room) held_bytes_ += bytes;
  }
  letGo(std::move(leaving));
  return is_room;
}

// The entries that go, each with a pointer to the next.
std::shared_ptr<BrickPager::Entry> BrickPager::takeVictims(std::uint64_t bytes) {
  std::shared_ptr<Entry> leaving;
  const std::lock_guard lock(policy_mutex_);
  held_bytes_ += bytes;
  while (held_bytes_.load() > budget_bytes_) {
    std::shared_ptr<Entry> entry = takeVictim();
    if (entry == nullptr) break;
    entry->next_leaving = std::move(leaving);
    leaving = std::move(entry);
  }
  return leaving;
}

std::shared_ptr<BrickPager::Entry> BrickPager::takeOneVictim() {
  const std::lock_guard lock(policy_mutex_);
  return takeVictim();
}

std::shared_ptr<BrickPager::Entry> BrickPager::takeVictim() {
  std::shared_ptr<Entry> taken;
  policy_.takeVictim([&](ResidencePolicy::Member& member, ResidencePolicy::Which which) {
    using enum ResidencePolicy::Which;
    taken = takeOut(member, [&](Entry& entry) {
      if (which == kAny) return true;
      if (which == kStale) return entry.query + 1 < query_;
      if (entry.is_ahead && entry.query == query_) return false;
      return which == kNotAhead || !std::exchange(entry.is_used, false);
    });
    return taken != nullptr;
  });
  return taken;
}

// Takes a part out of its shard if it is not in use and `may_go` agrees; then no thread can get it.
template <typename MayGo>
std::shared_ptr<BrickPager::Entry> BrickPager::takeOut(const ResidencePolicy::Member& member,
                                                       MayGo&& may_go) {
  Shard& shard = shardOf(member.id);
  const std::lock_guard lock(shard.mutex);
  const auto found = shard.entries.find(member.id);
  Entry& entry = *found->second;
  if (entry.users > 0 || !may_go(entry)) return nullptr;
  if (entry.is_ahead) ++fetched_unused_;
  held_bytes_ -= entry.bytes;
  ++parts_released_;
  std::shared_ptr<Entry> taken = std::move(found->second);
  shard.entries.erase(found);
  return taken;
}

}  // namespace isobrick
