#include "storage/brick_pager.h"

#include <utility>

namespace isobrick {

BrickPager::BrickPager(const MappedFile& file, std::vector<Piece> pieces,
                       std::uint64_t budget_bytes)
    : file_(file),
      pieces_(std::move(pieces)),
      budget_bytes_(budget_bytes),
      states_(pieces_.size()) {}

const std::byte* BrickPager::acquire(std::size_t id, const char** why) {
  const Piece& piece = pieces_[id];
  static constexpr const char* kUnreadable =
      "cannot be read (the file was cut short or its disk failed)";
  // A resident piece may have lost its pages too.
  if (!file_.reaches(piece.offset, piece.bytes)) {
    *why = kUnreadable;
    return nullptr;
  }
  {
    const std::lock_guard lock(mutex_);
    State& state = states_[id];
    if (state.resident) {
      if (state.users++ == 0) unlink(id);
      return file_.data() + piece.offset;
    }
  }
  // Read outside the lock: other bricks come in at the same time. Two threads that want the same
  // piece at once both check it, which is rare and harmless.
  std::uint64_t checksum = 0;
  if (!file_.checksum(piece.offset, piece.bytes, &checksum)) {
    *why = kUnreadable;
    return nullptr;
  }
  if (checksum != piece.checksum) {
    *why = "is damaged (checksum mismatch)";
    return nullptr;
  }
  const std::lock_guard lock(mutex_);
  State& state = states_[id];
  if (!state.resident) {
    state.resident = true;
    resident_bytes_ += piece.bytes;
    ++counters_.pieces_read;
    counters_.bytes_read += piece.bytes;
  } else if (state.users == 0) {
    unlink(id);
  }
  ++state.users;
  evictOverBudget();
  return file_.data() + piece.offset;
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

void BrickPager::unlink(std::size_t id) {
  const State& state = states_[id];
  (state.newer == kNone ? newest_ : states_[state.newer].older) = state.older;
  (state.older == kNone ? oldest_ : states_[state.older].newer) = state.newer;
}

void BrickPager::evictOverBudget() {
  while (resident_bytes_ > budget_bytes_ && oldest_ != kNone) {
    const std::size_t id = oldest_;
    unlink(id);
    states_[id].resident = false;
    resident_bytes_ -= pieces_[id].bytes;
    ++counters_.pieces_released;
    file_.release(pieces_[id].offset, pieces_[id].bytes);
  }
}

}  // namespace isobrick
