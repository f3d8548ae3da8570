#include "isobrick/preprocess/sources/stored_array.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/voxel_components.h"

namespace isobrick {
namespace {

using Use = StoredAxis::Use;

// What is chosen of an array: an index of each axis that is not of space.
struct ArrayChoice {
  std::vector<std::uint64_t> indices;     // 0 for axes of space
  std::optional<std::size_t> value_axis;  // of several values
  std::uint64_t values = 1;               // along it
  OpenOptions options;                    // with the choice of one of them
};

class ArrayChooser {
 public:
  ArrayChooser(const StoredArray& array, const OpenOptions& options, VolumeInfo& info)
      : array_(array), info_(info) {
    choice_.options = options;
    choice_.indices.resize(array.axes.size());
  }

  ArrayChoice choose() {
    OpenOptions& options = choice_.options;
    for (std::size_t i = 0; i < array_.axes.size(); ++i) {
      const StoredAxis& axis = array_.axes[i];
      if (axis.size == 1) continue;
      if (axis.use == Use::kTime)
        choice_.indices[i] = stepOf(axis.size, "time step", options.time, 0);
      if (axis.use == Use::kImages)
        choice_.indices[i] = stepOf(axis.size, "image", options.image, std::nullopt);
      if (axis.use == Use::kValues || axis.use == Use::kUnnamed) takeValues(i);
    }
    refuseUnused(options.time, "time steps");
    refuseUnused(options.image, "images");
    // An axis that is not there has the index 0.
    if (choice_.values == 1 && options.channel.value_or(1) == 0) options.channel.reset();
    // What one program calls a component is a channel for another.
    if (!options.component && options.channel)
      options.component = ComponentChoice{.index = *options.channel};
    if (!options.component && is_unnamed_ && unnamed_time_)
      options.component = ComponentChoice{.index = *unnamed_time_};
    checkComponentChoice(info_.source, choice_.values, options);
    return std::move(choice_);
  }

 private:
  // Takes the choice away, so that what is left was not used.
  std::uint64_t stepOf(std::int64_t count, const std::string& one,
                       std::optional<std::int64_t>& given, std::optional<std::int64_t> otherwise) {
    const std::string all =
        "it has " + std::to_string(count) + " " + one + "s, 0 to " + std::to_string(count - 1);
    const auto wanted = given ? std::exchange(given, std::nullopt) : otherwise;
    if (!wanted) throw unusable(info_.source, all + "; choose one", {Remedy::kChooseImage});
    const std::int64_t step = *wanted;
    if (step < 0 || step >= count)
      throw unusable(info_.source, all + ", and none is number " + std::to_string(step));
    info_.notes.push_back(one + " " + std::to_string(step) + " of " + std::to_string(count) +
                          ", counted from 0, was taken");
    // Another step is another volume when a pyramid is compared with its input.
    info_.encoding += (info_.encoding.empty() ? "" : ", ") + (one + " " + std::to_string(step));
    return static_cast<std::uint64_t>(step);
  }

  void takeValues(std::size_t axis) {
    if (choice_.value_axis)
      throw unusable(info_.source,
                     "its voxels have " + std::to_string(choice_.values) + " times " +
                         std::to_string(array_.axes[axis].size) +
                         " values, along two axes, and one such axis is read; extract one volume "
                         "first");
    choice_.value_axis = axis;
    choice_.values = static_cast<std::uint64_t>(array_.axes[axis].size);
    is_unnamed_ = array_.axes[axis].use == Use::kUnnamed;
    if (is_unnamed_) unnamed_time_ = std::exchange(choice_.options.time, std::nullopt);
  }

  void refuseUnused(const std::optional<std::int64_t>& given, const std::string& several) const {
    if (given && *given != 0)
      throw unusable(info_.source,
                     "it has no " + several + " to choose from; leave out the choice");
  }

