#include "isobrick/viewer/stream/surface_stream.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <new>
#include <utility>

#include "isobrick/extract/color_map.h"
#include "isobrick/storage/error.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/listed_components.h"

namespace isobrick {

namespace {

// The queue has no room for a chunk, and nothing may wait for some.
struct QueueIsFull {};

}  // namespace

StreamPass passOf(const Query& query) {
  StreamPass pass;
  if (query.focus) pass.radius = query.focus->radius;
  pass.queries.push_back({0, query});
  return pass;
}

StreamRequest requestOf(const Query& query) {
  StreamRequest request;
  request.passes.push_back(passOf(query));
  return request;
}

SurfaceStream::SurfaceStream(std::shared_ptr<const Pyramid> pyramid, int threads,
                             std::function<void()> on_news, double patience_seconds,
                             std::shared_ptr<KnownComponents> known, std::uint64_t queue_bytes,
                             ChunkDelivery delivery)
    : pyramid_(std::move(pyramid)),
      threads_(std::max(1, threads)),
      on_news_(std::move(on_news)),
      least_patience_(patience_seconds),
      known_(known ? std::move(known) : std::make_shared<KnownComponents>()),
      most_queue_bytes_(queue_bytes),
      delivery_(std::move(delivery)),
      extractor_(*pyramid_),
      patience_(patience_seconds),
      thread_([this] { run(); }) {}

SurfaceStream::~SurfaceStream() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    waiting_.reset();
    endCurrent();
  }
  work_.notify_all();
  thread_.join();
}

std::uint64_t SurfaceStream::request(StreamRequest request) {
  auto cancel = std::make_shared<CancelFlag>();
  const std::lock_guard lock(mutex_);
  if (waiting_) request.may_reuse = request.may_reuse && waiting_->request.may_reuse;
  waiting_ = Job{++last_number_, std::move(request), std::move(cancel)};
  if (!working_ || !user_waits_) {
    endCurrent();
    dropPassesAtRest();
  }
  endSlowPass();
  work_.notify_all();
  return last_number_;
}

void SurfaceStream::cancel() {
  const std::lock_guard lock(mutex_);
  waiting_.reset();
  endCurrent();
}

std::optional<StreamMessage> SurfaceStream::poll() {
  const std::lock_guard lock(mutex_);
  endSlowPass();
  if (queue_.empty()) return takeLost();
  StreamMessage message = std::move(queue_.front());
  queue_.pop_front();
  queue_bytes_ -= message.chunk.bytes();
  room_.notify_all();
  if (mayBegin()) work_.notify_all();
  return message;
}

bool SurfaceStream::busy() const {
  const std::lock_guard lock(mutex_);
  return working_ || waiting_ || !queue_.empty() || lost_;
}

// With the lock.
void SurfaceStream::endCurrent() {
  if (cancel_ != nullptr) cancel_->request();
  room_.notify_all();
}

// For the request that waits; nothing under way reuses them. With the lock.
void SurfaceStream::dropPassesAtRest() {
  const auto isDropped = [](const StreamMessage& message) {
    return message.at_rest && message.kind == StreamMessage::Kind::kChunk;
  };
  for (StreamMessage& message : queue_) {
    if (isDropped(message)) queue_bytes_ -= message.chunk.bytes();
    if (!message.at_rest || message.kind != StreamMessage::Kind::kPassDone) continue;
    message.kind = StreamMessage::Kind::kDropped;
    waiting_->request.may_reuse = false;
  }
  std::erase_if(queue_, isDropped);
}

// Call it when a request waits for a pass that takes long. With the lock.
void SurfaceStream::endSlowPass() {
  if (!working_ || !waiting_ || cancel_->requested() || clockSeconds() - pass_begin_ <= patience_)
    return;
  if (user_waits_) patience_ *= 2.0;
  endCurrent();
}

// With the lock.
void SurfaceStream::noteTime(StreamMessage& end) const {
  end.ended = clockSeconds();
  end.seconds = std::max(0.0, end.ended - pass_begin_ - waited_);
}

// Chunks of a pass that was given up go with it. A request that came after the last of them took
// those of a pass at rest already, and its end has to follow.
void SurfaceStream::finish(StreamMessage end) {
  bool is_news = false;
  {
    const std::lock_guard lock(mutex_);
    const bool at_rest = end.at_rest;
    if (end.kind != StreamMessage::Kind::kPassDone) dropLastChunks();
    is_news = queue_.empty();
    queue_.push_back(std::move(end));
    if (at_rest && waiting_) dropPassesAtRest();
  }
  if (is_news) tell();
}

