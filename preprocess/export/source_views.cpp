#include "isobrick/preprocess/export/source_views.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/usable_geometry.h"

namespace isobrick {
namespace {

// The common part of all views of a volume.
class SourceView : public VolumeSource {
 public:
  const VolumeInfo& info() const final { return info_; }
  bool readsBoxes() const final { return source_->readsBoxes(); }
  std::vector<std::string> files() const final { return source_->files(); }
  std::vector<std::string> notesOfReading() const final { return source_->notesOfReading(); }
  std::string identity() const final {
    const std::string identity = source_->identity();
    return identity.empty() ? identity : identity + "; " + info_.encoding;
  }
  std::uint64_t bufferBytes() const override { return source_->bufferBytes(); }
  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    source_->readRows(first, count, out);
  }
  void readBox(const IndexBox& box, void* out) const override { source_->readBox(box, out); }

 protected:
  SourceView(std::unique_ptr<VolumeSource> source, const std::string& what)
      : source_(std::move(source)), info_(source_->info()) {
    info_.encoding += (info_.encoding.empty() ? "" : "; ") + what;
  }

  std::unique_ptr<VolumeSource> source_;
  VolumeInfo info_;
};

class CroppedSource final : public SourceView {
 public:
  CroppedSource(std::unique_ptr<VolumeSource> source, const IndexBox& box)
      : SourceView(std::move(source),
                   "box " + indexText(box.first) + " to " + indexText(box.end() - Index3(1))),
        box_(box) {
    info_.voxels = box.count;
    info_.geometry.origin = source_->info().geometry.indexToWorld(glm::dvec3(box.first));
    // If the voxels lie in a grid of their own.
    if (const auto first = info_.properties.find("vdb.first"); first != info_.properties.end())
      info_.properties.erase(first);
  }

  std::uint64_t bufferBytes() const override {
    return source_->bufferBytes() + (readsBoxes() ? 0 : wholeRowBytes());
  }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    if (readsBoxes()) return VolumeSource::readRows(first, count, out);
    auto* to = static_cast<std::byte*>(out);
    const std::size_t bytes = voxelBytes(info_.voxel_type);
    const std::size_t row_bytes = static_cast<std::size_t>(box_.count.x) * bytes;
    row_.resize(wholeRowBytes());
    for (std::int64_t row = first; row < first + count; ++row, to += row_bytes) {
      const std::int64_t y = box_.first.y + row % box_.count.y;
      const std::int64_t z = box_.first.z + row / box_.count.y;
      source_->readRows(z * source_->info().voxels.y + y, 1, row_.data());
      std::copy_n(row_.data() + static_cast<std::size_t>(box_.first.x) * bytes, row_bytes, to);
    }
  }

  void readBox(const IndexBox& box, void* out) const override {
    source_->readBox({box_.first + box.first, box.count}, out);
  }

 private:
  std::size_t wholeRowBytes() const {
    return static_cast<std::size_t>(source_->info().voxels.x) * voxelBytes(info_.voxel_type);
  }

  IndexBox box_;
  std::vector<std::byte> row_;  // of the source, if it is read by rows
};

class PlacedSource final : public SourceView {
 public:
  PlacedSource(std::unique_ptr<VolumeSource> source, const std::optional<glm::dvec3>& spacing,
               const std::optional<glm::dvec3>& origin)
      : SourceView(std::move(source), (spacing ? "spacing " + pointText(*spacing) : "") +
                                          (spacing && origin ? "; " : "") +
                                          (origin ? "origin " + pointText(*origin) : "")) {
    const auto place = [&](const char* what, const std::optional<glm::dvec3>& given,
                           glm::dvec3& now) {
      if (!given) return;
      info_.notes.push_back(std::string(what) + " " + pointText(*given) +
                            " was given in place of " + pointText(now));
      now = *given;
    };
    place("the spacing", spacing, info_.geometry.spacing);
    place("the origin", origin, info_.geometry.origin);
    if (!isUsableGeometry(info_.geometry))
      throw Error("cannot use '" + info_.source + "' with the spacing " +
                      pointText(info_.geometry.spacing) + " and the origin " +
                      pointText(info_.geometry.origin) + ": choose spacings above 0",
                  {.path = info_.source});
  }
};

// Maps one value after the other; map(in, out) gets the types.
class MappedSource : public SourceView {
 public:
  std::uint64_t bufferBytes() const final { return source_->bufferBytes() + kBlockBytes; }

  void readRows(std::int64_t first, std::int64_t count, void* out) final {
    const std::int64_t row = info_.voxels.x;
    const std::size_t in_bytes = voxelBytes(source_->info().voxel_type);
    const std::int64_t most = std::max(
        std::int64_t{1},
        static_cast<std::int64_t>(kBlockBytes / (static_cast<std::size_t>(row) * in_bytes)));
    auto* to = static_cast<std::byte*>(out);
    while (count > 0) {
      const std::int64_t rows = std::min(most, count);
      block_.resize(static_cast<std::size_t>(rows * row) * in_bytes);
      source_->readRows(first, rows, block_.data());
      mapValues(block_.data(), static_cast<std::size_t>(rows * row), to);
      to += static_cast<std::size_t>(rows * row) * voxelBytes(info_.voxel_type);
      first += rows;
      count -= rows;
    }
  }

