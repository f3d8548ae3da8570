// Voxels that lie in a file as they are. Private to preprocess/sources/.
#pragma once

#include <cstdint>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// A block of `voxels`, x fastest, whose first one is at byte `at` of `file`. Messages count its
// slices from `first_slice`.
struct StoredBlock {
  const InputFile& file;
  std::uint64_t at = 0;
  StoredVoxels stored;
  Index3 voxels{0};
  std::int64_t first_slice = 0;

  // Delivers the voxels of `box` to `out`. Throws Error that names the slice if the file ends.
  void read(const IndexBox& box, void* out) const;
};

// The file ended at byte `at`, and was longer when it was opened.
Error becameShorter(const InputFile& file, std::int64_t slice, std::uint64_t at);

}  // namespace isobrick
