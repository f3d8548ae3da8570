// The chunks that are shown, and those that will replace them: never a half surface.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/surface_stream.h"

namespace isobrick {

// The allowance of one frame for uploads.
inline constexpr double kUploadSeconds = 0.002;
inline constexpr std::uint64_t kUploadBytes = std::uint64_t{16} << 20;

// The rest of it, for all uploads of a frame, however many calls there are.
struct UploadAllowance {
  double seconds = kUploadSeconds;
  std::uint64_t bytes = kUploadBytes;

  bool isSpent() const { return seconds <= 0.0 || bytes == 0; }
  void take(std::uint64_t uploaded_bytes, double took_seconds) {
    bytes -= std::min(bytes, uploaded_bytes);
    seconds -= took_seconds;
  }
  // A frame that waits lasts longer: an eighth of its wait, as of 16 ms, is for uploads again.
  void addWaited(double waited) {
    seconds = std::min(kUploadSeconds, std::max(seconds, 0.0) + waited / 8.0);
  }
};

// The bytes of chunks that several sets may hold together: copies count as one. For the renderer's
// thread.
class ChunkBudget {
 public:
  ChunkBudget(std::uint64_t most) : most_(most) {}

  std::uint64_t most() const { return most_; }
  std::uint64_t used() const { return *used_; }
  bool hasRoomFor(std::uint64_t bytes) const { return *used_ + bytes <= most_; }
  void take(std::uint64_t bytes) noexcept { *used_ += bytes; }
  void giveBack(std::uint64_t bytes) noexcept { *used_ -= bytes; }

 private:
  std::uint64_t most_;
  std::shared_ptr<std::uint64_t> used_ = std::make_shared<std::uint64_t>(0);
};

// Uploads the chunks of a pass as they come, and shows them when all of them are there; the chunks
// shown before go then, a frame's share at a time. Used by the renderer's thread, which outlives
// it.
class SurfaceSet {
 public:
  SurfaceSet(ChunkStore& store, ChunkBudget budget);
  ~SurfaceSet();
  SurfaceSet(const SurfaceSet&) = delete;
  SurfaceSet& operator=(const SurfaceSet&) = delete;

  struct News {
    bool shows_another = false;  // a pass was completed
    bool over_budget = false;    // the current pass does not fit, here or on the card: dropped
    bool failed = false;         // see error()
    bool stale = false;          // a pass keeps chunks that are not shown, and was dropped
    // Passes that were completed, and passes that had too many triangles, without chunks.
    std::vector<StreamMessage> passes;
  };
  // Takes messages, and the chunks in them piece by piece, until there are none, the renderer takes
  // no more, or the time (`clock()`, seconds) or the bytes of `allowance`, from which they are
  // taken, are spent; if only the time is spent, takes at least one piece, so that a slow machine
  // comes to an end too. The rest of a chunk comes in the next frame.
  template <typename Poll, typename Clock>
  News pump(Poll&& poll, Clock&& clock, UploadAllowance& allowance) {
    News news;
    double last = clock();
    while (allowance.bytes > 0) {
      if (!leaving_.chunks.empty()) {
        releaseSome();
      } else if (pending_) {
        if (!uploadPiece(allowance)) break;
      } else if (auto message = poll()) {
        accept(std::move(*message), news);
      } else {
        break;
      }
      const double now = clock();
      allowance.seconds -= now - std::exchange(last, now);
      if (allowance.isSpent()) break;
    }
    store_.endUploads();
    return news;
  }

  std::vector<ChunkId> shown() const;
  // The least box around what is shown, in the scene's lattice; none if that is nothing.
  std::optional<std::array<glm::dvec3, 2>> shownBox() const;
  // A number for the shown chunks of a surface, which changes whenever a pass replaces them; 0:
  // none.
  std::uint64_t contentOf(int surface) const;
  std::uint64_t shownBytes() const { return shown_.bytes; }
  std::uint64_t incomingBytes() const { return incoming_.bytes; }
  // True while chunks that are shown no longer have not been released.
  bool isReleasing() const { return !leaving_.chunks.empty(); }
  // Others gave back bytes of the budget since a pass did not fit into it.
  bool hasMoreRoom() const { return usedByOthers() < used_by_others_; }
  const std::string& error() const { return error_; }

 private:
  struct Chunk {
    ChunkId id = 0;
    int surface = 0;
    std::uint64_t bytes = 0;
    std::optional<ChunkKey> key = {};
    glm::dvec3 lower{0.0}, upper{0.0};  // in the scene's lattice
  };
  // A chunk is in one of these at any moment, so that it is released once: moving one from here to
  // there takes no memory, which might not be there.
  struct Chunks {
    std::list<Chunk> chunks;
    std::uint64_t bytes = 0;

    // Takes one of `from`, or all; returns the one after it.
    std::list<Chunk>::iterator take(Chunks& from, std::list<Chunk>::iterator chunk) noexcept {
      const auto next = std::next(chunk);
      from.bytes -= chunk->bytes;
      bytes += chunk->bytes;
      chunks.splice(chunks.end(), from.chunks, chunk);
      return next;
    }
    void takeAll(Chunks& from) noexcept {
      bytes += std::exchange(from.bytes, 0);
      chunks.splice(chunks.end(), from.chunks);
    }
  };
  struct Pending {
    ChunkId id = 0;
    SurfaceChunk chunk;
    std::size_t uploaded = 0;  // bytes
  };
  void accept(StreamMessage message, News& news);
  void take(StreamMessage message, News& news);
  void acceptChunk(StreamMessage message, News& news);
  bool uploadPiece(UploadAllowance& allowance);
  bool hasAllOf(const StreamMessage& pass) const;
  void show(const StreamMessage& pass);
  void refuse(std::uint64_t request, News& news);
  void fail(std::uint64_t request, std::string error, News& news);
  void dropIncoming() noexcept;
  void releaseSome();
  std::uint64_t usedByOthers() const {
    return budget_.used() - shown_.bytes - incoming_.bytes - leaving_.bytes;
  }

  ChunkStore& store_;
  ChunkBudget budget_;
  std::uint64_t used_by_others_ = 0;  // when a pass last did not fit
  Chunks shown_, incoming_, leaving_;
  std::optional<Pending> pending_;         // it is the last one of incoming_
  std::map<int, std::uint64_t> contents_;  // by surface, of the shown chunks
  std::uint64_t last_content_ = 0;
  std::uint64_t refused_request_ = 0;  // does not fit, or failed: its other chunks are not taken
  std::string error_;
};

}  // namespace isobrick
