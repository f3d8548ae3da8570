#include "isobrick/preprocess/sources/assembled_source.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <utility>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

// The boxes' borders along each axis divide the whole into cells, each of which lies in a box or
// not.
class CoverCheck {
 public:
  CoverCheck(const std::string& path, const Index3& voxels, const std::vector<VolumePart>& parts) {
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<std::int64_t>& cuts = cuts_[static_cast<std::size_t>(axis)];
      cuts = {0, voxels[axis]};
      for (const VolumePart& part : parts) {
        cuts.push_back(part.first[axis]);
        cuts.push_back(part.first[axis] + part.source->info().voxels[axis]);
      }
      std::sort(cuts.begin(), cuts.end());
      cuts.erase(std::unique(cuts.begin(), cuts.end()), cuts.end());
      cells_[axis] = static_cast<std::int64_t>(cuts.size()) - 1;
    }
    constexpr std::int64_t kMostSteps = std::int64_t{1} << 26;
    if (elementCount(cells_) > kMostSteps / static_cast<std::int64_t>(parts.size()))
      throw unusable(path, "it has " + std::to_string(parts.size()) +
                               " pieces, which are too many; save it in fewer");
    covered_.resize(static_cast<std::size_t>(elementCount(cells_)));
    for (const VolumePart& part : parts) mark(part.first, part.first + part.source->info().voxels);
    const auto hole = std::find(covered_.begin(), covered_.end(), false);
    if (hole == covered_.end()) return;
    const std::int64_t at = hole - covered_.begin();
    const Index3 cell(at % cells_.x, at / cells_.x % cells_.y, at / cells_.x / cells_.y);
    throw unusable(path, "none of its pieces has the voxel " +
                             indexText({cuts_[0][static_cast<std::size_t>(cell.x)],
                                        cuts_[1][static_cast<std::size_t>(cell.y)],
                                        cuts_[2][static_cast<std::size_t>(cell.z)]}) +
                             "; save the whole of it");
  }

 private:
  std::int64_t cellAt(int axis, std::int64_t cut) const {
    const auto& cuts = cuts_[static_cast<std::size_t>(axis)];
    return std::lower_bound(cuts.begin(), cuts.end(), cut) - cuts.begin();
  }
  void mark(const Index3& first, const Index3& end) {
    for (std::int64_t z = cellAt(2, first.z); z < cellAt(2, end.z); ++z)
      for (std::int64_t y = cellAt(1, first.y); y < cellAt(1, end.y); ++y) {
        const auto row = covered_.begin() + (z * cells_.y + y) * cells_.x;
        std::fill(row + cellAt(0, first.x), row + cellAt(0, end.x), true);
      }
  }

  std::array<std::vector<std::int64_t>, 3> cuts_;
  Index3 cells_{0};
  std::vector<bool> covered_;
};

class AssembledSource final : public VolumeSource {
 public:
  AssembledSource(VolumeInfo info, std::vector<VolumePart> parts, std::vector<std::string> files)
      : info_(std::move(info)), parts_(std::move(parts)), files_(std::move(files)) {
    const CoverCheck check(info_.source, info_.voxels, parts_);
    row_.resize(static_cast<std::size_t>(info_.voxels.x) * voxelBytes(info_.voxel_type));
  }

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t row = first; row < first + count; ++row, to += row_.size())
      for (VolumePart& part : parts_)
        readRow(part, row % info_.voxels.y - part.first.y, row / info_.voxels.y - part.first.z, to);
  }

  std::vector<std::string> files() const override {
    std::vector<std::string> files = files_;
    for (const VolumePart& part : parts_)
      for (const std::string& file : part.source->files())
        if (std::find(files.begin(), files.end(), file) == files.end()) files.push_back(file);
    return files;
  }
  std::uint64_t bufferBytes() const override {
    std::uint64_t bytes = row_.size();
    for (const VolumePart& part : parts_) bytes += part.source->bufferBytes();
    return bytes;
  }

 private:
  // What the part has of a row of the whole; y and z are its own.
  void readRow(VolumePart& part, std::int64_t y, std::int64_t z, std::byte* out) {
    const Index3& voxels = part.source->info().voxels;
    if (y < 0 || y >= voxels.y || z < 0 || z >= voxels.z) return;
    part.source->readRows(z * voxels.y + y, 1, row_.data());
    const std::size_t bytes = voxelBytes(info_.voxel_type);
    std::memcpy(out + static_cast<std::size_t>(part.first.x) * bytes, row_.data(),
                static_cast<std::size_t>(voxels.x) * bytes);
  }

  VolumeInfo info_;
  std::vector<VolumePart> parts_;
  std::vector<std::string> files_;
  std::vector<std::byte> row_;  // of a part
};

}  // namespace

std::unique_ptr<VolumeSource> makeAssembledSource(VolumeInfo info, std::vector<VolumePart> parts,
                                                  std::vector<std::string> files) {
  return std::make_unique<AssembledSource>(std::move(info), std::move(parts), std::move(files));
}

}  // namespace isobrick
