// The parts of a brick as they go to the file: constants found, bytes compressed, checksums made;
// and the way back.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "isobrick/storage/format.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// One part of a brick: its elements as they are, and after encodeBrick() as they are stored.
struct EncodedPart {
  std::vector<std::byte> bytes;
  std::uint64_t checksum = 0;
  format::Codec codec = format::Codec::kAbsent;
};

// One brick on its way to the file. Meant to be used again for the next brick: its memory stays.
struct EncodedBrick {
  EncodedPart samples;    // layout.brickSampleBox() voxels, x fastest
  EncodedPart ranges;     // a (min, max) pair of voxels for every tile, x fastest
  EncodedPart curvature;  // codes (DeviationCode) of every block; empty: the brick has none
  float constant = 0;     // the value of all samples, if they are equal
  // The samples stay in the source: their bytes go no further than their checksum.
  bool is_in_source = false;
  // The memory that encodeBrick() packs into: as many bytes as its largest part has elements'
  // bytes.
  std::vector<std::byte> scratch;
};

// Turns the elements in the three parts of `brick` into the stored bytes: none for constant parts,
// else the bytes packed by `codec` (kStored, kLz4 or kZstd), or as they are if packing saves less
// than a sixteenth of them. Thread-safe. The result depends on the elements, the codec and the
// versions of Blosc, LZ4 and Zstandard alone.
void encodeBrick(VoxelType type, format::Codec codec, EncodedBrick& brick);

// The same for a part that belongs to no brick: numbers of `element_bytes` (1, 2, 4 or 8) bytes.
void encodeNumbers(std::size_t element_bytes, format::Codec codec, EncodedPart& part);

// Parts of more bytes cannot be packed; no brick has one (256^3 cells of float32 take 70 MB).
inline constexpr std::uint64_t kMostPackedBytes = (std::uint64_t{1} << 31) - 1 - 16;

// Restores the elements of a part: `bytes` is their size, known from the layout. False if the
// stored bytes are not the codec's form of that many bytes; `out` is then worthless, but nothing
// past `bytes` was written. Any stored bytes are safe, and cost time in proportion to stored bytes
// and `bytes`; but they must not change meanwhile, so they must not lie in the map of a file. Uses
// up to 3 MiB of its own while it works. Thread-safe.
[[nodiscard]] bool decodePart(format::Codec codec, std::span<const std::byte> stored,
                              std::size_t bytes, std::byte* out);

}  // namespace isobrick
