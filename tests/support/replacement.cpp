#include "tests/support/replacement.h"

#include <algorithm>
#include <limits>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <utility>

#include "isobrick/storage/residence_policy.h"

namespace isobrick::test {

std::uint64_t workingSetBytes(const TakeTrace& trace) {
  std::map<std::uint64_t, std::uint64_t> parts;
  for (const auto& query : trace)
    for (const Take& take : query) parts[take.id] = take.bytes;
  std::uint64_t sum = 0;
  for (const auto& [id, bytes] : parts) sum += bytes;
  return sum;
}

std::uint64_t bytesReadByLru(const TakeTrace& trace, std::uint64_t budget_bytes) {
  std::list<Take> queue;  // the newest last
  std::map<std::uint64_t, std::list<Take>::iterator> held;
  std::uint64_t held_bytes = 0, read = 0;
  for (const auto& query : trace)
    for (const Take& take : query) {
      if (const auto found = held.find(take.id); found != held.end()) {
        queue.splice(queue.end(), queue, found->second);
        continue;
      }
      read += take.bytes;
      held_bytes += take.bytes;
      held[take.id] = queue.insert(queue.end(), take);
      for (; held_bytes > budget_bytes; queue.pop_front()) {
        held_bytes -= queue.front().bytes;
        held.erase(queue.front().id);
      }
    }
  return read;
}

std::uint64_t bytesReadByBelady(const TakeTrace& trace, std::uint64_t budget_bytes) {
  std::vector<Take> takes;
  for (const auto& query : trace) takes.insert(takes.end(), query.begin(), query.end());
  constexpr std::size_t kNever = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> next(takes.size());  // take of the same part
  std::map<std::uint64_t, std::size_t> seen;
  for (std::size_t i = takes.size(); i-- > 0;) {
    const auto [found, is_new] = seen.try_emplace(takes[i].id, i);
    next[i] = is_new ? kNever : std::exchange(found->second, i);
  }
  std::map<std::uint64_t, std::size_t> held;  // and when each is taken again
  std::set<std::pair<std::size_t, std::uint64_t>> by_next;
  std::map<std::uint64_t, std::uint64_t> sizes;
  std::uint64_t held_bytes = 0, read = 0;
  for (std::size_t i = 0; i < takes.size(); ++i) {
    const Take& take = takes[i];
    if (const auto found = held.find(take.id); found != held.end()) {
      by_next.erase({found->second, take.id});
    } else {
      read += take.bytes;
      held_bytes += take.bytes;
      sizes[take.id] = take.bytes;
    }
    held[take.id] = next[i];
    by_next.insert({next[i], take.id});
    while (held_bytes > budget_bytes) {
      const std::uint64_t last = by_next.rbegin()->second;
      by_next.erase(std::prev(by_next.end()));
      held.erase(last);
      held_bytes -= sizes[last];
    }
  }
  return read;
}

std::uint64_t bytesReadByPolicy(const TakeTrace& trace, std::uint64_t budget_bytes) {
  struct Held : ResidencePolicy::Member {
    bool is_used = false;
    std::size_t query = 0;
  };
  ResidencePolicy policy(budget_bytes);
  std::map<std::uint64_t, std::unique_ptr<Held>> held;
  std::uint64_t held_bytes = 0, read = 0;
  for (std::size_t query = 0; query < trace.size(); ++query) {
    policy.beginQuery();
    for (const Take& take : trace[query]) {
      std::unique_ptr<Held>& part = held[take.id];
      if (part != nullptr) {
        part->is_used = true;
        part->query = query;
        continue;
      }
      read += take.bytes;
      held_bytes += take.bytes;
      part = std::make_unique<Held>();
      part->id = take.id;
      part->bytes = take.bytes;
      part->query = query;
      policy.add(*part);
      while (held_bytes > budget_bytes) {
        using enum ResidencePolicy::Which;
        const auto* victim = policy.takeVictim([&](auto& member, ResidencePolicy::Which which) {
          auto& one = static_cast<Held&>(member);
          return which == kAny || which == kNotAhead ||
                 (which == kStale ? one.query + 1 < query : !std::exchange(one.is_used, false));
        });
        held_bytes -= victim->bytes;
        held.erase(victim->id);
      }
    }
  }
  return read;
}

}  // namespace isobrick::test
