#include "isobrick/viewer/render/gl_arenas.h"

#include <algorithm>
#include <cassert>
#include <iterator>
#include <optional>
#include <string>

#include "isobrick/viewer/stream/chunk_store.h"

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

namespace {
constexpr std::size_t kLeastBytes = std::size_t{4} << 20;
constexpr std::size_t kMostBytes = std::size_t{32} << 20;
}  // namespace

GlArenas::Place GlArenas::take(std::size_t bytes, GlDevice& device) {
  const std::size_t units = (bytes + kUnitBytes - 1) / kUnitBytes;
  if (units == 0) return {};
  const auto takeFrom = [&](std::size_t arena) -> std::optional<Place> {
    if (!arenas_[arena]) return std::nullopt;
    const auto begin = arenas_[arena]->runs.take(units);
    if (!begin) return std::nullopt;
    free_ -= units;
    return Place{arena, *begin, units};
  };
  for (std::size_t arena = 0; arena < arenas_.size(); ++arena)
    if (const auto place = takeFrom(arena)) return *place;
  const std::size_t wanted = std::max(
      units,
      device.limits().arenaBytes(std::clamp(this->bytes(), kLeastBytes, kMostBytes)) / kUnitBytes);
  // A card that is nearly full may have room for this one chunk.
  std::size_t arena = 0;
  try {
    arena = addArena(wanted, device);
  } catch (const NoGraphicsMemory&) {
    if (wanted == units) throw;
    arena = addArena(units, device);
  }
  return *takeFrom(arena);
}

std::size_t GlArenas::addArena(std::size_t units, GlDevice& device) {
  auto made = std::make_unique<Arena>(Arena{GlBuffer::make(), FreeRuns(units)});
  const std::size_t bytes = units * kUnitBytes;
  device.forgetErrors();
  glNamedBufferStorage(*made->buffer, static_cast<GLsizeiptr>(bytes), nullptr,
                       GL_DYNAMIC_STORAGE_BIT);
  device.checkErrors("cannot keep " + std::to_string(bytes) + " bytes of a surface: " +
                     device.name() + " has no memory left; ask for a smaller radius");
  units_ += units;
  free_ += units;
  const auto empty = std::find(arenas_.begin(), arenas_.end(), nullptr);
  const auto at = static_cast<std::size_t>(empty - arenas_.begin());
  if (empty == arenas_.end()) arenas_.emplace_back();
  arenas_[at] = std::move(made);
  return at;
}

void GlArenas::give(const Place& place) noexcept {
  if (place.units == 0) return;
  Arena& arena = *arenas_[place.arena];
  arena.runs.give(place.begin, place.units);
  free_ += place.units;
  const std::size_t units = arena.runs.units();
  if (!arena.runs.isAllFree() || free_ - units < units) return;
  units_ -= units;
  free_ -= units;
  arenas_[place.arena].reset();
}

std::size_t GlArenas::greatestBytes() const {
  std::size_t greatest = 0;
  for (const auto& arena : arenas_)
    if (arena) greatest = std::max(greatest, arena->runs.units() * kUnitBytes);
  return greatest;
}

std::size_t GlArenas::count() const {
  return static_cast<std::size_t>(
      std::count_if(arenas_.begin(), arenas_.end(), [](const auto& arena) { return !!arena; }));
}

}  // namespace isobrick
