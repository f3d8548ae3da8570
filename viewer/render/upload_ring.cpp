#include "isobrick/viewer/render/upload_ring.h"

#include <algorithm>
#include <cassert>
#include <utility>

namespace isobrick {
namespace {
constexpr std::size_t kPlaceAlignment = 16;
}

std::optional<std::size_t> UploadRing::take(std::size_t bytes) {
  assert(bytes <= bytes_);
  reclaim();
  const auto begin = static_cast<std::size_t>(head_ % bytes_);
  const std::size_t skipped = begin + bytes > bytes_ ? bytes_ - begin : 0;
  const std::size_t whole = (bytes + kPlaceAlignment - 1) / kPlaceAlignment * kPlaceAlignment;
  if (head_ + skipped + bytes - tail_ > bytes_) return std::nullopt;
  const auto place = static_cast<std::size_t>((head_ + skipped) % bytes_);
  head_ += skipped + std::min(whole, bytes_ - place);
  return place;
}

void UploadRing::close(Fence fence) {
  if (!isOpen()) return;
  regions_.push_back({head_, std::move(fence)});
  closed_ = head_;
}

void UploadRing::reclaim() {
  while (!regions_.empty() && regions_.front().fence()) {
    tail_ = regions_.front().end;
    regions_.pop_front();
  }
  // A ring that is all free has no end in the way.
  if (tail_ == head_) head_ = closed_ = tail_ = 0;
}

}  // namespace isobrick
