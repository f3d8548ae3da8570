#include "isobrick/preprocess/sources/zarr_remote.h"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

// Objects that are open or underway, and what their first answers may take.
constexpr std::size_t kMostAsked = 288;
constexpr std::uint64_t kMostAskedBytes = std::uint64_t{64} << 20;

constexpr std::string_view kConsolidated = ".zmetadata";
constexpr std::string_view kVersion3 = "zarr.json";
constexpr std::string_view kVersion2[] = {".zarray", ".zattrs", kConsolidated};

struct EnteredStores {
  std::mutex mutex;
  std::map<std::string, std::weak_ptr<RemoteStore>> by_server;
};
EnteredStores& enteredStores() {
  static EnteredStores stores;
  return stores;
}

// "https://host:port" of a URL.
std::string serverOf(const std::string& url) {
  return url.substr(0, url.find('/', url.find("://") + 3));
}

std::string folderOfObject(const std::string& path) { return path.substr(0, path.rfind('/')); }

}  // namespace

std::shared_ptr<RemoteStore> RemoteStore::enter(const std::string& url, const CancelFlag* cancel) {
  if (const std::string path = withoutSecrets(url); path != url)
    throw unreadable(path,
                     "a store has many files, and a URL with '?' is of one; give its folder, and "
                     "passwords and keys as docs/REMOTE.md says");
  EnteredStores& stores = enteredStores();
  const std::lock_guard lock(stores.mutex);
  std::weak_ptr<RemoteStore>& known = stores.by_server[serverOf(url)];
  std::shared_ptr<RemoteStore> store = known.lock();
  if (store != nullptr && store->cancel_ == cancel) return store;
  store.reset(new RemoteStore(cancel));
  known = store;
  return store;
}

std::shared_ptr<RemoteStore> RemoteStore::through(const std::string& path) {
  if (!isRemotePath(path)) return nullptr;
  EnteredStores& stores = enteredStores();
  const std::lock_guard lock(stores.mutex);
  const auto found = stores.by_server.find(serverOf(path));
  return found == stores.by_server.end() ? nullptr : found->second.lock();
}

RemoteStore::RemoteStore(const CancelFlag* cancel)
    : cancel_(cancel), connections_(makeHttpConnections({})) {}

RemoteStore::Ranges RemoteStore::ask(const std::string& path, FirstRequest first) {
  first.cancel = cancel_;
  return askForRemoteRanges(path, first, {}, connections_);
}

// ---- metadata

std::optional<std::string> RemoteStore::readText(RemoteRanges& ranges, const std::string& path) {
  if (!ranges.waitUntilOpen(cancel_)) return std::nullopt;
  if (ranges.size() > kMostDocumentBytes)
    throw unreadable(path, "it has ", ranges.size(),
                     " bytes, too many for the metadata of a Zarr store; check what it is");
  std::string text(static_cast<std::size_t>(ranges.size()), '\0');
  ranges.read({0, text.size()}, reinterpret_cast<std::byte*>(text.data()));
  editions_[path] = ranges.identity();
  return text;
}

bool RemoteStore::isThere(const std::string& path) const {
  const auto found = documents_.find(path);
  return found != documents_.end() && found->second;
}

// What has a zarr.json has nothing of version 2. Of version 2, all that a folder may have, at once.
void RemoteStore::loadFolder(const std::string& folder) {
  std::vector<std::pair<std::string, Ranges>> asked;
  const auto begin = [&](std::string_view name) {
    std::string path = folder + "/" + std::string(name);
    if (!documents_.contains(path))
      asked.emplace_back(path, ask(path, {.bytes = kMostDocumentBytes}));
  };
  const auto finish = [&] {
    for (const auto& [path, ranges] : asked) {
      documents_[path] = readText(*ranges, path);
      const bool may_hold_others = path.ends_with(kVersion3) || path.ends_with(kConsolidated);
      if (const auto& text = documents_[path]; text && may_hold_others)
        takeConsolidated(folder, *text);
    }
    asked.clear();
  };
  begin(kVersion3);
  if (!isThere(folderOfObject(folder) + "/.zattrs")) finish();
  if (isThere(folder + "/" + std::string(kVersion3))) return;
  for (const std::string_view name : kVersion2) begin(name);
  finish();
}

