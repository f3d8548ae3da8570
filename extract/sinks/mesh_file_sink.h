// Meshes streamed to files; nothing but shared vertices stays in memory.
#pragma once

#include <memory>
#include <string>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/cancel.h"

namespace isobrick {

// A sink that writes a file and publishes it in finish().
class MeshFileSink : public TriangleSink {
 public:
  // Distinct vertices written; for STL, which has none, three a triangle.
  virtual std::uint64_t vertices() const = 0;
};

// Makes a sink for `path`; its extension decides:
//   .ply  binary little-endian: x y z (float, or double where MeshFrame says that single precision
//         does not separate crossings), nx ny nz, faces with the pyramid level as `level`
//   .stl  binary: triangles without shared vertices, at most 2^32 - 1
// Throws Error for another extension and for a path that cannot be written. The file appears under
// its name in finish(); a sink that is destroyed earlier leaves nothing. finish() looks at
// `cancel`, which may be null and outlives the sink: throws Cancelled, and no file is left.
std::unique_ptr<MeshFileSink> makeMeshFileSink(const std::string& path,
                                               const CancelFlag* cancel = nullptr);

}  // namespace isobrick
