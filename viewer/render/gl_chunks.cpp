#include "isobrick/viewer/render/gl_chunks.h"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstring>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {

FreeRuns::FreeRuns(std::size_t units) : units_(units), free_(units) {
  if (units > 0) runs_.push_back({0, units});
}

std::optional<std::size_t> FreeRuns::take(std::size_t units) {
  assert(units > 0);
  auto best = runs_.end();
  for (auto run = runs_.begin(); run != runs_.end(); ++run)
    if (run->units >= units && (best == runs_.end() || run->units < best->units)) best = run;
  if (best == runs_.end()) return std::nullopt;
  const auto at = best - runs_.begin();
  if (const std::size_t most = handed_out_ + 2; runs_.capacity() < most) runs_.reserve(2 * most);
  Run& run = runs_[static_cast<std::size_t>(at)];
  const std::size_t begin = run.begin;
  run.begin += units;
  run.units -= units;
  if (run.units == 0) runs_.erase(runs_.begin() + at);
  ++handed_out_;
  free_ -= units;
  return begin;
}

void FreeRuns::give(std::size_t begin, std::size_t units) noexcept {
  assert(units > 0 && begin + units <= units_ && handed_out_ > 0);
  --handed_out_;
  free_ += units;
  const auto after = std::ranges::lower_bound(runs_, begin, {}, &Run::begin);
  const bool joins_after = after != runs_.end() && after->begin == begin + units;
  assert(after == runs_.end() || after->begin >= begin + units);
  const auto before = after == runs_.begin() ? runs_.end() : std::prev(after);
  assert(before == runs_.end() || before->end() <= begin);
  if (before != runs_.end() && before->end() == begin) {
    before->units += units;
    if (!joins_after) return;
    before->units += after->units;
    runs_.erase(after);
  } else if (joins_after) {
    after->begin = begin;
    after->units += units;
  } else {
    runs_.insert(after, {begin, units});
  }
}

namespace {

constexpr std::size_t kLeastBytes = std::size_t{4} << 20;
constexpr std::size_t kMostBytes = std::size_t{32} << 20;

constexpr std::size_t kPlaceAlignment = 16;
}  // namespace

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

GlArenas::Place GlArenas::take(std::size_t bytes, GlDevice& device) {
  const std::size_t units = (bytes + kUnitBytes - 1) / kUnitBytes;
  if (units == 0) return {};
  const auto takeFrom = [&](std::size_t arena) -> std::optional<Place> {
    if (!arenas_[arena]) return std::nullopt;
    const auto begin = arenas_[arena]->runs.take(units);
    if (!begin) return std::nullopt;
    free_ -= units;
    return Place{arena, *begin, units};
  };
  for (std::size_t arena = 0; arena < arenas_.size(); ++arena)
    if (const auto place = takeFrom(arena)) return *place;
  const std::size_t wanted = std::max(
      units,
      device.limits().arenaBytes(std::clamp(this->bytes(), kLeastBytes, kMostBytes)) / kUnitBytes);
  // A card that is nearly full may have room for this one chunk.
  std::size_t arena = 0;
  try {
    arena = addArena(wanted, device);
  } catch (const NoGraphicsMemory&) {
    if (wanted == units) throw;
    arena = addArena(units, device);
  }
  return *takeFrom(arena);
}

std::size_t GlArenas::addArena(std::size_t units, GlDevice& device) {
  auto made = std::make_unique<Arena>(Arena{GlBuffer::make(), FreeRuns(units)});
  const std::size_t bytes = units * kUnitBytes;
  device.forgetErrors();
  glNamedBufferStorage(*made->buffer, static_cast<GLsizeiptr>(bytes), nullptr,
                       GL_DYNAMIC_STORAGE_BIT);
  device.checkErrors("cannot keep " + std::to_string(bytes) + " bytes of a surface: " +
                     device.name() + " has no memory left; ask for a smaller radius");
  units_ += units;
  free_ += units;
  const auto empty = std::find(arenas_.begin(), arenas_.end(), nullptr);
  const auto at = static_cast<std::size_t>(empty - arenas_.begin());
  if (empty == arenas_.end()) arenas_.emplace_back();
  arenas_[at] = std::move(made);
  return at;
}

void GlArenas::give(const Place& place) noexcept {
  if (place.units == 0) return;
  Arena& arena = *arenas_[place.arena];
  arena.runs.give(place.begin, place.units);
  free_ += place.units;
  const std::size_t units = arena.runs.units();
  if (!arena.runs.isAllFree() || free_ - units < units) return;
  units_ -= units;
  free_ -= units;
  arenas_[place.arena].reset();
}

std::size_t GlArenas::greatestBytes() const {
  std::size_t greatest = 0;
  for (const auto& arena : arenas_)
    if (arena) greatest = std::max(greatest, arena->runs.units() * kUnitBytes);
  return greatest;
}

std::size_t GlArenas::count() const {
  return static_cast<std::size_t>(
      std::count_if(arenas_.begin(), arenas_.end(), [](const auto& arena) { return !!arena; }));
}

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

