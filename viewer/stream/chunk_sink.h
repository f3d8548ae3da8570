// A triangle sink that makes the chunks of a picture, and numbers for the vertices of chunks.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <string>
#include <unordered_map>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

SceneLattice latticeOf(const GridGeometry& geometry);

// Thread-safe.
class ChunkValues {
 public:
  virtual ~ChunkValues() = default;
  // The values of the shares 0 and 1.
  virtual std::array<double, 2> range() const = 0;
  // A share of the range for every vertex of the batch, or not a number; `placed.world` is scratch.
  // Throws Error for a damaged brick.
  virtual void evaluate(PlacedBatch& placed, std::span<double> shares) const = 0;
};

// How steep the volume is there, in data units per world unit, from the samples of the brick and
// level that the triangles were made of. The pyramid outlives it.
std::unique_ptr<ChunkValues> gradientValues(const Pyramid& pyramid);

// The values that another pyramid's level 0 has there (extract/pyramid_values.h), of which as many
// bytes are kept in memory as of `shown`. Throws Error if there is none at `path`.
std::unique_ptr<ChunkValues> otherValues(const Pyramid& shown, const std::string& path);

// Makes a chunk of every batch, several at once, and passes it on with its place in the order of
// the extraction. `take` is called from any thread, for several chunks at the same time; an
// exception of it ends the extraction.
class ChunkSink : public TriangleSink {
 public:
  using Take = std::function<void(std::size_t place, SurfaceChunk&& chunk)>;
  struct Values {
    const ChunkValues* of = nullptr;  // outlive the sink; null: none
    bool components = false;          // the colours of PlacedBatch::components instead
  };
  // `key`: of the chunks, but for their level and brick.
  ChunkSink(const ChunkKey& key, const Values& values, Take take)
      : surface_(key.surface), key_(key), values_(values), take_(std::move(take)) {}

  void place(PlacedBatch& placed) override { placed.first_byte = next_place_++; }
  void write(PlacedBatch& placed) override;

 private:
  int surface_;
  ChunkKey key_;
  Values values_;
  Take take_;
  std::uint64_t next_place_ = 0;
};

// Numbers for the vertices of one surface: the same place has the same one. The edge of the lattice
// that a vertex lies on is not a part of a chunk, but its position is the same to the bit on both
// sides of a brick, and no two edges have a crossing in one place (docs/ALGORITHM.md, rule 8).
class VertexPlaces {
 public:
  // `next`: for a place that is new. In the scene's lattice.
  std::uint64_t numberOf(const SurfaceChunk& chunk, const SurfaceVertex& vertex,
                         std::uint64_t next) {
    // Adding 0 makes the two zeros one.
    const glm::dvec3 at = chunk.origin + glm::dvec3(vertex.position) + 0.0;
    return numbers_.try_emplace({at.x, at.y, at.z}, next).first->second;
  }
  std::size_t size() const { return numbers_.size(); }

 private:
  using Place = std::array<double, 3>;
  struct Hash {
    std::size_t operator()(const Place& place) const {
      return checksum64(place.data(), sizeof(Place));
    }
  };
  std::unordered_map<Place, std::uint64_t, Hash> numbers_;
};

}  // namespace isobrick
