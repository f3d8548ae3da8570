// A triangle sink that makes the chunks of a picture.
#pragma once

#include <functional>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/viewer/render/surface_chunk.h"
#include "isobrick/viewer/stream/chunk_values.h"

namespace isobrick {

// Makes a chunk of every batch, several at once, and hands it on with its place in the order of the
// extraction. `take` is called from any thread, for several chunks at the same time; what it throws
// ends the extraction.
class ChunkSink : public TriangleSink {
 public:
  using Take = std::function<void(std::size_t place, SurfaceChunk&& chunk)>;
  // `key`: of the chunks, but for their level and brick. `values`: of the vertices; null: they have
  // none. Outlives the sink.
  ChunkSink(const ChunkKey& key, const ChunkValues* values, Take take)
      : surface_(key.surface), key_(key), values_(values), take_(std::move(take)) {}

  void place(PlacedBatch& placed) override { placed.first_byte = next_place_++; }
  void write(PlacedBatch& placed) override;

 private:
  int surface_;
  ChunkKey key_;
  const ChunkValues* values_;
  Take take_;
  std::uint64_t next_place_ = 0;
};

// Where the chunks of a volume lie in the world.
SceneLattice latticeOf(const GridGeometry& geometry);

}  // namespace isobrick
