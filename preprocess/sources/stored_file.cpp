#include "isobrick/preprocess/sources/stored_file.h"

#include <string>

namespace isobrick {

void StoredBlock::read(const IndexBox& box, void* out) const {
  // As few reads as the file allows: rows that adjoin are one.
  const bool has_whole_rows = box.count.x == voxels.x;
  const bool has_whole_slices = has_whole_rows && box.count.y == voxels.y;
  const std::int64_t slices = has_whole_slices ? 1 : box.count.z;
  const std::int64_t rows = has_whole_rows ? 1 : box.count.y;
  const std::int64_t count = box.size() / (slices * rows);
  const std::uint64_t slice_bytes =
      static_cast<std::uint64_t>(voxels.x * voxels.y) * stored.bytes();
  auto* to = static_cast<std::byte*>(out);
  for (std::int64_t z = 0; z < slices; ++z)
    for (std::int64_t y = 0; y < rows; ++y) {
      const std::int64_t first = linearIndex(box.first + Index3(0, y, z), voxels);
      std::uint64_t next = at + static_cast<std::uint64_t>(first) * stored.bytes();
      decodeVoxels(
          stored, static_cast<std::size_t>(count), to, [&](std::byte* part, std::size_t n) {
            const std::size_t got = file.readAt(next, part, n);
            next += got;
            if (got < n)
              throw becameShorter(
                  file, first_slice + static_cast<std::int64_t>((next - at) / slice_bytes), next);
          });
      to += static_cast<std::size_t>(count) * voxelBytes(stored.delivered());
    }
}

Error becameShorter(const InputFile& file, std::int64_t slice, std::uint64_t at) {
  return Error("cannot read slice " + std::to_string(slice) + " of '" + file.path() + "' at byte " +
                   std::to_string(at) +
                   ": the file became shorter meanwhile; check the file, then run again",
               {.path = file.path()});
}

}  // namespace isobrick
