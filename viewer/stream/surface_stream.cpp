#include "isobrick/viewer/stream/surface_stream.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/stream/chunk_sink.h"

namespace isobrick {
namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void addCounts(const std::vector<LevelCounts>& counts, std::vector<LevelCounts>& sums) {
  for (const LevelCounts& count : counts) {
    const auto same = std::find_if(
        sums.begin(), sums.end(), [&](const LevelCounts& sum) { return sum.level == count.level; });
    LevelCounts& sum = same != sums.end() ? *same : sums.emplace_back();
    sum.level = count.level;
    sum.cells += count.cells;
    sum.triangles += count.triangles;
    sum.transition_cells += count.transition_cells;
  }
  std::sort(sums.begin(), sums.end(),
            [](const LevelCounts& a, const LevelCounts& b) { return a.level < b.level; });
}

}  // namespace

SurfaceStream::SurfaceStream(std::shared_ptr<const Pyramid> pyramid, int threads,
                             double patience_seconds)
    : pyramid_(std::move(pyramid)),
      threads_(std::max(1, threads)),
      least_patience_(patience_seconds),
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
  const std::lock_guard lock(mutex_);
  waiting_ = Job{++last_number_, std::move(request)};
  if (working_ && current_pass_ > 0) endCurrent();
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
  if (queue_.empty()) return std::nullopt;
  StreamMessage message = std::move(queue_.front());
  queue_.pop_front();
  queue_bytes_ -= message.chunk.bytes();
  room_.notify_all();
  return message;
}

bool SurfaceStream::busy() const {
  const std::lock_guard lock(mutex_);
  return working_ || waiting_ || !queue_.empty();
}

// With the lock.
void SurfaceStream::endCurrent() {
  if (cancel_ != nullptr) cancel_->request();
  room_.notify_all();
}

// Where a request waits for a pass that takes long. With the lock.
void SurfaceStream::endSlowPass() {
  if (!working_ || !waiting_ || cancel_->requested() || now() - pass_begin_ <= patience_) return;
  if (current_pass_ == 0) patience_ *= 2.0;
  endCurrent();
}

void SurfaceStream::push(StreamMessage message) {
  const std::lock_guard lock(mutex_);
  queue_bytes_ += message.chunk.bytes();
  queue_.push_back(std::move(message));
}

void SurfaceStream::pushChunk(StreamMessage message, const CancelFlag& cancel) {
  std::unique_lock lock(mutex_);
  if (queue_bytes_ >= kQueueBytes) {
    const double begin = now();
    room_.wait(lock, [&] { return queue_bytes_ < kQueueBytes || cancel.requested(); });
    waited_ += now() - begin;
  }
  if (cancel.requested()) throw Cancelled();
  queue_bytes_ += message.chunk.bytes();
  queue_.push_back(std::move(message));
}

void SurfaceStream::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    work_.wait(lock, [&] { return stopping_ || waiting_; });
    if (stopping_) return;
    const Job job = std::move(*waiting_);
    waiting_.reset();
    working_ = true;
    cancel_ = std::make_shared<CancelFlag>();
    lock.unlock();
    runJob(job);
    lock.lock();
    working_ = false;
    cancel_.reset();
  }
}

void SurfaceStream::runJob(const Job& job) {
  for (std::size_t pass = 0; pass < job.request.passes.size(); ++pass) {
    {
      const std::lock_guard lock(mutex_);
      // Beyond the first pass a request that waits comes before.
      if (pass > 0 && waiting_) endCurrent();
      if (cancel_->requested()) return;
      current_pass_ = pass;
      pass_begin_ = now();
      waited_ = 0.0;
    }
    StreamMessage end;
    end.request = job.number;
    end.pass = pass;
    const bool done = runPass(job, pass, end);
    push(std::move(end));
    if (!done) return;
  }
}

// Fills `end`, the last message of the pass; true where the pass was done.
bool SurfaceStream::runPass(const Job& job, std::size_t pass, StreamMessage& end) {
  const StreamPass& work = job.request.passes[pass];
  const std::shared_ptr<CancelFlag> cancel = cancel_;  // this thread alone replaces it
  try {
    // TBB's threads come from one pool; an arena bounds how many of them work here.
    tbb::task_arena arena(threads_);
    arena.execute([&] {
      for (const StreamPass::SurfaceQuery& surface : work.queries) {
        ChunkSink sink(surface.surface, [&](std::size_t, SurfaceChunk&& chunk) {
          StreamMessage message;
          message.request = job.number;
          message.pass = pass;
          message.chunk = std::move(chunk);
          pushChunk(std::move(message), *cancel);
        });
        Query query = surface.query;
        query.cancel = cancel.get();
        const ExtractionReport report = extractor_.extract(query, sink);
        end.triangles += report.triangles;
        end.bricks_read += report.bricks_read;
        addCounts(report.levels, end.levels);
      }
    });
    const std::lock_guard lock(mutex_);
    if (pass == 0) patience_ = least_patience_;
    end.kind = StreamMessage::Kind::kPassDone;
    end.last_pass = pass + 1 == job.request.passes.size();
    end.radius = work.radius;
    end.seconds = std::max(0.0, now() - pass_begin_ - waited_);
    return true;
  } catch (const Cancelled&) {
    end.kind = StreamMessage::Kind::kDropped;
  } catch (const std::exception& failure) {
    end.kind = StreamMessage::Kind::kFailed;
    end.error = failure.what();
  }
  return false;
}

}  // namespace isobrick
