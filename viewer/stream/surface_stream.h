// Extraction beside an interface: requests in, chunks and the ends of passes out.
//
//   std::counting_semaphore<> news(0);
//   SurfaceStream stream(pyramid, 4, [&] { news.release(); });  // 4 threads
//   stream.request(requestOf(query));  // or passes of one's own, from coarse to fine
//   for (;; news.acquire())
//     while (std::optional<StreamMessage> message = stream.poll()) ...  // draw, or merge
//
// SurfaceMerger (merged_surface.h) makes one mesh of each pass; the viewer's SurfaceSet sends
// chunks to a graphics card. Both take them from this stream.
#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/component_choice.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

class ChunkValues;       // chunk_sink.h
class KnownComponents;   // listed_components.h
class ListedComponents;  // likewise

// One closed surface for each query, together: they may replace the surfaces shown before.
struct StreamPass {
  // A surface whose chunks stay as they are: its shown chunks have the content with this number
  // (SurfaceSet::contentOf).
  struct KeptSurface {
    int surface = 0;            // its number in the scene
    std::uint64_t content = 0;  // the number of its content
  };

  // A surface that is extracted.
  struct SurfaceQuery {
    int surface = 0;          // its number in the scene; the caller's choice, one query each
    Query query;              // its `cancel`, `is_progressive` and `has_brick` are the stream's own
    PieceChoice pieces = {};  // of the surface; the others are left out
    // Whose places colour the vertices in bricks of its level, with StreamValues::What::kComponent;
    // of the same isovalue. Null: they have none.
    std::shared_ptr<const ListedComponents> listed = {};
  };
  double radius = 0.0;                 // of the queries, voxels; for the caller alone
  std::vector<SurfaceQuery> queries;   // extracted one after the other; all of one region
  std::vector<KeptSurface> kept = {};  // the others of the scene
};

// The result of a pass for one of its queries.
struct StreamedSurface {
  int surface = 0;                  // its number in the scene
  std::uint64_t triangles = 0;      // with those of bricks that were not made again
  std::vector<LevelCounts> levels;  // with triangles, ascending
  std::size_t lost_pieces = 0;      // chosen ones that are not there (ChosenComponents)
  // The places in SurfaceQuery::listed of the largest pieces that are shown, at most
  // kComponentColorCount, and how many there are.
  std::vector<std::size_t> largest = {};
  std::size_t pieces = 0;  // see there
};

// The values that vertices carry beside their normals.
struct StreamValues {
  // None; how steep the volume is there, data units per world unit; those of another pyramid; the
  // places of components (packComponent).
  enum class What { kNone, kGradient, kOther, kComponent };
  What what = What::kNone;  // the kind
  std::string other;        // of kOther: the path of a pyramid

  bool operator==(const StreamValues&) const = default;  // equal in both
};

// Passes from coarse to fine.
struct StreamRequest {
  // At least one. Each replaces the surfaces of the one before as soon as all of it is there.
  std::vector<StreamPass> passes;
  // A user waits for the first one: it is answered from resident bricks (Query::is_progressive),
  // and if some are missing once more, when these have been read.
  bool at_once = true;
  // Each replaces the one before, or the first pass, if that has more than `most_triangles`; the
  // last of these may have any number.
  std::vector<StreamPass> smaller = {};
  std::uint64_t most_triangles = 0;  // of the first pass, if there are smaller ones; 0: any number
  StreamValues values = {};          // SurfaceVertex::value
  // Bricks that are the same in the pass that was done last are not made again. False if not all
  // chunks of that pass are shown.
  bool may_reuse = true;
};

// A pass of one surface, number 0.
StreamPass passOf(const Query& query);
// The request for one surface, at once: from the bricks in memory, and whole when it is there.
StreamRequest requestOf(const Query& query);

