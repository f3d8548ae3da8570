// The free parts of a buffer of which runs are handed out.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace isobrick {

// Uses no OpenGL: it handles only places. Units are of any size. A run comes from the smallest free
// one that holds it; neighbours that are free are one again.
class FreeRuns {
 public:
  explicit FreeRuns(std::size_t units);

  // The first unit of so many, at least 1, that are free no longer; nothing if no run holds them.
  std::optional<std::size_t> take(std::size_t units);
  // Gives back what take() handed out. Needs no memory.
  void give(std::size_t begin, std::size_t units) noexcept;

  std::size_t units() const { return units_; }
  std::size_t freeUnits() const { return free_; }
  bool isAllFree() const { return free_ == units_; }

 private:
  struct Run {
    std::size_t begin, units;
    std::size_t end() const { return begin + units; }
  };

  const std::size_t units_;
  std::size_t free_ = 0, handed_out_ = 0;  // units, and how often
  std::vector<Run> runs_;                  // by place, with room for one before each handed out
};

}  // namespace isobrick
