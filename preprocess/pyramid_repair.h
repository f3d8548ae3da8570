// Puts a damaged pyramid right, to the bytes that it had.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// How a pyramid is repaired.
struct RepairOptions {
  // Opens the volume that the pyramid was made of; asked if bricks of level 0 or the provenance are
  // damaged, for each file. `named` is its path or name in the provenance, "" if that is lost.
  // Empty, or a null pointer: there is none. An Error becomes one of RepairReport::losses.
  std::function<std::unique_ptr<VolumeSource>(const std::string& named)> open_source;
  std::uint64_t memory_bytes = std::uint64_t{1} << 30;  // as of BuildOptions
  std::string tool_version;                             // likewise
  const CancelFlag* cancel = nullptr;                   // may be null
  BuildProgress progress;                               // may be empty
};

// A brick of level 0 whose samples are nowhere any more.
struct LostBrick {
  Index3 brick{0};  // its place in level 0
  IndexBox voxels;  // of level 0, that are its own
};

// What repairPyramid() did.
struct RepairReport {
  std::vector<std::string> mended;  // paths of the files that were replaced
  std::vector<LostBrick> lost;      // stay damaged, and what takes in their voxels with them
  std::vector<std::string> losses;  // what else stays damaged, and why: a line each
};

// Repairs a pyramid that verifyPyramid() or opening it found damaged: `path` is a file, or the
// folder of a divided pyramid. It is built again beside the old one: of its own bricks of level 0,
// or of the source if some are damaged, with the options that its header and provenance record, and
// takes the old one's name only if header and rows of the brick table, as far as they are whole,
// are the same: so its bytes are those that they were, and another source is refused. Else those
// parts of it go into a copy of the old file whose checksums that has. A single wrong byte of
// header, row of the brick table or provenance is put right by the checksum. The old file stays as
// it is until the new one is complete and durable. A file that is sound is built again, too.
//
// Throws Error if nothing is left to begin with, as buildPyramid() else, and Cancelled.
RepairReport repairPyramid(const std::string& path, const RepairOptions& options);

}  // namespace isobrick