  const StoredArray& array_;
  VolumeInfo& info_;
  ArrayChoice choice_;
  bool is_unnamed_ = false;
  std::optional<std::int64_t> unnamed_time_;
};

// Where the rows of the chosen volume are among the numbers, in bytes.
struct ArrayPlaces {
  std::uint64_t first = 0;
  RowStrides strides;
  std::uint64_t total = 0;  // of the whole array
};

ArrayPlaces placesIn(const StoredArray& array, const std::vector<std::uint64_t>& indices,
                     const std::string& path) {
  ArrayPlaces places;
  places.total = storedBytes(array.stored.type);
  int space_axis = 0;
  for (std::size_t i = 0; i < array.axes.size(); ++i) {
    if (array.axes[i].use == Use::kSpace) {
      if (space_axis == 1) places.strides.row_bytes = places.total;
      if (space_axis == 2) places.strides.slice_bytes = places.total;
      ++space_axis;
    } else if (space_axis > 0) {  // of those before x, voxels are made
      places.first += indices[i] * places.total;
    }
    if (__builtin_mul_overflow(places.total, static_cast<std::uint64_t>(array.axes[i].size),
                               &places.total))
      throw unusable(path, "it has more numbers than 64 bits count; correct its header");
  }
  return places;
}

std::unique_ptr<VolumeSource> openChosen(const VolumeInfo& info, const StoredArray& array,
                                         const StoredVoxels& stored,
                                         const std::vector<std::uint64_t>& indices,
                                         const CancelFlag* cancel) {
  const ArrayPlaces places = placesIn(array, indices, info.source);
  const std::uint64_t row_bytes = static_cast<std::uint64_t>(info.voxels.x) * stored.bytes();
  const bool is_dense =
      places.strides.row_bytes == row_bytes &&
      places.strides.slice_bytes == row_bytes * static_cast<std::uint64_t>(info.voxels.y);
  const NumberFiles& files = array.files;
  const std::optional<std::uint64_t> offset = files.offsetOfBytes(places.total);
  if (is_dense && offset) {
    RawRun run;
    run.path = files.paths.front();
    run.header_path = files.header_path;
    run.offset_bytes = *offset + places.first;
    return openRawRun(info, run, stored, cancel);
  }
  return openStream(info, stored, makeNumberStream(files, array.stored.type, places.total),
                    places.first, files.all(), places.strides, cancel);
}

}  // namespace

Index3 volumeVoxels(const std::string& path, const std::vector<StoredAxis>& axes) {
  Index3 voxels(1);
  int space_axis = 0;
  for (const StoredAxis& axis : axes)
    if (axis.use == Use::kSpace) voxels[space_axis++] = axis.size;
  if (voxels.z == 1)
    throw unusable(path, "it is a single 2-D image; name the folder that holds all slices");
  checkVoxelCounts(path, voxels);
  return voxels;
}

std::unique_ptr<VolumeSource> openStoredArray(VolumeInfo info, const StoredArray& array,
                                              const OpenOptions& options) {
  ArrayChoice choice = ArrayChooser(array, options, info).choose();
  StoredVoxels stored = array.stored;
  info.voxel_type = stored.delivered();
  if (!stored.keepsType() && !stored.map)
    info.notes.push_back(std::string(infoOf(stored.type).name) +
                         " voxels were converted to float32");
  if (!choice.value_axis) return openChosen(info, array, stored, choice.indices, options.cancel);
  // Values that lie together are a matter of decoding, others are volumes of their own.
  const auto is_space = [](const StoredAxis& axis) { return axis.use == Use::kSpace; };
  const auto x_axis = std::find_if(array.axes.begin(), array.axes.end(), is_space);
  const VolumeInfo of_one = info;
  StoredVoxels together = stored;
  takeComponent(choice.values, choice.options, together, info);
  const std::size_t axis = *choice.value_axis;
  if (static_cast<std::ptrdiff_t>(axis) < x_axis - array.axes.begin())
    return openChosen(info, array, together, choice.indices, options.cancel);
  const auto openValue = [&](const VolumeInfo& value_info, std::uint64_t value) {
    choice.indices[axis] = value;
    return openChosen(value_info, array, stored, choice.indices, options.cancel);
  };
  if (!choice.options.component->magnitude) {
    info.voxel_type = of_one.voxel_type;
    return openValue(info, static_cast<std::uint64_t>(choice.options.component->index));
  }
  std::vector<std::unique_ptr<VolumeSource>> sources;
  for (std::uint64_t value = 0; value < choice.values; ++value)
    sources.push_back(openValue(of_one, value));
  return makeMagnitudeSource(std::move(info), std::move(sources));
}

}  // namespace isobrick
