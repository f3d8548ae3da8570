#include "isobrick/storage/remote/http_ranges.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <optional>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// A signal handler can set a flag and nothing more, so nothing wakes the thread that waits.
constexpr auto kBetweenLooks = std::chrono::milliseconds(5);
constexpr double kFirstPause = 0.25, kLongestBackOff = 8;  // seconds

constexpr const char* kAbandoned =
    "is not read any more: the pyramid is being closed; open it again";

double stallSecondsOf(const RemoteOptions& options) {
  constexpr double kDefault = 20;
  if (options.stall_seconds > 0) return options.stall_seconds;
  const char* const text = std::getenv("ISOBRICK_HTTP_TIMEOUT");
  const double seconds = text != nullptr ? std::strtod(text, nullptr) : 0;
  return seconds > 0 && std::isfinite(seconds) ? seconds : kDefault;
}

// Calls `f(piece)` for the range in pieces that a request each can bring.
template <typename F>
void forEachPiece(const ByteRange& range, F&& f) {
  for (std::uint64_t at = 0; at < range.bytes; at += RangeQueue::kMostRequestBytes)
    f(ByteRange{range.offset + at, std::min(range.bytes - at, RangeQueue::kMostRequestBytes)});
}

}  // namespace

HttpConnections::HttpConnections(const RemoteOptions& options)
    : transfers(stallSecondsOf(options)) {}

S3Account HttpConnections::account(const std::string& url) {
  const std::lock_guard lock(mutex);
  if (!s3_account)
    s3_account = isGoogleUrl(url) ? findGoogleAccount(systemSurroundings())
                                  : findS3Account(systemSurroundings());
  return *s3_account;
}

HttpRanges::HttpRanges(std::string name, const std::string& url, std::unique_ptr<S3Object> object,
                       const FirstRequest& first, const RemoteOptions& options,
                       std::shared_ptr<HttpConnections> connections)
    : name_(std::move(name)),
      url_(url),
      first_(first),
      most_tries_(std::max(options.tries, 1)),
      object_(std::move(object)),
      shared_(std::move(connections)),
      mutex_(shared_->mutex),
      beginning_(std::make_shared<WantedRange>()) {
  beginning_->range = {0, first_.bytes};
  beginning_->is_awaited = true;
  queue_.push(beginning_);
  shared_->transfers.enter(*this);
  shared_->transfers.wake();
}

HttpRanges::~HttpRanges() {
  shared_->transfers.leave(*this);
  const std::lock_guard lock(mutex_);
  for (const auto& [range, wanted] : wanted_) takeFromAhead(*wanted);
}

bool HttpRanges::waitUntilOpen(const CancelFlag* cancel) {
  std::unique_lock lock(mutex_);
  while (beginning_->state != WantedRange::State::kHere &&
         beginning_->state != WantedRange::State::kFailed) {
    changed_.wait_for(lock, kBetweenLooks);
    if (cancel != nullptr) cancel->check();
  }
  if (is_missing_) return false;
  if (beginning_->state == WantedRange::State::kFailed)
    throw Error("cannot open '" + name_ + "': " + beginning_->failure, {.path = name_});
  return true;
}

std::string HttpRanges::identity() const {
  return (object_ != nullptr ? object_->url() : url_) + "\n" + file_.etag + "\n" +
         file_.last_modified + "\n" + std::to_string(file_.bytes);
}

RemoteCounters HttpRanges::counters() const {
  const std::lock_guard lock(mutex_);
  return counters_;
}

void HttpRanges::abandon() {
  {
    const std::lock_guard lock(mutex_);
    is_abandoned_ = true;
  }
  changed_.notify_all();
}

bool HttpRanges::isInBeginning(const ByteRange& range) const {
  return range.offset >= beginning_->range.offset &&
         range.offset + range.bytes <= beginning_->end();
}

