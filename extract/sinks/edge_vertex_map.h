// A hash table from edges to vertex numbers.
#pragma once

#include <optional>
#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Open addressing with linear probing; grows by doubling. Clearing keeps the memory and walks
// through all of it, so one object serves brick after brick. VertexNumbering looks up every shared
// vertex; std::unordered_map would allocate a node for each.
template <typename Number>
class EdgeVertexMap {
 public:
  EdgeVertexMap() : slots_(kLeastSlots) {}

  // The number of `key`, valid until the next insertion or removal; if it has none yet, `number` is
  // stored and `*inserted` set.
  Number& findOrInsert(EdgeKey key, Number number, bool* inserted) {
    if (2 * (size_ + 1) > slots_.size()) grow();
    Slot& slot = slots_[slotOf(key)];
    *inserted = slot.key == kNoEdge;
    if (*inserted) {
      slot = {key, number};
      ++size_;
    }
    return slot.number;
  }

  // Null if the key has no number. Valid until the next insertion or removal.
  const Number* find(EdgeKey key) const {
    const Slot& slot = slots_[slotOf(key)];
    return slot.key == kNoEdge ? nullptr : &slot.number;
  }
  // A key that has a number.
  void erase(EdgeKey key) {
    const std::size_t mask = slots_.size() - 1;
    std::size_t hole = slotOf(key);
    // Displaced keys beyond the hole move up, so that every key is found from its own slot on.
    for (std::size_t at = (hole + 1) & mask; slots_[at].key != kNoEdge; at = (at + 1) & mask)
      if (((at - firstSlotOf(slots_[at].key)) & mask) >= ((at - hole) & mask)) {
        slots_[hole] = slots_[at];
        hole = at;
      }
    slots_[hole] = Slot{};
    --size_;
  }
  // A key that has no number yet, or this one.
  void insert(EdgeKey key, Number number) {
    bool inserted = false;
    findOrInsert(key, number, &inserted);
  }

  void clear() {
    if (size_ == 0) return;
    slots_.assign(slots_.size(), Slot{});
    size_ = 0;
  }
  std::size_t size() const { return size_; }

 private:
  static constexpr std::size_t kLeastSlots = 1024;
  struct Slot {
    EdgeKey key = kNoEdge;
    Number number = 0;
  };

  std::size_t firstSlotOf(EdgeKey key) const {
    // Fibonacci hashing: neighbouring edges differ in few low bits.
    return static_cast<std::size_t>((key * 0x9E3779B97F4A7C15ull) >> 20) & (slots_.size() - 1);
  }
  std::size_t slotOf(EdgeKey key) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t at = firstSlotOf(key);
    while (slots_[at].key != key && slots_[at].key != kNoEdge) at = (at + 1) & mask;
    return at;
  }
  void grow() {
    std::vector<Slot> old(2 * slots_.size());
    old.swap(slots_);
    for (const Slot& slot : old)
      if (slot.key != kNoEdge) slots_[slotOf(slot.key)] = slot;
  }

  std::vector<Slot> slots_;
  std::size_t size_ = 0;
};

// The vertices that several batches list. A vertex whose batches are known is forgotten with the
// last of them, so that of a large mesh only its front is held.
class SharedVertexMap {
 public:
  // The value that the vertex was first met with. None if this is the first time: then `value`,
  // below 2^56, is remembered.
  std::optional<std::uint64_t> meet(const MeshBatch::SharedVertex& vertex, std::uint64_t value) {
    const std::uint64_t batches_left = vertex.batches == 0 ? kNever : vertex.batches - 1u;
    bool inserted = false;
    std::uint64_t& entry =
        entries_.findOrInsert(vertex.key, value | batches_left << kValueBits, &inserted);
    if (inserted) return std::nullopt;
    const std::uint64_t first = entry & ((std::uint64_t{1} << kValueBits) - 1);
    if (entry >> kValueBits == 1)
      entries_.erase(vertex.key);
    else if (entry >> kValueBits != kNever)
      entry -= std::uint64_t{1} << kValueBits;
    return first;
  }
  void clear() { entries_.clear(); }
  std::size_t size() const { return entries_.size(); }

 private:
  // A value and, above it, how many batches are still to list the vertex.
  static constexpr int kValueBits = 56;
  static constexpr std::uint64_t kNever = 255;  // forgotten

  EdgeVertexMap<std::uint64_t> entries_;
};

}  // namespace isobrick
