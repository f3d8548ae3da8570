// What an extraction did.
#pragma once

#include <cstdint>
#include <vector>

namespace isobrick {

struct LevelCounts {
  int level = 0;
  std::uint64_t cells = 0;  // leaves with at least one triangle
  std::uint64_t triangles = 0;
  std::uint64_t transition_cells = 0;  // cells whose triangles are fans
};

struct ExtractionReport {
  bool is_complete = true;  // false: coarser than asked for, as the query was one for now
  std::uint64_t triangles = 0;
  std::vector<LevelCounts> levels;  // those with triangles, finest first
  std::uint64_t bricks_active = 0;  // bricks with at least one triangle
  std::uint64_t bricks_read = 0;    // bricks of which any part was asked for
  std::uint64_t bytes_active = 0;   // stored bytes of the samples of active bricks
  std::uint64_t bytes_read = 0;     // stored bytes of all parts asked for, each counted once
};

}  // namespace isobrick
