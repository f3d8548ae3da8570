#include "isobrick/viewer/render/free_runs.h"

#include <algorithm>
#include <cassert>
#include <iterator>

namespace isobrick {

FreeRuns::FreeRuns(std::size_t units) : units_(units), free_(units) {
  if (units > 0) runs_.push_back({0, units});
}

std::optional<std::size_t> FreeRuns::take(std::size_t units) {
  assert(units > 0);
  auto best = runs_.end();
  for (auto run = runs_.begin(); run != runs_.end(); ++run)
    if (run->units >= units && (best == runs_.end() || run->units < best->units)) best = run;
  if (best == runs_.end()) return std::nullopt;
  const auto at = best - runs_.begin();
  if (const std::size_t most = handed_out_ + 2; runs_.capacity() < most) runs_.reserve(2 * most);
  Run& run = runs_[static_cast<std::size_t>(at)];
  const std::size_t begin = run.begin;
  run.begin += units;
  run.units -= units;
  if (run.units == 0) runs_.erase(runs_.begin() + at);
  ++handed_out_;
  free_ -= units;
  return begin;
}

void FreeRuns::give(std::size_t begin, std::size_t units) noexcept {
  assert(units > 0 && begin + units <= units_ && handed_out_ > 0);
  --handed_out_;
  free_ += units;
  const auto after = std::ranges::lower_bound(runs_, begin, {}, &Run::begin);
  const bool joins_after = after != runs_.end() && after->begin == begin + units;
  assert(after == runs_.end() || after->begin >= begin + units);
  const auto before = after == runs_.begin() ? runs_.end() : std::prev(after);
  assert(before == runs_.end() || before->end() <= begin);
  if (before != runs_.end() && before->end() == begin) {
    before->units += units;
    if (!joins_after) return;
    before->units += after->units;
    runs_.erase(after);
  } else if (joins_after) {
    after->begin = begin;
    after->units += units;
  } else {
    runs_.insert(after, {begin, units});
  }
}

}  // namespace isobrick
