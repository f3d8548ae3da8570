// Ranges of a file behind HTTP.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/range_reader.h"
#include "isobrick/storage/remote/http_answer.h"
#include "isobrick/storage/remote/http_transfers.h"
#include "isobrick/storage/remote/open_remote.h"
#include "isobrick/storage/remote/range_queue.h"
#include "isobrick/storage/remote/s3_object.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

class HttpRanges;

// The files of one pyramid or store share a thread, its connections, and the bound on ranges that
// are announced and not read yet. Outlives them.
struct HttpConnections {
  // Throws Error as HttpTransfers.
  explicit HttpConnections(const RemoteOptions& options);

  // That of the bucket of a URL, looked for once. Throws Error as findS3Account() and
  // findGoogleAccount().
  S3Account account(const std::string& url);

  struct Ahead {
    HttpRanges* owner;
    RangeQueue::Wanted wanted;
  };
  std::mutex mutex;                      // guards all below but `transfers`, and all files
  std::map<std::uint64_t, Ahead> ahead;  // announced and not read yet, the oldest first
  std::uint64_t ahead_bytes = 0;
  std::uint64_t next_id = 0;
  bool was_reached = false;             // a server has answered
  std::optional<S3Account> s3_account;  // with the region that a server named
  HttpTransfers transfers;
};

// Readers and announcements put ranges into a queue, of which a thread makes requests: neighbours
// joined (range_queue.h), many underway at once (http_transfers.h), repeated with
// back-off if the failure may pass. A range that is only announced waits kLinger for others that
// lie beside it. It stays here until it is read, or until announced ranges of all files have more
// than kMostAheadBytes together: then the oldest goes. Threads that read the same range wait for
// the same request.
//
// The first answer says how long the file is and how it is known again (ETag, time of change). A
// later one of another file ends the read with an error, whether the server heeds conditions or
// not.
class HttpRanges final : public RemoteRanges, private HttpClient {
 public:
  static constexpr std::chrono::microseconds kLinger{1000};
  static constexpr std::uint64_t kMostAheadBytes = std::uint64_t{64} << 20;

  // `name` is for messages; `object` is null, or what the URL is of.
  HttpRanges(std::string name, const std::string& url, std::unique_ptr<S3Object> object,
             const FirstRequest& first, const RemoteOptions& options,
             std::shared_ptr<HttpConnections> connections);
  ~HttpRanges() override;

  bool waitUntilOpen(const CancelFlag* cancel) override;
  std::uint64_t size() const override { return file_.bytes; }
  void read(const ByteRange& range, std::byte* out) override;
  void announce(std::span<const ByteRange> ranges) override;
  void abandon() override;
  std::string identity() const override;
  RemoteCounters counters() const override;

 private:
  using Wanted = RangeQueue::Wanted;
  using Clock = std::chrono::steady_clock;
  // The range of a request, and what was wanted of it.
  struct Joined {
    std::vector<Wanted> wanted;  // in the order of their offsets
    std::uint64_t first = 0, last = 0;
    std::uint64_t received = 0;  // bytes, from the first on, in this try
    int tries = 0;
    Clock::time_point not_before{};
    HttpVerdict verdict;
    bool is_shortcut = false;  // sent to the address that an earlier one was redirected to
    bool had_other_region = false, had_detour = false;
  };

  bool isInBeginning(const ByteRange& range) const;
  void waitFor(std::unique_lock<std::mutex>& lock, const WantedRange& wanted);
  Wanted want(const ByteRange& range);
  void takeFromAhead(WantedRange& wanted);
  void forget(const Wanted& wanted);
  bool makeRoom(std::uint64_t bytes);
  HttpRequest requestFor(Joined& joined);
  void finish(const Joined& joined);
  void fail(const Joined& joined, const std::string& text);
  bool isToRepeat(Joined& joined, const HttpEnd& end);

  std::optional<HttpRequest> nextRequest(std::chrono::milliseconds* wait) override;
  bool onHead(std::uint64_t id, const HttpHead& head) override;
  bool onBytes(std::uint64_t id, std::span<const std::byte> bytes) override;
  void onEnd(std::uint64_t id, const HttpEnd& end) override;

  const std::string name_;
  const std::string url_;
  const FirstRequest first_;
  const int most_tries_;
  const std::unique_ptr<S3Object> object_;

  const std::shared_ptr<HttpConnections> shared_;
  std::mutex& mutex_;  // that of all; guards all below
  std::condition_variable changed_;
  RemoteFile file_;   // does not change once the first answer is here
  Wanted beginning_;  // what the first request brings
  bool is_missing_ = false;
  bool is_abandoned_ = false;
  std::string redirected_url_;  // that answered in place of url_; empty: that did
  RangeQueue queue_;
  Clock::time_point last_announced_{};
  std::map<std::pair<std::uint64_t, std::uint64_t>, Wanted> wanted_;  // by offset and bytes
  std::map<std::uint64_t, Joined> underway_;
  std::vector<Joined> delayed_;  // that are to be sent again
  RemoteCounters counters_;
  std::minstd_rand random_{std::random_device{}()};
};

}  // namespace isobrick
