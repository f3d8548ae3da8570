// How often which values occur, from a coarse level.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/storage/pyramid.h"

namespace isobrick {

struct ValueHistogram {
  double least = 0.0, greatest = 1.0;  // data units, of level 0
  std::vector<std::uint64_t> counts;   // of equal parts of that range

  std::uint64_t total() const;
  // The value that parts the samples into two groups of the least spread (Otsu): a first isovalue.
  double dividingValue() const;
};

// Of the finest level with at most `most_samples` samples; its bricks are read. Samples of coarse
// levels are means, so narrow peaks are lower than those of level 0. Throws Error for a damaged
// brick.
ValueHistogram coarseHistogram(const Pyramid& pyramid, std::size_t bins = 256,
                               std::int64_t most_samples = std::int64_t{1} << 21);

}  // namespace isobrick
