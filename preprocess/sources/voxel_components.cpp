#include "isobrick/preprocess/sources/voxel_components.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

class MagnitudeSource final : public VolumeSource {
 public:
  MagnitudeSource(VolumeInfo info, std::vector<std::unique_ptr<VolumeSource>> components)
      : info_(std::move(info)),
        components_(std::move(components)),
        squares_(static_cast<std::size_t>(info_.voxels.x)),
        row_(squares_.size() * sizeof(double)) {}  // of any number

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    auto* to = static_cast<float*>(out);
    for (std::int64_t row = first; row < first + count; ++row) {
      std::fill(squares_.begin(), squares_.end(), 0.0);
      for (const auto& component : components_) addRow(*component, row);
      for (const double square : squares_) *to++ = static_cast<float>(std::sqrt(square));
    }
  }

  std::vector<std::string> files() const override { return components_.front()->files(); }
  std::uint64_t bufferBytes() const override {
    std::uint64_t bytes = row_.size() + squares_.size() * sizeof(double);
    for (const auto& component : components_) bytes += component->bufferBytes();
    return bytes;
  }

 private:
  void addRow(VolumeSource& component, std::int64_t row) {
    component.readRows(row, 1, row_.data());
    visitNumberType(component.info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      const T* const values = reinterpret_cast<const T*>(row_.data());
      for (std::size_t i = 0; i < squares_.size(); ++i)
        squares_[i] += static_cast<double>(values[i]) * static_cast<double>(values[i]);
    });
  }

  VolumeInfo info_;
  std::vector<std::unique_ptr<VolumeSource>> components_;
  std::vector<double> squares_;
  std::vector<std::byte> row_;
};

}  // namespace

std::unique_ptr<VolumeSource> makeMagnitudeSource(
    VolumeInfo info, std::vector<std::unique_ptr<VolumeSource>> components) {
  return std::make_unique<MagnitudeSource>(std::move(info), std::move(components));
}

void checkComponentChoice(const std::string& path, std::uint64_t components,
                          const OpenOptions& options) {
  if (components == 1) return refuseComponentChoice(path, options);
  const std::string values = std::to_string(components) + " values per voxel";
  if (components == 0 || components > kMostComponents)
    throw unusable(path, "it has " + values + ", and 1 to " + std::to_string(kMostComponents) +
                             " are read; correct its header");
  if (!options.component)
    throw unusable(path,
                   "it has " + values + " (colour, vector or complex); extract one channel first",
                   {Remedy::kChooseComponent});
  const std::int64_t index = options.component->index;
  if (!options.component->magnitude &&
      (index < 0 || static_cast<std::uint64_t>(index) >= components))
    throw unusable(path,
                   "it has " + values + ", 0 to " + std::to_string(components - 1) +
                       ", and none is number " + std::to_string(index),
                   {Remedy::kChooseComponent});
}

void refuseComponentChoice(const std::string& path, const OpenOptions& options) {
  if (options.component)
    throw Error(
        "cannot take a component of '" + path +
            "': only single files of NRRD, MetaImage, NIfTI, MRC, VTI and TIFF have several "
            "values per voxel, where they say so; leave the choice out",
        {.path = path});
}

void takeComponent(std::uint64_t components, const OpenOptions& options, StoredVoxels& stored,
                   VolumeInfo& info) {
  if (components == 1) return;
  stored.components = static_cast<std::size_t>(components);
  stored.magnitude = options.component->magnitude;
  if (!stored.magnitude) stored.component = static_cast<std::size_t>(options.component->index);
  info.voxel_type = stored.delivered();
  info.encoding = stored.magnitude ? "magnitude" : "component " + std::to_string(stored.component);
  info.notes.push_back((stored.magnitude ? "the magnitude" : info.encoding) + " of " +
                       std::to_string(components) + " values per voxel was taken");
}

}  // namespace isobrick
