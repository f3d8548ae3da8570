#include "isobrick/viewer/stream/surface_set.h"

#include <algorithm>
#include <glm/common.hpp>
#include <set>
#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {

SurfaceSet::SurfaceSet(ChunkStore& store, ChunkBudget budget)
    : store_(store), budget_(std::move(budget)) {}

SurfaceSet::~SurfaceSet() {
  for (const Chunks* chunks : {&shown_, &incoming_, &leaving_}) {
    for (const Chunk& chunk : chunks->chunks) store_.release(chunk.id);
    budget_.giveBack(chunks->bytes);
  }
}

// If it fails, no part of its request is shown.
void SurfaceSet::accept(StreamMessage message, News& news) {
  const std::uint64_t request = message.request;
  try {
    take(std::move(message), news);
  } catch (...) {
    refused_request_ = request;
    dropIncoming();
    throw;
  }
}

void SurfaceSet::take(StreamMessage message, News& news) {
  switch (message.kind) {
    case StreamMessage::Kind::kChunk:
      if (message.request != refused_request_) acceptChunk(std::move(message), news);
      break;
    case StreamMessage::Kind::kPassDone:
      if (message.request == refused_request_) return;
      if (!hasAllOf(message)) {
        dropIncoming();
        news.stale = true;
        return;
      }
      news.passes.reserve(news.passes.size() + 1);
      show(message);
      error_.clear();
      news.shows_another = true;
      news.passes.push_back(std::move(message));
      break;
    case StreamMessage::Kind::kFailed:
      error_ = std::move(message.error);
      news.failed = true;
      dropIncoming();
      break;
    case StreamMessage::Kind::kDropped:
      if (message.no_room) return refuse(message.request, news);
      dropIncoming();
      if (message.too_many) news.passes.push_back(std::move(message));
      break;
  }
}

void SurfaceSet::acceptChunk(StreamMessage message, News& news) {
  SurfaceChunk& chunk = message.chunk;
  const std::uint64_t bytes = chunk.bytes();
  if (!budget_.hasRoomFor(bytes)) return refuse(message.request, news);
  Chunks made;
  made.chunks.push_back({0, chunk.surface, bytes, chunk.key, chunk.origin + glm::dvec3(chunk.lower),
                         chunk.origin + glm::dvec3(chunk.upper)});
  made.bytes = bytes;
  ChunkId id = 0;
  try {
    id = store_.reserve(chunk);
  } catch (const NoGraphicsMemory&) {
    // The card has less room than the budget allows at this moment: others use it too. The next
    // request may fit again.
    return refuse(message.request, news);
  } catch (const RendererLost&) {
    throw;
  } catch (const Error& error) {
    return fail(message.request, error.what(), news);
  }
  made.chunks.front().id = id;
  budget_.take(bytes);
  incoming_.takeAll(made);
  if (bytes > 0) pending_ = Pending{id, std::move(chunk)};
}

// False: the renderer takes no more in this frame.
bool SurfaceSet::uploadPiece(UploadAllowance& allowance) {
  const auto whole = static_cast<std::size_t>(pending_->chunk.bytes());
  const std::size_t bytes = std::min(
      {kPieceBytes, whole - pending_->uploaded, static_cast<std::size_t>(allowance.bytes)});
  if (!store_.uploadPiece(pending_->id, pending_->chunk, pending_->uploaded, bytes)) return false;
  allowance.bytes -= bytes;
  pending_->uploaded += bytes;
  if (pending_->uploaded == whole) pending_.reset();
  return true;
}

// For the chunks that the pass keeps or reuses.
bool SurfaceSet::hasAllOf(const StreamMessage& pass) const {
  std::set<ChunkKey> keys;
  if (!pass.reused.empty())
    for (const Chunk& chunk : shown_.chunks)
      if (chunk.key) keys.insert(*chunk.key);
  return std::all_of(pass.kept.begin(), pass.kept.end(),
                     [&](const auto& kept) { return contentOf(kept.surface) == kept.content; }) &&
         std::all_of(pass.reused.begin(), pass.reused.end(),
                     [&](const ChunkKey& key) { return keys.count(key) != 0; });
}

void SurfaceSet::show(const StreamMessage& pass) {
  const std::set<ChunkKey> reused(pass.reused.begin(), pass.reused.end());
  std::map<int, std::uint64_t> contents;
  for (const StreamPass::KeptSurface& kept : pass.kept) contents[kept.surface] = kept.content;
  const auto kept = [&, of = contents](const Chunk& chunk) {
    return of.count(chunk.surface) != 0 || (chunk.key && reused.count(*chunk.key) != 0);
  };
  for (const StreamedSurface& made : pass.surfaces) contents[made.surface] = ++last_content_;
  for (auto chunk = shown_.chunks.begin(); chunk != shown_.chunks.end();)
    chunk = (kept(*chunk) ? incoming_ : leaving_).take(shown_, chunk);
  shown_.takeAll(incoming_);
  contents_ = std::move(contents);
}

std::optional<std::array<glm::dvec3, 2>> SurfaceSet::shownBox() const {
  if (shown_.chunks.empty()) return std::nullopt;
  std::array<glm::dvec3, 2> box{shown_.chunks.front().lower, shown_.chunks.front().upper};
  for (const Chunk& chunk : shown_.chunks)
    box = {glm::min(box[0], chunk.lower), glm::max(box[1], chunk.upper)};
  return box;
}

std::vector<ChunkId> SurfaceSet::shown() const {
  std::vector<ChunkId> ids;
  ids.reserve(shown_.chunks.size());
  for (const Chunk& chunk : shown_.chunks) ids.push_back(chunk.id);
  return ids;
}

std::uint64_t SurfaceSet::contentOf(int surface) const {
  const auto found = contents_.find(surface);
  return found == contents_.end() ? 0 : found->second;
}

void SurfaceSet::refuse(std::uint64_t request, News& news) {
  dropIncoming();
  refused_request_ = request;
  used_by_others_ = usedByOthers();
  news.over_budget = true;
}

void SurfaceSet::fail(std::uint64_t request, std::string error, News& news) {
  dropIncoming();
  refused_request_ = request;
  error_ = std::move(error);
  news.failed = true;
}

void SurfaceSet::dropIncoming() noexcept {
  leaving_.takeAll(incoming_);
  pending_.reset();
}

// As many as there are looks at the clock for: one release takes about a microsecond.
void SurfaceSet::releaseSome() {
  constexpr std::size_t kAtOnce = 16;
  for (std::size_t i = 0; i < kAtOnce && !leaving_.chunks.empty(); ++i) {
    store_.release(leaving_.chunks.back().id);
    leaving_.bytes -= leaving_.chunks.back().bytes;
    budget_.giveBack(leaving_.chunks.back().bytes);
    leaving_.chunks.pop_back();
  }
}

}  // namespace isobrick
