// The subject of a benchmark: one way to get from a volume to the triangles of an isosurface.
#pragma once

#include <cstdint>
#include <string>

#include "tools/bench/plain_mesh.h"

namespace isobrick {

struct SurfaceSize {
  std::uint64_t triangles = 0, vertices = 0;
  std::uint64_t bytes = 0;  // of the mesh in memory: positions, normals, triangles
};

// Its members are called in this order, extract() any number of times. Also included as C++17, for
// VTK's sake.
class SurfaceEngine {
 public:
  virtual ~SurfaceEngine() = default;

  // The volume comes into memory, or is opened.
  virtual void load() = 0;
  // Prepares the volume before any surface can be extracted.
  virtual void prepare() {}
  // A surface into memory, in the place of the one before.
  virtual void extract() = 0;
  virtual SurfaceSize size() const = 0;
  virtual PlainMesh mesh() const = 0;
  // The way of this engine, if it differs from the others.
  virtual std::string note() const { return {}; }
};

}  // namespace isobrick