// Without the lock.
void SurfaceStream::tell() const {
  if (on_news_) on_news_();
}

// With the lock.
void SurfaceStream::dropLastChunks() {
  while (!queue_.empty() && queue_.back().kind == StreamMessage::Kind::kChunk) {
    queue_bytes_ -= queue_.back().chunk.bytes();
    queue_.pop_back();
  }
}

// The pass had no end: poll() makes one. Chunks to be reused later may have gone with it.
void SurfaceStream::lose(std::uint64_t request) {
  {
    const std::lock_guard lock(mutex_);
    dropLastChunks();
    lost_ = request;
    if (waiting_) waiting_->request.may_reuse = false;
    done_.clear();
  }
  try {
    tell();
  } catch (const std::bad_alloc&) {  // whoever asks next finds it
  }
}

// With the lock.
std::optional<StreamMessage> SurfaceStream::takeLost() {
  if (!lost_) return std::nullopt;
  StreamMessage message;
  message.request = *std::exchange(lost_, std::nullopt);
  message.kind = StreamMessage::Kind::kFailed;
  message.at_rest = true;
  message.error = "no memory left";
  return message;
}

void SurfaceStream::pushChunk(StreamMessage message, const CancelFlag& cancel) {
  std::unique_lock lock(mutex_);
  if (queue_bytes_ >= most_queue_bytes_) {
    if (!delivery_.may_wait) throw QueueIsFull{};
    const double begin = clockSeconds();
    room_.wait(lock, [&] { return queue_bytes_ < most_queue_bytes_ || cancel.requested(); });
    waited_ += clockSeconds() - begin;
  }
  if (cancel.requested()) throw Cancelled();
  const std::uint64_t bytes = message.chunk.bytes();
  const bool is_news = queue_.empty();
  queue_.push_back(std::move(message));
  queue_bytes_ += bytes;
  lock.unlock();
  if (is_news) tell();
}

void SurfaceStream::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    work_.wait(lock, [&] { return stopping_ || (waiting_ && mayBegin()); });
    if (stopping_) return;
    const Job job = std::move(*waiting_);
    waiting_.reset();
    working_ = true;
    cancel_ = job.cancel;
    lock.unlock();
    try {
      runJob(job);
    } catch (const std::exception&) {  // no memory for the message about it
      lose(job.number);
    }
    lock.lock();
    working_ = false;
    cancel_.reset();
  }
}

void SurfaceStream::runJob(const Job& job) {
  const std::vector<StreamPass>& passes = job.request.passes;
  for (std::size_t pass = 0; pass < passes.size(); ++pass) {
    if (pass > 0 && !delivery_.may_wait) awaitEmptyQueue(*job.cancel);
    const Outcome outcome = pass == 0 ? runFirstPass(job) : run(job, {pass, &passes[pass]});
    if (outcome != Outcome::kComplete) return;
  }
}

SurfaceStream::Outcome SurfaceStream::runFirstPass(const Job& job) {
  const StreamRequest& request = job.request;
  std::size_t smaller = 0;
  Attempt attempt{0, &request.passes[0], request.at_once};
  while (true) {
    const bool may_shrink = smaller < request.smaller.size();
    attempt.most_triangles = may_shrink ? request.most_triangles : 0;
    const Outcome outcome = run(job, attempt);
    if (outcome == Outcome::kTooMany)
      attempt.work = &request.smaller[smaller++];
    else if (outcome == Outcome::kIncomplete)
      attempt.at_once = false;
    else
      return outcome;
  }
}

// A taker that is slow has no use for the next pass yet.
void SurfaceStream::awaitEmptyQueue(const CancelFlag& cancel) {
  std::unique_lock lock(mutex_);
  user_waits_ = false;
  room_.wait(lock, [&] { return queue_.empty() || waiting_ || cancel.requested(); });
}

// False if the attempt is not to be made.
bool SurfaceStream::begin(const Attempt& attempt) {
  const std::lock_guard lock(mutex_);
  user_waits_ = attempt.at_once;
  // Passes that no user waits for come after a request that does.
  if (!user_waits_ && waiting_) endCurrent();
  if (cancel_->requested()) return false;
  pass_begin_ = clockSeconds();
  waited_ = 0.0;
  return true;
}

