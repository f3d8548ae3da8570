#include <ImathBox.h>
#include <ImathMatrix.h>
#include <ImathVec.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfVecAttribute.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> exrFilesIn(const std::string& folder) {
  std::vector<std::string> files;
  for (std::string& file : filesInFolder(folder))
    if (lowerExtension(file) == ".exr") files.push_back(std::move(file));
  std::ranges::sort(files, numericNameLess);
  return files;
}

// Which channel of which part.
struct ExrChannel {
  int part = 0;
  std::string name;
  Imf::PixelType type = Imf::HALF;
};

// An open file. The library throws for a damaged file, and prints nothing.
class ExrFile {
 public:
  explicit ExrFile(const std::string& path) : path_(path), bytes_(InputFile(path).size()) {
    guarded([&] { file_ = std::make_unique<Imf::MultiPartInputFile>(path.c_str(), 0, false); });
  }

  const Imf::Header& header(int part) const { return file_->header(part); }
  int parts() const { return file_->parts(); }

  // Pixels of a part; refuses more than a file of this size can hold.
  Index3 pixels(int part) const {
    const Imath::Box2i window = header(part).dataWindow();
    const Index3 pixels(std::int64_t{window.max.x} - window.min.x + 1,
                        std::int64_t{window.max.y} - window.min.y + 1, 2);
    checkVoxelCounts(path_, pixels);
    constexpr std::uint64_t kMostRatio = 4096, kAlways = std::uint64_t{1} << 24;
    if (static_cast<std::uint64_t>(pixels.x * pixels.y) > bytes_ * kMostRatio + kAlways)
      throw damaged("its data window has more pixels than it can hold");
    return pixels;
  }

  // Named, or the usual one, or the first.
  std::optional<ExrChannel> findChannel(const std::string& wanted,
                                        std::vector<std::string>& all) const {
    std::optional<ExrChannel> first, usual, named;
    for (int part = 0; part < parts(); ++part) {
      const Imf::Header& h = header(part);
      if (h.hasType() && (h.type() == Imf::DEEPSCANLINE || h.type() == Imf::DEEPTILE)) continue;
      for (auto at = h.channels().begin(); at != h.channels().end(); ++at) {
        const ExrChannel channel{part, at.name(), at.channel().type};
        if (at.channel().xSampling != 1 || at.channel().ySampling != 1) continue;
        all.push_back(channel.name);
        if (!first) first = channel;
        if (!usual && channel.name == "Y") usual = channel;
        if (!named && channel.name == wanted) named = channel;
      }
    }
    if (!wanted.empty()) return named;
    return usual ? usual : first;
  }

  // Row by row; floats, or the numbers of a UINT channel.
  void read(const ExrChannel& channel, const Index3& pixels, std::uint32_t* out) {
    guarded([&] {
      Imf::InputPart part(*file_, channel.part);
      const Imath::Box2i window = header(channel.part).dataWindow();
      const auto row_bytes = static_cast<std::size_t>(pixels.x) * sizeof *out;
      Imf::FrameBuffer buffer;
      buffer.insert(channel.name,
                    Imf::Slice::Make(channel.type == Imf::UINT ? Imf::UINT : Imf::FLOAT, out,
                                     window, sizeof *out, row_bytes));
      part.setFrameBuffer(buffer);
      part.readPixels(window.min.y, window.max.y);
    });
  }

 private:
  Error damaged(const std::string& why) const {
    return unreadable(path_, why,
                      "; get the whole file again, or move it elsewhere if it is no slice");
  }
  template <typename Work>
  void guarded(Work&& work) const {
    try {
      work();
    } catch (const Error&) {
      throw;
    } catch (const std::exception& failure) {
      throw damaged("OpenEXR reports " + quotedText(failure.what(), 150));
    }
  }

  std::string path_;
  std::uint64_t bytes_;
  std::unique_ptr<Imf::MultiPartInputFile> file_;
};

// The attributes that isobrick wrote beside the pixels, if all of them are there.
void takeOwnAttributes(const Imf::Header& header, VolumeInfo& info, bool& has_geometry) {
  const auto* const spacing = header.findTypedAttribute<Imf::V3dAttribute>("isobrickSpacing");
  const auto* const origin = header.findTypedAttribute<Imf::V3dAttribute>("isobrickOrigin");
  const auto* const direction = header.findTypedAttribute<Imf::M33dAttribute>("isobrickDirection");
  const auto* const type = header.findTypedAttribute<Imf::StringAttribute>("isobrickType");
  if (type != nullptr)
    for (std::uint32_t i = 0; i < kVoxelTypeCount; ++i)
      if (type->value() == voxelTypeName(static_cast<VoxelType>(i)))
        info.voxel_type = static_cast<VoxelType>(i);
  has_geometry = spacing != nullptr && origin != nullptr && direction != nullptr;
  if (!has_geometry) return;
  const auto* const unit = header.findTypedAttribute<Imf::StringAttribute>("isobrickLengthUnit");
  if (unit != nullptr && unit->value() == lengthUnitName(LengthUnit::kMillimetre))
    info.geometry.unit = LengthUnit::kMillimetre;
  for (int axis = 0; axis < 3; ++axis) {
    info.geometry.spacing[axis] = spacing->value()[static_cast<unsigned>(axis)];
    info.geometry.origin[axis] = origin->value()[static_cast<unsigned>(axis)];
    for (int row = 0; row < 3; ++row)
      info.geometry.direction[axis][row] = direction->value()[axis][row];
  }
}

