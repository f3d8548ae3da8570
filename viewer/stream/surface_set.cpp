#include "isobrick/viewer/stream/surface_set.h"

#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {

SurfaceSet::SurfaceSet(SceneRenderer& renderer, std::uint64_t budget_bytes)
    : renderer_(renderer), budget_bytes_(budget_bytes) {}

SurfaceSet::~SurfaceSet() {
  release(shown_);
  release(incoming_);
}

void SurfaceSet::accept(StreamMessage message, News& news) {
  switch (message.kind) {
    case StreamMessage::Kind::kChunk: {
      if (message.request == refused_request_) return;
      const std::uint64_t bytes = message.chunk.bytes();
      if (shown_.bytes + incoming_.bytes + bytes > budget_bytes_)
        return refuse(message.request, news);
      try {
        incoming_.chunks.push_back(renderer_.upload(message.chunk));
      } catch (const Error&) {
        // The card has less room than the budget allows, and others use it.
        budget_bytes_ = shown_.bytes + incoming_.bytes + bytes - 1;
        return refuse(message.request, news);
      }
      incoming_.bytes += bytes;
      news.uploaded_bytes += bytes;
      break;
    }
    case StreamMessage::Kind::kPassDone:
      if (message.request == refused_request_) return;
      std::swap(shown_, incoming_);
      release(incoming_);
      error_.clear();
      news.shows_another = true;
      news.passes.push_back(std::move(message));
      break;
    case StreamMessage::Kind::kFailed:
      error_ = std::move(message.error);
      news.failed = true;
      release(incoming_);
      break;
    case StreamMessage::Kind::kDropped:
      release(incoming_);
      break;
  }
}

void SurfaceSet::refuse(std::uint64_t request, News& news) {
  release(incoming_);
  refused_request_ = request;
  news.over_budget = true;
}

void SurfaceSet::release(Chunks& chunks) {
  for (const ChunkId chunk : chunks.chunks) renderer_.release(chunk);
  chunks = {};
}

}  // namespace isobrick
