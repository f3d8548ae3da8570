#include "isobrick/preprocess/export/formats/spooled_source.h"

#include <utility>

#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/scratch_volume.h"

namespace isobrick {
namespace {

class SpooledSource final : public VolumeSource {
 public:
  SpooledSource(std::unique_ptr<VolumeSource> source, const std::string& folder,
                const VolumeWriteOptions& options)
      : info_(source->info()),
        files_(source->files()),
        identity_(source->identity()),
        voxels_(info_.voxels, voxelBytes(info_.voxel_type), ScratchVolume::Place::kFile, folder) {
    VolumeWriteOptions quiet = options;
    quiet.progress = nullptr;
    quiet.memory_bytes = std::min(quiet.memory_bytes, std::uint64_t{16} << 20);
    forEachRun(*source, quiet, [&](std::int64_t first, std::int64_t rows, const std::byte* data) {
      // Whole slices, or rows of one.
      const std::int64_t y = first % info_.voxels.y, z = first / info_.voxels.y;
      const std::int64_t slices = std::max(std::int64_t{1}, rows / info_.voxels.y);
      voxels_.write({Index3(0, y, z), Index3(info_.voxels.x, rows / slices, slices)}, data);
    });
    notes_of_reading_ = source->notesOfReading();
  }

  const VolumeInfo& info() const override { return info_; }
  bool readsBoxes() const override { return true; }
  std::vector<std::string> files() const override { return files_; }
  std::string identity() const override { return identity_; }
  std::vector<std::string> notesOfReading() const override { return notes_of_reading_; }
  void readBox(const IndexBox& box, void* out) const override { voxels_.read(box, out); }
  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t row = first; row < first + count; ++row, to += rowBytes(info_))
      readBox({Index3(0, row % info_.voxels.y, row / info_.voxels.y), Index3(info_.voxels.x, 1, 1)},
              to);
  }

 private:
  VolumeInfo info_;
  std::vector<std::string> files_;
  std::string identity_;
  std::vector<std::string> notes_of_reading_;
  ScratchVolume voxels_;
};

}  // namespace

std::unique_ptr<VolumeSource> makeSpooledSource(std::unique_ptr<VolumeSource> source,
                                                const std::string& folder,
                                                const VolumeWriteOptions& options) {
  return std::make_unique<SpooledSource>(std::move(source), folder, options);
}

}  // namespace isobrick
