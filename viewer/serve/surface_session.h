// The surfaces that one client sees of one volume: wishes in, chunks and words about them out. No
// network.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/viewer/serve/client_message.h"
#include "isobrick/viewer/session/shown_volume.h"
#include "isobrick/viewer/session/surface_requests.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/stream/chunk_packet.h"
#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {

// The way to a client, for all volumes of its scene: messages arrive in the order in which they are
// sent here.
class ClientLine {
 public:
  virtual ~ClientLine() = default;
  // Of the next chunk; none is given twice.
  ChunkId nextChunk() { return ++last_chunk_; }
  virtual void sendWord(const nlohmann::ordered_json& word) = 0;
  virtual void sendChunk(std::vector<std::byte> packet) = 0;
  // Little enough is on its way for another chunk to follow.
  virtual bool hasRoom() const = 0;

 private:
  ChunkId last_chunk_ = 0;
};

// Sends chunks in place of keeping them, and knows what the client has.
class ClientChunks : public ChunkStore {
 public:
  ClientChunks(ClientLine& line, std::uint32_t volume) : line_(line), volume_(volume) {}

  // Of chunks that are not shown yet: NoGraphicsMemory of reserve() beyond it.
  void bound(std::optional<std::uint64_t> most_triangles, std::optional<std::uint64_t> most_bytes) {
    most_triangles_ = most_triangles;
    most_bytes_ = most_bytes;
  }

  ChunkId reserve(const SurfaceChunk& chunk) override;
  bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                   std::size_t bytes) override;
  void endUploads() override {}
  void release(ChunkId chunk) noexcept override;

  // `shown` is shown from now on. Returns the chunks that are new among them, and those that the
  // client may forget, both ascending.
  struct Change {
    std::vector<ChunkId> show, drop;
  };
  Change show(std::vector<ChunkId> shown);
  // Chunks that were released without having been shown, since the last call, ascending.
  std::vector<ChunkId> takeDropped();

 private:
  struct Kept {
    std::uint64_t triangles = 0, bytes = 0;
    bool was_shown = false;
  };
  void takeAway(const Kept& kept) noexcept;

  ClientLine& line_;
  const std::uint32_t volume_;
  std::optional<std::uint64_t> most_triangles_, most_bytes_;
  std::map<ChunkId, Kept> kept_;
  std::uint64_t triangles_ = 0, bytes_ = 0;  // of those that are not shown yet
  std::vector<ChunkId> shown_, dropped_;
};

// Belongs to one thread, which none of its calls keeps waiting, but for the destructor, which waits
// for the end of an extraction and may be called by any other thread; it does not use the line.
class SurfaceSession {
 public:
  // Packed bytes that wait for a client that reads slowly, at most (and a chunk).
  static constexpr std::uint64_t kMostWaitingBytes = std::uint64_t{24} << 20;

  // `number`: that the client knows the volume by; all words have it. `on_news`, from any thread:
  // call update(). The line outlives the last call but the destructor.
  SurfaceSession(std::shared_ptr<const OpenedVolume> opened, std::uint32_t number, int threads,
                 ClientLine& line, std::function<void()> on_news);

  const ViewVolume& volume() const { return shown_.volume(); }
  void take(const ClientMessage& message);
  // Goes on with all that can go on. Call it again after so many seconds, after news, a message,
  // and when the line has room; none: only then.
  std::optional<double> update();

 private:
  bool isSeen() const;
  void tellShown();
  void tellDropped();
  void tellState();
  void tellWithLimit(nlohmann::ordered_json message) const;
  void tell(nlohmann::ordered_json message) const;

  const std::shared_ptr<const OpenedVolume> opened_;
  const ShownVolume shown_;
  const PositionSteps steps_;
  const std::uint32_t number_;
  ClientLine& line_;
  ClientChunks chunks_;
  std::optional<ClientWish> wish_;
  std::map<std::uint64_t, std::int64_t> numbers_;  // of wishes, by request
  bool is_new_ = false;                            // not asked for yet
  std::uint64_t told_passes_ = 0;
  double told_at_ = 0.0;  // of clockSeconds()
  // That were sent, by pass, until the client says that it is on the screen.
  std::map<std::uint64_t, std::uint64_t> told_triangles_;
  bool told_fine_ = true;
  std::string told_error_;
  SurfaceRequests requests_;  // last: its threads use the above
};

}  // namespace isobrick