SurfaceStream::Outcome SurfaceStream::run(const Job& job, const Attempt& attempt) {
  if (!begin(attempt)) return Outcome::kEnded;
  StreamMessage end;
  end.request = job.number;
  end.pass = attempt.pass;
  end.at_rest = !attempt.at_once;
  end.radius = attempt.work->radius;
  end.kind = StreamMessage::Kind::kDropped;
  Outcome outcome = Outcome::kEnded;
  try {
    outcome = extract(job, attempt, end);
    end.kind = StreamMessage::Kind::kPassDone;
  } catch (const Cancelled&) {
  } catch (const TooManyTriangles& too_many) {
    outcome = Outcome::kTooMany;
    end.too_many = true;
    end.triangles_made = too_many.triangles;
    const std::lock_guard lock(mutex_);
    noteTime(end);
  } catch (const QueueIsFull&) {
    end.no_room = true;
  } catch (const std::exception& failure) {
    end.kind = StreamMessage::Kind::kFailed;
    end.error = failureWords(failure);
  }
  finish(std::move(end));
  return outcome;
}

// Kept from pass to pass. Throws Error if another pyramid cannot be opened.
const ChunkValues* SurfaceStream::valuesFor(const StreamValues& wanted) {
  if (wanted == values_wanted_) return values_.get();
  values_.reset();
  values_wanted_ = {};
  values_number_ = 0;
  if (wanted.what == StreamValues::What::kGradient) values_ = gradientValues(*pyramid_);
  if (wanted.what == StreamValues::What::kOther) values_ = otherValues(*pyramid_, wanted.other);
  values_wanted_ = wanted;
  if (values_ != nullptr) values_number_ = ++last_values_number_;
  return values_.get();
}

// Fills `end`, the last message of the pass.
SurfaceStream::Outcome SurfaceStream::extract(const Job& job, const Attempt& attempt,
                                              StreamMessage& end) {
  const std::shared_ptr<const CancelFlag> cancel = cancel_;  // this thread alone replaces it
  std::atomic<std::uint64_t> triangles{0};
  std::mutex made_mutex;
  const auto take = [&](SurfaceChunk&& chunk) {
    triangles += chunk.triangles.size() / 3;
    if (attempt.most_triangles > 0 && triangles > attempt.most_triangles)
      throw TooManyTriangles{triangles};
    if (chunk.key) {
      const std::lock_guard lock(made_mutex);
      made_[*chunk.key] = {chunk.cells, chunk.triangles.size() / 3};
    }
    StreamMessage message;
    message.request = job.number;
    message.pass = attempt.pass;
    message.at_rest = !attempt.at_once;
    message.chunk = std::move(chunk);
    if (delivery_.pack) delivery_.pack(message.chunk);
    pushChunk(std::move(message), *cancel);
  };
  const ChunkValues* const values = valuesFor(job.request.values);
  if (values != nullptr) end.values = values->range();
  end.what = values_wanted_.what;
  if (attempt.pass == 0 && !job.request.may_reuse) done_.clear();
  if (const auto& queries = attempt.work->queries; !queries.empty()) {
    if (region_ != queries.front().query.region) done_.clear();
    region_ = queries.front().query.region;
  }
  made_.clear();
  // TBB's threads come from one pool; an arena bounds how many of them work here.
  tbb::task_arena arena(threads_);
  arena.execute([&] {
    for (const StreamPass::SurfaceQuery& surface : attempt.work->queries)
      extractSurface(surface, attempt, take, end);
  });
  end.triangles_made = triangles;
  // The shown chunks of kept surfaces stay.
  for (const auto& done : done_)
    if (std::any_of(attempt.work->kept.begin(), attempt.work->kept.end(),
                    [&](const auto& kept) { return kept.surface == done.first.surface; }))
      made_.insert(done);
  end.kept = attempt.work->kept;
  done_.swap(made_);  // nothing fails from here on
  made_.clear();
  const std::lock_guard lock(mutex_);
  if (user_waits_) patience_ = least_patience_;
  end.last_pass = attempt.pass + 1 == job.request.passes.size() && end.is_complete;
  noteTime(end);
  return end.is_complete ? Outcome::kComplete : Outcome::kIncomplete;
}

namespace {

// The first places that are kept of a list, for a legend.
void noteLargest(const std::vector<std::uint8_t>& is_kept, StreamedSurface& streamed) {
  for (std::size_t place = 0; place < is_kept.size(); ++place) {
    if (is_kept[place] == 0) continue;
    ++streamed.pieces;
    if (streamed.largest.size() < kComponentColorCount) streamed.largest.push_back(place);
  }
}

}  // namespace