// Until it is here, has failed, or is not wanted any more.
void HttpRanges::waitFor(std::unique_lock<std::mutex>& lock, const WantedRange& wanted) {
  using enum WantedRange::State;
  const auto isDone = [&] {
    return is_abandoned_ || wanted.state == kHere || wanted.state == kFailed;
  };
  while (first_.cancel != nullptr && !isDone()) {
    changed_.wait_for(lock, kBetweenLooks);
    if (first_.cancel->requested()) is_abandoned_ = true;
  }
  changed_.wait(lock, isDone);
}

void HttpRanges::read(const ByteRange& range, std::byte* out) {
  std::unique_lock lock(mutex_);
  if (isInBeginning(range)) {
    std::memcpy(out, beginning_->data.get() + (range.offset - beginning_->range.offset),
                range.bytes);
    return;
  }
  // All of them are asked for before the first is waited for.
  std::vector<Wanted> pieces;
  forEachPiece(range, [&](const ByteRange& piece) {
    const Wanted wanted = want(piece);
    ++wanted->readers;
    takeFromAhead(*wanted);
    if (wanted->state == WantedRange::State::kQueued && !wanted->is_awaited) queue_.hurry(wanted);
    pieces.push_back(wanted);
  });
  shared_->transfers.wake();
  using enum WantedRange::State;
  Wanted missing;
  for (const Wanted& wanted : pieces) {
    waitFor(lock, *wanted);
    if (wanted->state == kHere)
      std::memcpy(out + (wanted->range.offset - range.offset), wanted->data.get(),
                  wanted->range.bytes);
    else if (missing == nullptr)
      missing = wanted;
    if (--wanted->readers == 0) forget(wanted);
  }
  if (missing != nullptr)
    throw ReadFailure(missing->state == kFailed ? missing->failure : kAbandoned);
}

// The range as others want it, or as a new one in the queue.
RangeQueue::Wanted HttpRanges::want(const ByteRange& range) {
  Wanted& wanted = wanted_[{range.offset, range.bytes}];
  if (wanted == nullptr) {
    wanted = std::make_shared<WantedRange>();
    wanted->range = range;
    queue_.push(wanted);
  }
  return wanted;
}

void HttpRanges::takeFromAhead(WantedRange& wanted) {
  if (wanted.ahead == 0) return;
  shared_->ahead_bytes -= wanted.range.bytes;
  shared_->ahead.erase(wanted.ahead);
  wanted.ahead = 0;
}

void HttpRanges::forget(const Wanted& wanted) {
  takeFromAhead(*wanted);
  if (wanted->state == WantedRange::State::kQueued) queue_.remove(wanted);
  wanted_.erase({wanted->range.offset, wanted->range.bytes});
}

// For announced ranges: those that came in longest ago and were not read go. False if the others
// take too much already.
bool HttpRanges::makeRoom(std::uint64_t bytes) {
  const auto isFull = [&] { return shared_->ahead_bytes + bytes > kMostAheadBytes; };
  for (auto at = shared_->ahead.begin(); at != shared_->ahead.end() && isFull();) {
    const HttpConnections::Ahead oldest = at->second;
    ++at;
    if (oldest.wanted->state == WantedRange::State::kHere) oldest.owner->forget(oldest.wanted);
  }
  return !isFull();
}

void HttpRanges::announce(std::span<const ByteRange> ranges) {
  {
    const std::lock_guard lock(mutex_);
    for (const ByteRange& range : ranges) {
      if (range.bytes == 0 || isInBeginning(range)) continue;
      forEachPiece(range, [&](const ByteRange& piece) {
        if (wanted_.contains({piece.offset, piece.bytes}) || !makeRoom(piece.bytes)) return;
        const Wanted wanted = want(piece);
        wanted->ahead = ++shared_->next_id;
        shared_->ahead_bytes += piece.bytes;
        shared_->ahead.emplace(wanted->ahead, HttpConnections::Ahead{this, wanted});
      });
    }
    last_announced_ = Clock::now();
  }
  shared_->transfers.wake();
}

