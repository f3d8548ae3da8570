// The surfaces of one client: wishes in, chunks and words about them out. No network.
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

// The way to a client: messages arrive in the order in which they are sent here.
class ClientLine {
 public:
  virtual ~ClientLine() = default;
  virtual void sendWord(const nlohmann::ordered_json& word) = 0;
  virtual void sendChunk(std::vector<std::byte> packet) = 0;
  // Little enough is on its way for another chunk to follow.
  virtual bool hasRoom() const = 0;
};

// Belongs to one thread, which none of its calls keeps waiting, but for the destructor, which waits
// for the end of an extraction and may be called by any other thread; it does not use the line.
class SurfaceSession : private ChunkStore {
 public:
  // Packed bytes that wait for a client that reads slowly, at most (and a chunk).
  static constexpr std::uint64_t kMostWaitingBytes = std::uint64_t{24} << 20;

  // `on_news`, from any thread: call update(). The line outlives the last call but the destructor.
  SurfaceSession(std::shared_ptr<const OpenedVolume> opened, int threads, ClientLine& line,
                 std::function<void()> on_news);

  const ViewVolume& volume() const { return shown_volume_.volume(); }
  void take(const ClientMessage& message);
  // Goes on with all that can go on. Call it again after so many seconds, after news, a message,
  // and when the line has room; none: only then.
  std::optional<double> update();

 private:
  struct Load {
    std::uint64_t triangles = 0, bytes = 0;
  };

  // Sends chunks in place of keeping them.
  ChunkId reserve(const SurfaceChunk& chunk) override;
  bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                   std::size_t bytes) override;
  void endUploads() override {}
  void release(ChunkId chunk) noexcept override;

  bool takeFromUnshown(ChunkId chunk) noexcept;
  bool isSeen() const;
  void tellShown();
  void tellState();
  void tellWithLimit(nlohmann::ordered_json message) const;

  const std::shared_ptr<const OpenedVolume> opened_;
  const ShownVolume shown_volume_;
  const PositionSteps steps_;
  ClientLine& line_;

  ChunkId last_chunk_ = 0;
  std::map<ChunkId, Load> unshown_;  // chunks that the client shall not show yet
  Load unshown_load_;                // of all of these
  // Chunks that it shows, and those that went without having been shown.
  std::vector<ChunkId> shown_, dropped_;

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