// How chunks go into the queue of a stream.
struct ChunkDelivery {
  // Called for each chunk on threads of the extraction, for several at the same time; it may empty
  // vertices and triangles, and fill SurfaceChunk::packed. An exception ends the request. Lives as
  // long as the stream.
  std::function<void(SurfaceChunk&)> pack = {};
  // While the queue is full: true: threads of the extraction wait; false: they never do, and the
  // pass is given up (StreamMessage::no_room). Then the next pass, of any request, begins when no
  // chunk waits in the queue: a slow taker gets the latest request, and none that is old by then.
  bool may_wait = true;
};

// A chunk, or the end of a pass. Messages own what they hold.
struct StreamMessage {
  // The kinds of messages.
  enum class Kind {
    kChunk,     // of the current pass
    kPassDone,  // all chunks of the pass were sent
    kDropped,   // the current pass was given up: another request came, or it has too many triangles
    kFailed,    // the same, for an error; no further pass of the request comes
  };
  Kind kind = Kind::kChunk;   // decides which of the others count
  std::uint64_t request = 0;  // the number that request() returned
  std::size_t pass = 0;       // which of its passes
  bool at_rest = false;       // a user who moves on does not wait for the pass
  SurfaceChunk chunk;         // of kChunk
  bool too_many = false;      // of kDropped: it has more triangles than it may
  bool no_room = false;       // of kDropped: the queue was full (ChunkDelivery::may_wait)
  // For kPassDone; with `too_many` radius, seconds and triangles_made until then:
  bool last_pass = false;   // nothing finer follows
  bool is_complete = true;  // false: coarser than requested, as bricks were not resident
  double radius = 0.0;      // of the pass
  StreamValues::What what = StreamValues::What::kNone;  // the vertices' values
  std::array<double, 2> values{0.0, 0.0};     // that a vertex value's share 0 and 1 stand for
  double seconds = 0.0;                       // of extraction, waiting for a full queue left out
  double ended = 0.0;                         // when the extraction ended, of steady_clock
  std::uint64_t triangles = 0;                // of all queries
  std::uint64_t triangles_made = 0;           // those of them that are not reused
  std::vector<ChunkKey> reused;               // chunks of the pass shown before that are part of it
  std::uint64_t bricks_read = 0;              // from the file
  std::vector<StreamedSurface> surfaces;      // one a query
  std::vector<StreamPass::KeptSurface> kept;  // those of the pass
  std::string error;                          // of kFailed, one line
};

// A thread with an Extractor session. request(), poll() and the rest are for one other thread, the
// interface; none of them waits for an extraction. Each answer is the surface that
// extractIsosurface() gives for the query, brick by brick in any order.
//
// Errors come as messages: a damaged brick, a lost file or want of memory ends the request, and the
// next one is tried again.
//
// A new request ends the one before: at once if that is beyond its first pass, or has been in it
// for longer than the patience; else when its first pass is answered, so that a user who never
// rests sees surfaces all the same. The patience doubles whenever it ends a first pass, and is
// reset when one is done: so on a slow or busy machine one gets through sooner or later. The queue
// is bounded; the extraction waits if the interface is slower. Messages in it of
// passes that no user waits for are dropped with the next request, which they would delay.
class SurfaceStream {
 public:
  // The first patience.
  static constexpr double kPatienceSeconds = 0.1;
  // Of chunks that wait to be taken.
  static constexpr std::uint64_t kQueueBytes = std::uint64_t{32} << 20;

  // `threads`: of the extraction. The pyramid is shared with it.
  //
  // `on_news` says that a message waits where none did: take messages by poll() until there is
  // none. It comes from any thread of the extraction, perhaps from several at once, and perhaps for
  // a message that a newer request has dropped since. It wakes the interface and does nothing else:
  // it must neither wait, throw, nor call the stream, and lives as long as the stream.
  //
  // `known`: the lists of components that it uses and adds to; null: its own. The queue holds at
  // most `queue_bytes`, and a chunk.
  SurfaceStream(std::shared_ptr<const Pyramid> pyramid, int threads,
                std::function<void()> on_news = {}, double patience_seconds = kPatienceSeconds,
                std::shared_ptr<KnownComponents> known = {},
                std::uint64_t queue_bytes = kQueueBytes, ChunkDelivery delivery = {});
  // Cancels the work under way, and waits for its end.
  ~SurfaceStream();
  SurfaceStream(const SurfaceStream&) = delete;
  SurfaceStream& operator=(const SurfaceStream&) = delete;

