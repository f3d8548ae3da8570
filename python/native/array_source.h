// Arrays of Python as volume sources.
#pragma once

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace isobrick::python {

// Memory that numpy describes. Axes are x, y, z here, whatever their order in the array.
struct StridedArray {
  std::uintptr_t address = 0;  // of voxel (0, 0, 0)
  Index3 strides{0};           // in bytes from a voxel to the next along x, y, z; of any sign
  std::string type;            // "u1" "i1" "u2" "i2" "u4" "i4" "u8" "i8" "f2" "f4" "f8"
  bool is_swapped = false;     // of the other byte order
};

// The type of the numbers that a numpy type gives: its own, and float32 for halves. Throws Error
// for a type that is no number.
VoxelType deliveredType(const std::string& type);

// For every one of `points`, (x, y, z) in voxel indices on the edges of cells, the greatest
// difference of voxels within one of the cells that it is part of: `values` of scikit-image's
// marching_cubes. `type`: u1, i1, u2, i2 or f4, in this machine's byte order.
void cellContrasts(const StridedArray& array, const Index3& voxels, std::span<const double> points,
                   std::span<float> out);

// Reads straight from the array's memory, which outlives the source. `info` has all but the voxel
// type. Any number of threads may read.
std::unique_ptr<VolumeSource> makeStridedSource(VolumeInfo info, const StridedArray& array,
                                                std::string identity, const Derivation& derivation);

// Asks `read(x, y, z, nx, ny, nz)` for boxes, which gives a C-contiguous array [z, y, x] of the
// type of `info`. Takes the interpreter's lock for that. `read` outlives the source, which may go
// on any thread. `buffer_bytes`: what the reader itself holds.
std::unique_ptr<VolumeSource> makeReaderSource(VolumeInfo info, nanobind::handle read,
                                               std::uint64_t buffer_bytes, std::string identity,
                                               const Derivation& derivation);

}  // namespace isobrick::python
