#include "isobrick/viewer/render/free_runs.h"

#include <cassert>
#include <iterator>

namespace isobrick {

FreeRuns::FreeRuns(std::size_t units) : units_(units) {
  if (units > 0) add(0, units);
}

std::optional<std::size_t> FreeRuns::take(std::size_t units) {
  assert(units > 0);
  const auto found = lengths_.lower_bound({units, 0});
  if (found == lengths_.end()) return std::nullopt;
  const auto [length, begin] = *found;
  remove(runs_.find(begin));
  if (length > units) add(begin + units, length - units);
  return begin;
}

void FreeRuns::give(std::size_t begin, std::size_t units) {
  assert(units > 0 && begin + units <= units_);
  std::size_t end = begin + units;
  const auto after = runs_.lower_bound(begin);
  assert(after == runs_.end() || after->first >= end);
  if (after != runs_.begin()) {
    const auto before = std::prev(after);
    assert(before->first + before->second <= begin);
    if (before->first + before->second == begin) {
      begin = before->first;
      remove(before);
    }
  }
  if (after != runs_.end() && after->first == end) {
    end += after->second;
    remove(after);
  }
  add(begin, end - begin);
}

void FreeRuns::add(std::size_t begin, std::size_t units) {
  runs_.emplace(begin, units);
  lengths_.emplace(units, begin);
  free_ += units;
}

void FreeRuns::remove(std::map<std::size_t, std::size_t>::iterator run) {
  free_ -= run->second;
  lengths_.erase({run->second, run->first});
  runs_.erase(run);
}

}  // namespace isobrick
