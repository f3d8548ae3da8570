// Writing a pyramid: bricks in any order under a temporary name, published as a whole.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "storage/atomic_file.h"
#include "storage/pyramid_info.h"

namespace isobrick {

// One part of a brick as it goes to the file.
struct EncodedPart {
  std::vector<std::byte> bytes;
  std::uint64_t checksum = 0;
  format::Codec codec = format::Codec::kAbsent;
};

// One brick, ready to be written. Made by many threads at once, without a writer.
struct EncodedBrick {
  EncodedPart samples;
  EncodedPart ranges;
  EncodedPart curvature;
  ValueRange range;
  float constant = 0;
};

// Encodes the parts of a brick. Thread-safe.
//   samples    layout.brickSampleBox() voxels of `type`, x fastest
//   ranges     a (min, max) pair of `type` for every tile, x fastest
//   curvature  three coefficients (CurvatureCode) for every node; empty where the brick has none
//   range      closure over all the brick's cells
EncodedBrick encodeBrick(VoxelType type, std::span<const std::byte> samples,
                         std::span<const std::byte> ranges, std::span<const std::uint8_t> curvature,
                         const ValueRange& range);

// Writes `path`. Nothing has that name before finish() returned; a writer that is destroyed earlier
// removes its temporary. One thread at a time. Every failed write throws Error.
class PyramidWriter {
 public:
  PyramidWriter(const std::string& path, const PyramidSpec& spec);

  void write(int level, const Index3& brick, const EncodedBrick& encoded);

  // Writes tables, provenance (JSON) and header, makes them durable and publishes the file. Every
  // brick of every level was written before. Returns the size of the file in bytes.
  std::uint64_t finish(const ValueRange& voxel_range, const std::string& provenance_json);

 private:
  format::PartRecord append(const EncodedPart& part, std::uint64_t alignment);
  void padTo(std::uint64_t alignment);

  PyramidSpec spec_;
  BrickLayout layout_;
  AtomicFile file_;
  std::uint64_t end_ = 0;  // where the next byte goes
  std::vector<format::LevelRecord> level_table_;
  std::vector<format::BrickRecord> brick_table_;
  std::size_t bricks_written_ = 0;
};

}  // namespace isobrick