// In the arena.
void SurfaceStream::extractSurface(const StreamPass::SurfaceQuery& surface, const Attempt& attempt,
                                   const std::function<void(SurfaceChunk&&)>& take,
                                   StreamMessage& end) {
  const bool by_component = values_wanted_.what == StreamValues::What::kComponent;
  const ListedComponents* const listed = by_component ? surface.listed.get() : nullptr;
  const ChunkKey key{surface.surface,
                     surface.query.isovalue,
                     values_number_,
                     listed != nullptr ? listed->number() : 0,
                     0,
                     {},
                     surface.query.inside,
                     surface.query.cap};
  const bool has_all = surface.pieces.isAll();
  ChunkSink sink(key, {values_.get(), listed != nullptr}, [&](std::size_t, SurfaceChunk&& chunk) {
    // Which pieces are kept depends on all bricks.
    if (!has_all) chunk.key.reset();
    take(std::move(chunk));
  });
  Query query = surface.query;
  query.cancel = cancel_.get();
  query.is_progressive = attempt.at_once;
  std::vector<LevelCounts> levels(static_cast<std::size_t>(pyramid_->lattice().levels()));
  if (has_all)
    query.has_brick = [&](int level, const Index3& brick) {
      ChunkKey of_brick = key;
      of_brick.level = level;
      of_brick.brick = {brick.x, brick.y, brick.z};
      const auto known = done_.find(of_brick);
      if (known == done_.end()) return false;
      made_.insert(*known);
      end.reused.push_back(of_brick);
      levels[static_cast<std::size_t>(level)].cells += known->second.cells;
      levels[static_cast<std::size_t>(level)].triangles += known->second.triangles;
      return true;
    };
  StreamedSurface streamed;
  streamed.surface = surface.surface;
  ExtractionReport report;
  if (!has_all) {
    report = extractPieces(surface, query, attempt.most_triangles, sink, streamed);
  } else if (listed != nullptr) {
    const ListedNumbers numbers(*listed);
    ComponentNumbering numbering(numbers, sink);
    report = extractor_.extract(query, numbering);
    noteLargest(std::vector<std::uint8_t>(listed->list().size(), 1), streamed);
  } else {
    report = extractor_.extract(query, sink);
  }
  for (const LevelCounts& made : report.levels) {
    LevelCounts& counts = levels[static_cast<std::size_t>(made.level)];
    counts.cells += made.cells;
    counts.triangles += made.triangles;
    counts.transition_cells += made.transition_cells;
  }
  for (std::size_t level = 0; level < levels.size(); ++level) {
    levels[level].level = static_cast<int>(level);
    streamed.triangles += levels[level].triangles;
    if (levels[level].triangles > 0) streamed.levels.push_back(levels[level]);
  }
  end.triangles += streamed.triangles;
  end.bricks_read += report.bricks_read;
  end.is_complete = end.is_complete && report.is_complete;
  end.surfaces.push_back(std::move(streamed));
}

// The chosen pieces alone: of one level by its list, which is made if it is not known; of several
// levels in two passes.
ExtractionReport SurfaceStream::extractPieces(const StreamPass::SurfaceQuery& surface,
                                              const Query& of_stream, std::uint64_t most_triangles,
                                              TriangleSink& sink, StreamedSurface& streamed) {
  Query query = of_stream;
  query.is_progressive = false;
  const bool by_component = values_wanted_.what == StreamValues::What::kComponent;
  const ListedComponents* const colors = by_component ? surface.listed.get() : nullptr;
  std::optional<ListedNumbers> numbers;
  const auto noteLargestOfColors = [&] {
    if (colors != nullptr)
      noteLargest(colors->chosen(extractor_, surface.pieces, query.cancel).is_kept, streamed);
  };
  if (colors != nullptr) numbers.emplace(*colors);
  const std::optional<int> level = onlyLevelOf(query);
  if (!level) {
    noteLargestOfColors();
    ChosenExtraction chosen = extractChosen(extractor_, query, surface.pieces, sink, most_triangles,
                                            numbers ? &*numbers : nullptr);
    streamed.lost_pieces = chosen.lost;
    return std::move(chosen.report);
  }
  const auto listed = known_->findOrList(
      extractor_, *pyramid_, {query.isovalue, *level, query.cancel, nullptr, most_triangles});
  ChosenComponents chosen = listed->chosen(extractor_, surface.pieces, query.cancel);
  streamed.lost_pieces = chosen.lost;
  const bool is_of_colors = colors == listed.get();
  if (is_of_colors)
    noteLargest(chosen.is_kept, streamed);
  else
    noteLargestOfColors();
  ComponentFilter filter(listed->components(), std::move(chosen.is_kept), sink,
                         is_of_colors || !numbers ? nullptr : &*numbers);
  return extractor_.extract(query, filter);
}

}  // namespace isobrick