// ---- on the thread of the transfers

std::optional<HttpRequest> HttpRanges::nextRequest(std::chrono::milliseconds* wait) {
  const std::lock_guard lock(mutex_);
  if (is_abandoned_) return std::nullopt;
  const Clock::time_point now = Clock::now();
  const auto first_due = std::min_element(
      delayed_.begin(), delayed_.end(),
      [](const Joined& a, const Joined& b) { return a.not_before < b.not_before; });
  Joined joined;
  if (first_due != delayed_.end() && first_due->not_before <= now) {
    joined = std::move(*first_due);
    delayed_.erase(first_due);
  } else {
    if (first_due != delayed_.end())
      *wait = std::min(*wait,
                       std::chrono::ceil<std::chrono::milliseconds>(first_due->not_before - now));
    if (!queue_.hasAwaited() && !queue_.empty() && now < last_announced_ + kLinger) {
      *wait = std::min(*wait, std::chrono::milliseconds(1));
      return std::nullopt;
    }
    joined.wanted = queue_.pop();
    if (joined.wanted.empty()) return std::nullopt;
    joined.first = joined.wanted.front()->range.offset;
    for (const Wanted& wanted : joined.wanted) {
      joined.last = std::max(joined.last, wanted->end() - 1);
      wanted->state = WantedRange::State::kUnderway;
    }
  }
  return requestFor(joined);
}

HttpRequest HttpRanges::requestFor(Joined& joined) {
  ++counters_.requests;
  if (++joined.tries > 1) ++counters_.repeated;
  joined.received = 0;
  joined.verdict = {};
  joined.is_shortcut = !redirected_url_.empty();
  HttpRequest request;
  request.id = ++shared_->next_id;
  request.url = joined.is_shortcut ? redirected_url_ : url_;
  const bool is_first = joined.wanted.front() == beginning_;
  if (is_first && first_.is_of_end) request.end_bytes = first_.bytes;
  request.first = joined.first;
  request.last = joined.last;
  request.headers = sameFileHeaders(file_);
  if (object_ != nullptr) object_->address(request);
  underway_.emplace(request.id, std::move(joined));
  return request;
}

bool HttpRanges::onHead(std::uint64_t id, const HttpHead& head) {
  const std::lock_guard lock(mutex_);
  Joined& joined = underway_.at(id);
  if (joined.wanted.front() != beginning_) {
    joined.verdict = judgeAnswer(head, joined.first, joined.last, file_);
  } else {
    RemoteFile file;
    joined.verdict = first_.is_of_end ? judgeFirstAnswerOfEnd(head, first_.bytes, file)
                                      : judgeFirstAnswer(head, 0, first_.bytes - 1, file);
    if (joined.verdict.kind == HttpVerdict::Kind::kGood) {
      file_ = file;
      const std::uint64_t bytes = std::min(first_.bytes, file.bytes);
      beginning_->range = {first_.is_of_end ? file.bytes - bytes : 0, bytes};
      joined.first = beginning_->range.offset;
      joined.last = beginning_->end() - 1;
    }
  }
  if (joined.verdict.kind != HttpVerdict::Kind::kGood) return false;
  for (const Wanted& wanted : joined.wanted)
    if (wanted->data == nullptr) {
      wanted->data.reset(new (std::nothrow) std::byte[wanted->range.bytes]);
      if (wanted->data == nullptr) {
        joined.verdict = {.kind = HttpVerdict::Kind::kNever,
                          .text = "no memory is left; free some"};
        return false;
      }
    }
  return true;
}

