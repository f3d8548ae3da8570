#include "isobrick/viewer/render/gl_arenas.h"

#include <algorithm>
#include <optional>
#include <string>

#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {
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
