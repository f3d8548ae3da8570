// Values at the vertices of a surface, to colour it by.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Thread-safe.
class ChunkValues {
 public:
  virtual ~ChunkValues() = default;
  // What shares 0 and 1 stand for.
  virtual std::array<double, 2> range() const = 0;
  // A share of the range for every vertex of the batch, or not a number; `placed.world` is scratch.
  // Throws Error for a damaged brick.
  virtual void evaluate(PlacedBatch& placed, std::span<float> shares) const = 0;
};

// How steep the volume is there, in data units per world unit, from the samples of the brick and
// level that the triangles were made of. The pyramid outlives it.
std::unique_ptr<ChunkValues> gradientValues(const Pyramid& pyramid);

// The values that another pyramid's level 0 has there (extract/pyramid_values.h), of which as many
// bytes are kept in memory as of `shown`. Throws Error where there is none at `path`.
std::unique_ptr<ChunkValues> otherValues(const Pyramid& shown, const std::string& path);

}  // namespace isobrick