bool HttpRanges::onBytes(std::uint64_t id, std::span<const std::byte> bytes) {
  const std::lock_guard lock(mutex_);
  counters_.bytes += bytes.size();
  Joined& joined = underway_.at(id);
  const std::uint64_t begin = joined.first + joined.received, end = begin + bytes.size();
  if (end > joined.last + 1) {
    joined.verdict = {.kind = HttpVerdict::Kind::kNever,
                      .text =
                          "the server sends more bytes than it was asked for; use another "
                          "server"};
    return false;
  }
  // Ranges of one offset may differ in length, so all are looked at.
  for (const Wanted& wanted : joined.wanted) {
    const std::uint64_t from = std::max(begin, wanted->range.offset);
    const std::uint64_t to = std::min(end, wanted->end());
    if (from < to)
      std::memcpy(wanted->data.get() + (from - wanted->range.offset), bytes.data() + (from - begin),
                  to - from);
  }
  joined.received += bytes.size();
  return true;
}

void HttpRanges::onEnd(std::uint64_t id, const HttpEnd& end) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = underway_.find(id);
    Joined joined = std::move(found->second);
    underway_.erase(found);
    HttpEnd outcome = end;
    if (end.is_whole && joined.received != joined.last - joined.first + 1) {
      outcome.is_whole = false;
      outcome.may_pass = true;
      outcome.text = "the server sends fewer bytes than it was asked for; try again later";
    }
    if (outcome.is_whole) {
      if (object_ == nullptr && !end.url.empty() && !joined.is_shortcut && end.url != url_)
        redirected_url_ = end.url;
      finish(joined);
    } else if (isToRepeat(joined, outcome)) {
      delayed_.push_back(std::move(joined));
    } else {
      fail(joined, outcome.was_refused ? joined.verdict.text : outcome.text);
    }
  }
  changed_.notify_all();
}

bool HttpRanges::isToRepeat(Joined& joined, const HttpEnd& end) {
  using Kind = HttpVerdict::Kind;
  const Kind kind = end.was_refused ? joined.verdict.kind : Kind::kNever;
  joined.not_before = Clock::now();
  if (kind == Kind::kRegion && object_ != nullptr && !joined.had_other_region) {
    joined.had_other_region = true;
    object_->useRegion(joined.verdict.bucket_region);
    shared_->s3_account = object_->account();
    return true;
  }
  // The address that an earlier request was redirected to may serve for a while only.
  if (joined.is_shortcut && !joined.had_detour && (end.was_refused || end.is_unreached)) {
    joined.had_detour = true;
    redirected_url_.clear();
    return true;
  }
  const bool may_pass = kind == Kind::kMayPass || (!end.was_refused && end.may_pass);
  if (!may_pass || joined.tries >= most_tries_) return false;
  // A wrong address is said at once; a server that was there may come back.
  if (end.is_unreached && !shared_->was_reached) return false;
  const double back_off = std::min(kFirstPause * std::exp2(joined.tries - 1), kLongestBackOff);
  const double share = std::uniform_real_distribution<double>(0.5, 1)(random_);
  const double pause = std::max(back_off * share, joined.verdict.wait_seconds);
  joined.not_before += std::chrono::milliseconds(static_cast<std::int64_t>(1000 * pause));
  return true;
}

void HttpRanges::finish(const Joined& joined) {
  shared_->was_reached = true;
  for (const Wanted& wanted : joined.wanted) wanted->state = WantedRange::State::kHere;
}

void HttpRanges::fail(const Joined& joined, const std::string& text) {
  const std::string tries =
      joined.tries > 1 ? " (tried " + std::to_string(joined.tries) + " times)" : "";
  const bool is_first = joined.wanted.front() == beginning_;
  is_missing_ = is_missing_ || (is_first && joined.verdict.is_missing);
  std::string whole = (is_first ? "" : "cannot be read: ") + text;
  whole.insert(std::min(whole.find(';'), whole.size()), tries);
  for (const Wanted& wanted : joined.wanted) {
    wanted->state = WantedRange::State::kFailed;
    wanted->failure = whole;
    if (wanted->readers == 0 && !is_first) forget(wanted);  // a later read asks again
  }
}

}  // namespace isobrick