  void readBox(const IndexBox& box, void* out) const final {
    std::vector<std::byte> block(static_cast<std::size_t>(box.size()) *
                                 voxelBytes(source_->info().voxel_type));
    source_->readBox(box, block.data());
    mapValues(block.data(), static_cast<std::size_t>(box.size()), out);
  }

 protected:
  using SourceView::SourceView;

 private:
  // For the source's type and of info_.voxel_type.
  virtual void mapValues(const std::byte* from, std::size_t count, void* to) const = 0;

  static constexpr std::size_t kBlockBytes = std::size_t{1} << 20;
  std::vector<std::byte> block_;
};

class FloatSource final : public MappedSource {
 public:
  explicit FloatSource(std::unique_ptr<VolumeSource> source)
      : MappedSource(std::move(source), "as float32") {
    info_.voxel_type = VoxelType::kFloat32;
  }

 private:
  void mapValues(const std::byte* from, std::size_t count, void* to) const override {
    visitVoxelType(source_->info().voxel_type, [&](auto tag) {
      using In = typename decltype(tag)::Type;
      const In* const in = reinterpret_cast<const In*>(from);
      std::transform(in, in + count, static_cast<float*>(to),
                     [](In value) { return static_cast<float>(value); });
    });
  }
};

class WindowedSource final : public MappedSource {
 public:
  WindowedSource(std::unique_ptr<VolumeSource> source, const ValueWindow& window, VoxelType type)
      : MappedSource(std::move(source), "window " + numberText(window.low) + "," +
                                            numberText(window.high) + " as " +
                                            std::string(voxelTypeName(type))),
        window_(window) {
    info_.voxel_type = type;
    // Backgrounds and classes are about the values as they were.
    std::erase_if(info_.properties, [](const auto& p) { return p.first.starts_with("vdb."); });
    visitVoxelType(type, [&](auto tag) {
      using Out = typename decltype(tag)::Type;
      if constexpr (std::is_integral_v<Out>) {
        least_ = std::numeric_limits<Out>::min();
        most_ = std::numeric_limits<Out>::max();
      }
    });
    info_.notes.push_back(
        "values were cut to " + numberText(window.low) + " .. " + numberText(window.high) +
        " and rounded to steps of " + numberText((window.high - window.low) / (most_ - least_)) +
        ": value = " + numberText(window.low) + " + (stored - " + numberText(least_) + ") * " +
        numberText((window.high - window.low) / (most_ - least_)));
  }

 private:
  void mapValues(const std::byte* from, std::size_t count, void* to) const override {
    const double steps = most_ - least_;
    const double low = window_.low, scale = steps / (window_.high - window_.low);
    const auto least = static_cast<std::int32_t>(least_);
    visitVoxelType(source_->info().voxel_type, [&](auto in_tag) {
      visitVoxelType(info_.voxel_type, [&](auto out_tag) {
        using In = typename decltype(in_tag)::Type;
        using Out = typename decltype(out_tag)::Type;
        const In* const in = reinterpret_cast<const In*>(from);
        Out* const out = static_cast<Out*>(to);
        for (std::size_t i = 0; i < count; ++i) {
          const double step = std::min((static_cast<double>(in[i]) - low) * scale, steps);
          // NaN becomes the least: it compares with nothing.
          out[i] = static_cast<Out>(least + static_cast<std::int32_t>(step > 0 ? step + 0.5 : 0.0));
        }
      });
    });
  }

  ValueWindow window_;
  double least_ = 0, most_ = 0;  // of the type
};

}  // namespace

std::unique_ptr<VolumeSource> makeCroppedSource(std::unique_ptr<VolumeSource> source,
                                                const IndexBox& box) {
  const VolumeInfo& info = source->info();
  for (int axis = 0; axis < 3; ++axis)
    // Without a sum, which might not fit into 64 bits.
    if (box.first[axis] < 0 || box.count[axis] < 2 || box.count[axis] > info.voxels[axis] ||
        box.first[axis] > info.voxels[axis] - box.count[axis])
      throw Error("cannot cut '" + info.source + "' to a box of " + indexText(box.count) +
                      " voxels from " + indexText(box.first) + " on: it has the voxels 0,0,0 to " +
                      indexText(info.voxels - Index3(1)) +
                      ", and at least two are needed along every axis; choose a box within",
                  {.path = info.source});
  return std::make_unique<CroppedSource>(std::move(source), box);
}

std::unique_ptr<VolumeSource> makeFloatSource(std::unique_ptr<VolumeSource> source) {
  return std::make_unique<FloatSource>(std::move(source));
}

std::unique_ptr<VolumeSource> makeWindowedSource(std::unique_ptr<VolumeSource> source,
                                                 const ValueWindow& window, VoxelType type) {
  if (!(window.low < window.high) || !std::isfinite(window.high - window.low))
    throw Error("the window " + numberText(window.low) + "," + numberText(window.high) +
                " is empty; give the lower value first");
  if (type == VoxelType::kFloat32)
    throw Error("a window is for integer voxels; leave it out for float32");
  return std::make_unique<WindowedSource>(std::move(source), window, type);
}

std::unique_ptr<VolumeSource> makePlacedSource(std::unique_ptr<VolumeSource> source,
                                               const std::optional<glm::dvec3>& spacing,
                                               const std::optional<glm::dvec3>& origin) {
  return std::make_unique<PlacedSource>(std::move(source), spacing, origin);
}

}  // namespace isobrick
