// The free parts of a buffer of which runs are handed out.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <utility>

namespace isobrick {

// Uses no memory and no OpenGL: it handles only places. Units are of any size. A run comes from the
// smallest free one that holds it; neighbours that are free are one again.
class FreeRuns {
 public:
  explicit FreeRuns(std::size_t units);

  // The first unit of so many, at least 1, that are free no longer; nothing if no run holds them.
  std::optional<std::size_t> take(std::size_t units);
  // Gives back what take() handed out.
  void give(std::size_t begin, std::size_t units);

  std::size_t units() const { return units_; }
  std::size_t freeUnits() const { return free_; }
  bool isAllFree() const { return free_ == units_; }

 private:
  void add(std::size_t begin, std::size_t units);
  void remove(std::map<std::size_t, std::size_t>::iterator run);

  const std::size_t units_;
  std::size_t free_ = 0;
  std::map<std::size_t, std::size_t> runs_;                // length by place
  std::set<std::pair<std::size_t, std::size_t>> lengths_;  // with their places
};

}  // namespace isobrick