  // Returns the number that its messages will have; numbers ascend from 1. Passes that were not
  // answered by then may end as kDropped, or without any message.
  std::uint64_t request(StreamRequest request);
  // Ends everything: no pass goes on, and none waits. Messages that wait stay.
  void cancel();
  // The next message, if there is one. Messages of one pass follow each other, chunks first.
  std::optional<StreamMessage> poll();
  // True while a pass is under way, a request waits, or a message was not polled.
  bool busy() const;

 private:
  struct Job {
    std::uint64_t number = 0;
    StreamRequest request;
    std::shared_ptr<CancelFlag> cancel;  // made by request(), whose caller gets an exception
  };
  void run();
  enum class Outcome { kComplete, kIncomplete, kTooMany, kEnded };
  struct Attempt {
    std::size_t pass = 0;
    const StreamPass* work = nullptr;
    bool at_once = false;
    std::uint64_t most_triangles = 0;  // 0: any number
  };
  void runJob(const Job& job);
  Outcome runFirstPass(const Job& job);
  bool begin(const Attempt& attempt);
  void awaitEmptyQueue(const CancelFlag& cancel);
  // With the lock.
  bool mayBegin() const { return delivery_.may_wait || queue_bytes_ == 0; }
  Outcome run(const Job& job, const Attempt& attempt);
  const ChunkValues* valuesFor(const StreamValues& wanted);
  Outcome extract(const Job& job, const Attempt& attempt, StreamMessage& end);
  void extractSurface(const StreamPass::SurfaceQuery& surface, const Attempt& attempt,
                      const std::function<void(SurfaceChunk&&)>& take, StreamMessage& end);
  ExtractionReport extractPieces(const StreamPass::SurfaceQuery& surface, const Query& query,
                                 std::uint64_t most_triangles, TriangleSink& sink,
                                 StreamedSurface& streamed);
  void noteTime(StreamMessage& end) const;
  void finish(StreamMessage end);
  void dropLastChunks();
  void lose(std::uint64_t request);
  std::optional<StreamMessage> takeLost();
  void pushChunk(StreamMessage message, const CancelFlag& cancel);
  void endCurrent();
  void endSlowPass();
  void dropPassesAtRest();

  void tell() const;

  const std::shared_ptr<const Pyramid> pyramid_;
  const int threads_;
  const std::function<void()> on_news_;
  const double least_patience_;
  const std::shared_ptr<KnownComponents> known_;
  const std::uint64_t most_queue_bytes_;
  const ChunkDelivery delivery_;
  // For the thread alone:
  Extractor extractor_;  // keeps its memory from pass to pass
  StreamValues values_wanted_;
  std::unique_ptr<ChunkValues> values_;
  std::uint64_t values_number_ = 0, last_values_number_ = 0;  // see ChunkKey
  // The share of chunks with a key: of the last pass that was done, and of the current one.
  struct Addition {
    std::uint64_t cells = 0, triangles = 0;
  };
  using Additions = std::map<ChunkKey, Addition>;
  Additions done_, made_;
  SurfaceRegion region_;  // of done_

  mutable std::mutex mutex_;
  std::condition_variable work_, room_;
  std::optional<Job> waiting_;
  bool working_ = false;
  bool stopping_ = false;
  std::uint64_t last_number_ = 0;
  std::shared_ptr<CancelFlag> cancel_;  // of the current job
  bool user_waits_ = false;             // for the current pass
  double pass_begin_ = 0.0;
  double patience_;      // seconds
  double waited_ = 0.0;  // seconds of the current pass in pushChunk()
  std::deque<StreamMessage> queue_;
  std::uint64_t queue_bytes_ = 0;
  std::optional<std::uint64_t> lost_;  // a request whose end found no memory

  std::thread thread_;  // last: it uses all of the above
};

}  // namespace isobrick