// Of version 2: the documents by their paths, of version 3: those of groups and arrays by theirs.
// What is not named there is asked for: it may be younger.
void RemoteStore::takeConsolidated(const std::string& folder, const std::string& text) {
  const nlohmann::json json = parseShallowJson(text);
  const nlohmann::json& inside = member(json, "consolidated_metadata");
  const bool is_version3 = inside.is_object();
  const nlohmann::json& all = member(is_version3 ? inside : json, "metadata");
  if (!all.is_object()) return;
  for (const auto& [name, content] : all.items()) {
    if (name.empty() || !content.is_object()) continue;
    documents_.try_emplace(folder + "/" + name + (is_version3 ? "/zarr.json" : ""), content.dump());
  }
}

std::optional<std::string> RemoteStore::document(const std::string& path) {
  const std::lock_guard lock(documents_mutex_);
  if (const auto found = documents_.find(path); found != documents_.end()) return found->second;
  // What is known to be of one version has no documents of the other.
  const std::string folder = folderOfObject(path);
  if (isThere(folder + "/zarr.json") ||
      (isThere(folder + "/.zarray") && path.ends_with("/zarr.json")))
    return std::nullopt;
  loadFolder(folder);
  return documents_[path];
}

std::vector<std::string> RemoteStore::childrenOf(const std::string& folder) {
  const std::lock_guard lock(documents_mutex_);
  std::set<std::string> names;
  const std::string begin = folder + "/";
  for (auto at = documents_.lower_bound(begin);
       at != documents_.end() && at->first.starts_with(begin); ++at) {
    const std::size_t end = at->first.find('/', begin.size());
    if (at->second && end != std::string::npos)
      names.insert(at->first.substr(begin.size(), end - begin.size()));
  }
  return {names.begin(), names.end()};
}

std::string RemoteStore::identityOf(const std::string& root) {
  const std::lock_guard lock(documents_mutex_);
  std::string all;
  for (const auto& [path, edition] : editions_)
    if (path.starts_with(root + "/") || (root + "/").starts_with(folderOfObject(path) + "/"))
      all += edition + "\n";
  return concat(root, ", metadata ", checksum64(all.data(), all.size()));
}

bool RemoteStore::isStillThere(const std::string& path) {
  constexpr auto kBetweenLooks = std::chrono::seconds(1);
  const std::lock_guard lock(documents_mutex_);
  if (Clock::now() - last_seen_ < kBetweenLooks) return true;
  if (!ask(path, {.bytes = 1})->waitUntilOpen(cancel_)) return false;
  last_seen_ = Clock::now();
  return true;
}

// ---- chunks and shards

// Of those that are read again and again, the one that was used longest ago goes; and those that
// were announced, and that another thread read meanwhile.
void RemoteStore::makeRoom(std::uint64_t bytes) {
  const Clock::time_point now = Clock::now();
  const auto isFull = [&] {
    return asked_.size() >= kMostAsked || asked_bytes_ + bytes > kMostAskedBytes;
  };
  for (auto at = asked_.begin(); at != asked_.end() && isFull();) {
    if (at->stays || now - at->since > kForgotten) {
      asked_bytes_ -= at->bytes;
      at = asked_.erase(at);
    } else {
      ++at;
    }
  }
}

void RemoteStore::announce(const std::string& path, const FirstRequest& first) {
  const std::lock_guard lock(mutex_);
  const auto isThis = [&](const Asked& one) { return one.path == path; };
  if (std::ranges::any_of(asked_, isThis)) return;
  makeRoom(first.bytes);
  if (asked_.size() >= kMostAsked || asked_bytes_ + first.bytes > kMostAskedBytes) return;
  asked_.push_back({path, ask(path, first), first.bytes, Clock::now()});
  asked_bytes_ += first.bytes;
}

std::shared_ptr<RemoteRanges> RemoteStore::open(const std::string& path, const FirstRequest& first,
                                                bool stays) {
  Ranges ranges;
  {
    const std::lock_guard lock(mutex_);
    const auto found =
        std::ranges::find_if(asked_, [&](const Asked& one) { return one.path == path; });
    if (found == asked_.end()) {
      ranges = ask(path, first);
      if (stays) {
        makeRoom(first.bytes);
        asked_.push_back({path, ranges, first.bytes, Clock::now(), true});
        asked_bytes_ += first.bytes;
      }
    } else {
      ranges = found->ranges;
      found->stays = stays;
      if (stays) {
        asked_.splice(asked_.end(), asked_, found);
      } else {
        asked_bytes_ -= found->bytes;
        asked_.erase(found);
      }
    }
  }
  try {
    return ranges->waitUntilOpen(cancel_) ? ranges : nullptr;
  } catch (const Cancelled&) {
    throw;
  } catch (const Error& failure) {
    throw ResumableError(failure.what(), {.path = path});
  }
}

}  // namespace isobrick
