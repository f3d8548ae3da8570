#include "isobrick/storage/brick_pager.h"

#include <bit>
#include <utility>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/checksum.h"

namespace isobrick {
namespace {

constexpr const char* kUnreadable = "cannot be read (the file was cut short or its disk failed)";
constexpr const char* kWrongChecksum = "is damaged (checksum mismatch)";
constexpr const char* kNotPacked = "is damaged (cannot be unpacked)";

// Bricks at the border are a little smaller than the others: with eight sizes for each power of two
// one's buffer serves the next.
std::uint32_t bufferBytes(std::uint32_t bytes) {
  const std::uint32_t step = std::bit_floor(bytes | 512u) / 8;
  return (bytes + step - 1) / step * step;
}

}  // namespace

BrickPager::BrickPager(const MappedFile& file, std::vector<Piece> pieces,
                       std::uint64_t budget_bytes)
    : file_(file),
      pieces_(std::move(pieces)),
      budget_bytes_(budget_bytes),
      states_(pieces_.size()) {}

const std::byte* BrickPager::acquire(std::size_t id, const char** why) {
  const Piece& piece = pieces_[id];
  // A resident piece may have lost its pages too.
  if (!file_.reaches(piece.offset, piece.bytes)) {
    *why = kUnreadable;
    return nullptr;
  }
  if (const std::byte* data = holdResident(id)) return data;
  return piece.codec == format::Codec::kStored ? bringInStored(id, why) : bringInPacked(id, why);
}

const std::byte* BrickPager::holdResident(std::size_t id) {
  const std::lock_guard lock(mutex_);
  return states_[id].resident ? addUser(id) : nullptr;
}

// Two threads that want the same piece at once both read (and unpack) it, which is rare and
// harmless: the second finds it resident.
const std::byte* BrickPager::bringInStored(std::size_t id, const char** why) {
  const Piece& piece = pieces_[id];
  std::uint64_t checksum = 0;
  const bool is_read = file_.checksum(piece.offset, piece.bytes, &checksum);
  if (!is_read || checksum != piece.checksum) {
    *why = is_read ? kWrongChecksum : kUnreadable;
    return nullptr;
  }
  const std::lock_guard lock(mutex_);
  if (states_[id].resident) return addUser(id);
  held_bytes_ += piece.bytes;
  return makeResident(id, {});
}

const std::byte* BrickPager::bringInPacked(std::size_t id, const char** why) {
  const Piece& piece = pieces_[id];
  Buffer buffer;
  {
    const std::lock_guard lock(mutex_);
    buffer = makeRoom(piece);
  }
  const bool is_good = unpackPiece(piece, buffer.data.get(), why);
  const std::lock_guard lock(mutex_);
  held_bytes_ -= piece.bytes;
  if (is_good && !states_[id].resident) return makeResident(id, std::move(buffer));
  held_bytes_ -= buffer.bytes;
  return is_good ? addUser(id) : nullptr;
}

// Everything is done with a copy: what the checksum and the checks of the Blosc buffer have seen is
// what the decoder gets, even while somebody writes to the file.
bool BrickPager::unpackPiece(const Piece& piece, std::byte* out, const char** why) const {
  const auto packed = std::make_unique_for_overwrite<std::byte[]>(piece.bytes);
  *why = kUnreadable;
  if (!file_.read(piece.offset, piece.bytes, packed.get())) return false;
  *why = kWrongChecksum;
  if (checksum64(packed.get(), piece.bytes) != piece.checksum) return false;
  *why = kNotPacked;
  return decodePart(piece.codec, {packed.get(), piece.bytes}, piece.unpacked_bytes, out);
}

void BrickPager::release(std::size_t id) noexcept {
  const std::lock_guard lock(mutex_);
  State& state = states_[id];
  if (--state.users > 0) return;
  state.older = newest_;
  state.newer = kNone;
  (newest_ == kNone ? oldest_ : states_[newest_].newer) = static_cast<std::uint32_t>(id);
  newest_ = static_cast<std::uint32_t>(id);
  evictOverBudget();
}

BrickPager::Counters BrickPager::counters() const {
  const std::lock_guard lock(mutex_);
  return counters_;
}

std::uint64_t BrickPager::heldBytes() const {
  const std::lock_guard lock(mutex_);
  return held_bytes_;
}

const std::byte* BrickPager::dataOf(std::size_t id) const {
  const State& state = states_[id];
  return state.unpacked.data ? state.unpacked.data.get() : file_.data() + pieces_[id].offset;
}

const std::byte* BrickPager::addUser(std::size_t id) {
  if (states_[id].users++ == 0) unlink(id);
  return dataOf(id);
}

// With one user. What it costs was counted before.
const std::byte* BrickPager::makeResident(std::size_t id, Buffer unpacked) {
  const Piece& piece = pieces_[id];
  State& state = states_[id];
  state.resident = true;
  state.users = 1;
  state.unpacked = std::move(unpacked);
  ++counters_.pieces_read;
  counters_.bytes_read += piece.bytes;
  if (state.unpacked.data) counters_.bytes_unpacked += piece.unpacked_bytes;
  evictOverBudget();
  return dataOf(id);
}

// A buffer for the piece; it and the copy of the packed bytes are counted. The oldest pieces go
// before it is made, so that one of theirs can serve.
BrickPager::Buffer BrickPager::makeRoom(const Piece& piece) {
  const std::uint32_t wanted = bufferBytes(piece.unpacked_bytes);
  Buffer buffer;
  while (held_bytes_ + piece.bytes + wanted > budget_bytes_ && oldest_ != kNone) {
    Buffer evicted = evictOldest();
    if (evicted.bytes == wanted) buffer = std::move(evicted);
  }
  if (buffer.data)
    ++counters_.buffers_reused;
  else
    buffer.data.reset(new (kBufferAlignment) std::byte[wanted]);
  buffer.bytes = wanted;
  held_bytes_ += piece.bytes + wanted;
  return buffer;
}

BrickPager::Buffer BrickPager::evictOldest() {
  const std::size_t id = oldest_;
  State& state = states_[id];
  unlink(id);
  state.resident = false;
  ++counters_.pieces_released;
  if (!state.unpacked.data) {
    held_bytes_ -= pieces_[id].bytes;
    file_.release(pieces_[id].offset, pieces_[id].bytes);
    return {};
  }
  held_bytes_ -= state.unpacked.bytes;
  return std::exchange(state.unpacked, {});
}

void BrickPager::evictOverBudget() {
  while (held_bytes_ > budget_bytes_ && oldest_ != kNone) evictOldest();
}

void BrickPager::unlink(std::size_t id) {
  const State& state = states_[id];
  (state.newer == kNone ? newest_ : states_[state.newer].older) = state.older;
  (state.older == kNone ? oldest_ : states_[state.older].newer) = state.newer;
}

}  // namespace isobrick
