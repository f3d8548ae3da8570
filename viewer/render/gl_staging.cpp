#include "isobrick/viewer/render/gl_staging.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <memory>
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

namespace {
// The most bytes that one frame uploads.
constexpr std::size_t kStagingBytes = std::size_t{16} << 20;
}  // namespace

GlStaging::GlStaging() : buffer_(GlBuffer::make()), ring_(kStagingBytes) {
  constexpr GLbitfield kAccess = GL_MAP_WRITE_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT;
  glNamedBufferStorage(*buffer_, kStagingBytes, nullptr, kAccess);
  map_ = static_cast<std::byte*>(glMapNamedBufferRange(*buffer_, 0, kStagingBytes, kAccess));
  while (glGetError() != GL_NO_ERROR) {
  }
}

bool GlStaging::copy(const void* data, std::size_t bytes, GLuint buffer, std::size_t offset) {
  const std::optional<std::size_t> place = ring_.take(bytes);
  if (!place) return false;
  std::memcpy(map_ + *place, data, bytes);
  glCopyNamedBufferSubData(*buffer_, buffer, static_cast<GLintptr>(*place),
                           static_cast<GLintptr>(offset), static_cast<GLsizeiptr>(bytes));
  return true;
}

void GlStaging::endFrame() {
  if (!ring_.isOpen()) return;
  const auto fence = std::make_shared<GlFence>(GlFence::make());
  ring_.close([fence] { return fence->isPassed(); });
}

}  // namespace isobrick
