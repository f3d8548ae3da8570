// The values that were used last, within a budget.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace isobrick {

// Vectors of T by key. Thread-safe.
template <typename Key, typename T>
class RecentCache {
 public:
  using Value = std::shared_ptr<const std::vector<T>>;

  // Kept values take up to `budget_bytes`, or are one value.
  explicit RecentCache(std::uint64_t budget_bytes) : budget_bytes_(budget_bytes) {}

  // Null: it is not there.
  Value find(const Key& key) {
    const std::lock_guard lock(mutex_);
    const auto found = places_.find(key);
    if (found == places_.end()) return nullptr;
    values_.splice(values_.end(), values_, found->second);
    return found->second->second;
  }
  // If two threads made the same value, that of the first is kept.
  void add(const Key& key, Value value) {
    const std::lock_guard lock(mutex_);
    if (places_.contains(key)) return;
    held_bytes_ += value->size() * sizeof(T);
    values_.emplace_back(key, std::move(value));
    places_[key] = std::prev(values_.end());
    while (held_bytes_ > budget_bytes_ && values_.size() > 1) {
      held_bytes_ -= values_.front().second->size() * sizeof(T);
      places_.erase(values_.front().first);
      values_.pop_front();
    }
  }

 private:
  using Values = std::list<std::pair<Key, Value>>;

  const std::uint64_t budget_bytes_;
  std::mutex mutex_;  // guards all below
  Values values_;     // the one used last at the end
  std::map<Key, typename Values::iterator> places_;
  std::uint64_t held_bytes_ = 0;
};

}  // namespace isobrick