GlChunks::GlChunks(GlDevice& device, bool staged) : device_(device) {
  if (staged) staging_.emplace();
  if (staging_ && !staging_->isThere()) staging_.reset();
}

ChunkId GlChunks::reserve(const SurfaceChunk& chunk) {
  KeptChunk kept;
  kept.bytes = chunk.bytes();
  kept.vertices = static_cast<std::uint32_t>(chunk.vertices.size());
  kept.indices = static_cast<std::uint32_t>(chunk.triangles.size());
  kept.transition_indices = static_cast<std::uint32_t>(chunk.transition_indices);
  kept.origin = chunk.origin;
  kept.lower = chunk.origin + glm::dvec3(chunk.lower);
  kept.upper = chunk.origin + glm::dvec3(chunk.upper);
  kept.level = chunk.level;
  kept.surface = chunk.surface;
  device_.forgetErrors();  // throws after a loss
  kept.place = arenas_.take(static_cast<std::size_t>(kept.bytes), device_);
  bytes_kept_ += kept.bytes;
  chunks_.emplace(++last_, kept);
  return last_;
}

// Bytes of a chunk as runs in memory: f(first byte, offset from the chunk's first, count), until it
// is false.
template <typename F>
bool GlChunks::forParts(const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes, F&& f) {
  const std::size_t vertex_bytes = chunk.vertices.size() * sizeof(SurfaceVertex);
  const std::size_t end = begin + bytes;
  const auto* const vertices = reinterpret_cast<const std::byte*>(chunk.vertices.data());
  const auto* const triangles = reinterpret_cast<const std::byte*>(chunk.triangles.data());
  if (begin < vertex_bytes && !f(vertices + begin, begin, std::min(end, vertex_bytes) - begin))
    return false;
  const std::size_t first = std::max(begin, vertex_bytes);
  return first >= end || f(triangles + (first - vertex_bytes), first, end - first);
}

void GlChunks::fill(const KeptChunk& kept, const SurfaceChunk& chunk, std::size_t begin,
                    std::size_t bytes) {
  const GLuint buffer = arenas_.buffer(kept.place.arena);
  const std::size_t first = kept.place.firstByte();
  forParts(chunk, begin, bytes, [&](const std::byte* data, std::size_t offset, std::size_t count) {
    const auto to = static_cast<GLintptr>(first + offset);
    const auto size = static_cast<GLsizeiptr>(count);
    if (staging_) {  // a card takes a third of the time for a buffer of its own and a copy of it
      const GlBuffer copied = GlBuffer::make();
      glNamedBufferStorage(*copied, size, data, 0);
      glCopyNamedBufferSubData(*copied, buffer, 0, to, size);
    } else {
      glNamedBufferSubData(buffer, to, size, data);
    }
    return true;
  });
}

bool GlChunks::uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                           std::size_t bytes) {
  const KeptChunk& kept = chunks_.at(id);
  if (!staging_) {
    fill(kept, chunk, begin, bytes);
    return true;
  }
  // If the second of two parts finds no room, the first comes again.
  const GLuint buffer = arenas_.buffer(kept.place.arena);
  const std::size_t first = kept.place.firstByte();
  return forParts(chunk, begin, bytes,
                  [&](const std::byte* data, std::size_t offset, std::size_t count) {
                    return staging_->copy(data, count, buffer, first + offset);
                  });
}

void GlChunks::endUploads() {
  if (staging_) staging_->endFrame();
}

ChunkId GlChunks::upload(const SurfaceChunk& chunk) {
  const ChunkId id = reserve(chunk);
  fill(chunks_.at(id), chunk, 0, static_cast<std::size_t>(chunk.bytes()));
  return id;
}

void GlChunks::release(ChunkId chunk) noexcept {
  const auto found = chunks_.find(chunk);
  assert(found != chunks_.end());
  bytes_kept_ -= found->second.bytes;
  arenas_.give(found->second.place);
  chunks_.erase(found);
}

SurfaceChunk GlChunks::download(ChunkId id) const {
  const KeptChunk& kept = chunks_.at(id);
  SurfaceChunk chunk;
  chunk.origin = kept.origin;
  chunk.lower = glm::vec3(kept.lower - kept.origin);
  chunk.upper = glm::vec3(kept.upper - kept.origin);
  chunk.level = kept.level;
  chunk.surface = kept.surface;
  chunk.transition_indices = kept.transition_indices;
  chunk.vertices.resize(kept.vertices);
  chunk.triangles.resize(kept.indices);
  if (kept.bytes == 0) return chunk;
  const GLuint buffer = arenas_.buffer(kept.place.arena);
  const std::size_t first = kept.place.firstByte(), vertex_bytes = kept.vertexBytes();
  glGetNamedBufferSubData(buffer, static_cast<GLintptr>(first),
                          static_cast<GLsizeiptr>(vertex_bytes), chunk.vertices.data());
  glGetNamedBufferSubData(buffer, static_cast<GLintptr>(first + vertex_bytes),
                          static_cast<GLsizeiptr>(kept.bytes - vertex_bytes),
                          chunk.triangles.data());
  return chunk;
}

}  // namespace isobrick
