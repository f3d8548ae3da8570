#include "isobrick/preprocess/export/formats/spooled_source.h"

#include <algorithm>

#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/scratch_source.h"

namespace isobrick {

std::unique_ptr<VolumeSource> makeSpooledSource(std::unique_ptr<VolumeSource> source,
                                                const std::string& folder,
                                                const VolumeWriteOptions& options) {
  auto spooled = std::make_unique<ScratchSource>(*source, 0, source->info().voxels.z, folder);
  VolumeWriteOptions quiet = options;
  quiet.progress = nullptr;
  quiet.memory_bytes = std::min(quiet.memory_bytes, std::uint64_t{16} << 20);
  forEachRun(*source, quiet, [&](std::int64_t first, std::int64_t rows, const std::byte* data) {
    spooled->writeRows(first, rows, data);
  });
  spooled->finish(*source);
  return spooled;
}

}  // namespace isobrick