class ExrSlices final : public VolumeSource {
 public:
  ExrSlices(const std::string& folder, const OpenOptions& options)
      : files_(exrFilesIn(folder)), cancel_(options.cancel) {
    info_.source = folder;
    info_.format = "OpenEXR stack";
    info_.voxel_type = VoxelType::kFloat32;
    files_ = chooseSlices(files_, options, info_);
    const ExrFile first(files_.front());
    std::vector<std::string> all;
    const auto channel = first.findChannel(options.grid, all);
    ListText list(", ", SIZE_MAX);
    for (const std::string& name : all) list.add(quotedText(name, 40));
    if (!channel)
      throw unusable(files_.front(), "it has no channel ", quotedText(options.grid, 40),
                     "; it has ", all.empty() ? "none" : list.text());
    channel_ = *channel;
    if (all.size() > 1 && options.grid.empty())
      info_.notes.push_back("of the channels " + list.text() + ", " +
                            quotedText(channel_.name, 40) + " was taken");
    if (!options.grid.empty())
      info_.encoding +=
          (info_.encoding.empty() ? "" : "; ") + ("channel " + quotedText(options.grid, 40));
    info_.voxels = first.pixels(channel_.part);
    info_.voxels.z = static_cast<std::int64_t>(files_.size());
    checkVoxelCounts(folder, info_.voxels);
    bool has_geometry = false;
    takeOwnAttributes(first.header(channel_.part), info_, has_geometry);
    if (!has_geometry) info_.notes.push_back("the slices say no distances; 1 was used");
    if (channel_.type == Imf::UINT && info_.voxel_type == VoxelType::kFloat32)
      info_.voxel_type = VoxelType::kUint32;
    tidyGeometry(folder, info_.geometry, info_.voxels, info_.notes);
  }

  const VolumeInfo& info() const override { return info_; }
  std::vector<std::string> files() const override { return files_; }
  // OpenEXR holds some lines more, or all tiles of a row.
  std::uint64_t bufferBytes() const override {
    return 2 * static_cast<std::uint64_t>(info_.voxels.x * info_.voxels.y) * sizeof(float);
  }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    forEachSliceOfRows(info_, first, count, out,
                       [&](std::int64_t z, std::int64_t y, std::int64_t rows, std::byte* to) {
                         if (z != slice_) load(z);
                         const std::uint32_t* const from = pixels_.data() + y * info_.voxels.x;
                         visitNumberType(info_.voxel_type, [&](auto tag) {
                           using T = typename decltype(tag)::Type;
                           std::transform(from, from + rows * info_.voxels.x,
                                          reinterpret_cast<T*>(to),
                                          [&](std::uint32_t bits) { return voxelOf<T>(bits); });
                         });
                       });
  }

 private:
  void load(std::int64_t z) {
    if (cancel_ != nullptr) cancel_->check();
    slice_ = -1;
    const std::string& path = files_[static_cast<std::size_t>(z)];
    ExrFile file(path);
    std::vector<std::string> all;
    const auto channel = file.findChannel(channel_.name, all);
    Index3 pixels = channel ? file.pixels(channel->part) : Index3(0);
    pixels.z = info_.voxels.z;
    if (!channel || channel->type != channel_.type || pixels != info_.voxels)
      throw unusable(path, "its channel or its size is not that of '", files_.front(),
                     "'; keep only the slices of one volume in the folder");
    pixels_.resize(static_cast<std::size_t>(pixels.x * pixels.y));
    file.read(*channel, pixels, pixels_.data());
    slice_ = z;
  }

  template <typename T>
  T voxelOf(std::uint32_t bits) const {
    const double value =
        channel_.type == Imf::UINT ? bits : static_cast<double>(std::bit_cast<float>(bits));
    if constexpr (std::is_floating_point_v<T>) return static_cast<T>(value);
    // Isobrick wrote whole numbers of the type; pixels that were edited since become the nearest.
    const auto low = static_cast<double>(std::numeric_limits<T>::min());
    const auto high = static_cast<double>(std::numeric_limits<T>::max());
    return value > low ? static_cast<T>(std::min(std::round(value), high)) : static_cast<T>(low);
  }

  VolumeInfo info_;
  std::vector<std::string> files_;
  const CancelFlag* cancel_;
  ExrChannel channel_;
  std::int64_t slice_ = -1;  // the one in pixels_; none is -1
  std::vector<std::uint32_t> pixels_;
};

}  // namespace

std::unique_ptr<VolumeSource> openExrSlices(const std::string& folder, const OpenOptions& options) {
  return std::make_unique<ExrSlices>(folder, options);
}

}  // namespace isobrick
