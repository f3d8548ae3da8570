// A Zarr store behind a URL: its objects, of which many are underway at a time. Private to
// preprocess/sources/.
#pragma once

#include <chrono>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote/open_remote.h"

namespace isobrick {

// The objects of one server, or of one bucket of S3. Paths are URLs, and lead from one to the next
// as those of a folder do. All members are thread-safe.
class RemoteStore {
 public:
  // Of a URL. `cancel`, which may be null, is looked at while a server is waited for, and outlives
  // the store. Throws Error for a URL with a query or with a password: messages name paths.
  static std::shared_ptr<RemoteStore> enter(const std::string& url, const CancelFlag* cancel);
  // The store that was entered last and leads to this path; null if none is held, as for all that
  // is no URL.
  static std::shared_ptr<RemoteStore> through(const std::string& path);

  // Metadata: zarr.json, .zarray or .zattrs; nothing if the server has none. Those of a folder come
  // in one round trip, or with the consolidated ones of a folder above, and stay. Throws Error if a
  // server fails, or sends more than `kMostDocumentBytes`.
  std::optional<std::string> document(const std::string& path);
  // The folders below one, as far as consolidated metadata name them.
  std::vector<std::string> childrenOf(const std::string& folder);
  // A line that changes if a document of `root`, or above or below it, changes that came so far.
  std::string identityOf(const std::string& root);

  // Asks for an object that open() will be called for with the same `first`. Does nothing if too
  // many are underway already.
  void announce(const std::string& path, const FirstRequest& first);
  // Null if the server has no such object. With `stays`, it stays open among the last ones that
  // were used. Throws ResumableError if it cannot be opened, Cancelled.
  std::shared_ptr<RemoteRanges> open(const std::string& path, const FirstRequest& first,
                                     bool stays);

  // Whether the document is there now. Asks the server at most once a second.
  bool isStillThere(const std::string& path);

  const CancelFlag* cancel() const { return cancel_; }

  // What was announced, and was not opened for so long, is not kept for others.
  static constexpr std::chrono::seconds kForgotten{30};
  static constexpr std::uint64_t kMostDocumentBytes = std::uint64_t{16} << 20;

 private:
  using Ranges = std::shared_ptr<RemoteRanges>;
  using Clock = std::chrono::steady_clock;
  struct Asked {
    std::string path;
    Ranges ranges;
    std::uint64_t bytes = 0;  // that it may hold
    Clock::time_point since{};
    bool stays = false;  // rather than until it is opened
  };

  explicit RemoteStore(const CancelFlag* cancel);
  Ranges ask(const std::string& path, FirstRequest first);
  std::optional<std::string> readText(RemoteRanges& ranges, const std::string& path);
  bool isThere(const std::string& path) const;
  void loadFolder(const std::string& folder);
  void takeConsolidated(const std::string& folder, const std::string& text);
  void makeRoom(std::uint64_t bytes);

  const CancelFlag* const cancel_;
  const std::shared_ptr<HttpConnections> connections_;

  std::mutex documents_mutex_;  // guards the three below
  std::map<std::string, std::optional<std::string>> documents_;
  std::map<std::string, std::string> editions_;  // of documents
  Clock::time_point last_seen_{};

  std::mutex mutex_;        // guards the two below
  std::list<Asked> asked_;  // the one used last at the end
  std::uint64_t asked_bytes_ = 0;
};

}  // namespace isobrick
