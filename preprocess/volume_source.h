// Sources of voxels: the interface between file formats and the pyramid builder.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/length_scale.h"
#include "isobrick/storage/value_transform.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// Which one of several volumes of an input: of its channels, or of its time steps.
struct OneOfSeveral {
  std::int64_t number = 0;  // that is delivered, from 0 on; OpenOptions takes it
  std::int64_t count = 1;   // in the input; 0: their numbers have gaps
};

// A channel of an input, as its file describes it.
struct VolumeChannel {
  std::string name;                         // empty: it has none
  std::optional<std::uint32_t> color = {};  // sRGB, 0xRRGGBB
};

// Describes a source's volume before the first voxel is read.
struct VolumeInfo {
  Index3 voxels{0};                          // per axis 2 .. kMaxVoxelsPerAxis
  VoxelType voxel_type = VoxelType::kUint8;  // of what readRows and readBox deliver
  GridGeometry geometry;                     // the voxels' place in the world
  std::string source;    // path, or the phantom's name: goes into the provenance
  std::string format;    // "raw", "NRRD", "DICOM series", "phantom", ...
  std::string encoding;  // how the voxels are stored, if the user said so and not the file
  std::vector<std::string> notes;  // every conversion on the way in, a line each
  // Facts of the file beside its voxels that a writer of its format needs again, such as the
  // background of an OpenVDB grid: "vdb.background" and its value as text.
  std::map<std::string, std::string> properties = {};
  ValueTransform values = {};  // from what is delivered to the values of the input
  // The least and the greatest value of the input, if `values` is no identity.
  RealRange range = {};
  // The type of the input's numbers, if no pyramid holds it and others are delivered.
  std::optional<VoxelType> numbers = {};
  // Of float32, if they are known before any is read: bounds of the voxels that are delivered.
  std::optional<ValueRange> bounds = {};
  OneOfSeveral channel = {}, time_step = {};
  // The unit of the lengths that the input states, before they became millimetres; nothing:
  // several.
  std::optional<LengthScale> stated_lengths = LengthScale();
  // Of the first ones of the input's channels; there may be fewer.
  std::vector<VolumeChannel> named_channels = {};

  // The description of the channel that is delivered, of several; null if the file has none.
  const VolumeChannel* namedChannel() const {
    const auto number = static_cast<std::size_t>(channel.number);
    return channel.count > 1 && number < named_channels.size() ? &named_channels[number] : nullptr;
  }
};

// Lengths that the user gives in place of the input's, or that it lacks. Units are names that
// lengthScale() knows, or empty.
struct GivenPlace {
  std::optional<glm::dvec3> spacing, origin;  // finite; spacing above 0
  // Of all lengths that the input states, whatever it says of their unit, and of these here; the
  // world is in millimetres then.
  std::string unit;
  // Of these here alone. If the input says no unit, nor `unit` does, the first of them stands for
  // it.
  std::string spacing_unit, origin_unit;
};

// A volume that is read once, in order, a few rows at a time; or box by box, if readsBoxes().
// Errors: Error (path, slice, what to do) if the input is short or damaged, ResumableError if the
// disk failed and the same run may succeed later.
class VolumeSource {
 public:
  virtual ~VolumeSource() = default;
  // The same for as long as the source lives.
  virtual const VolumeInfo& info() const = 0;

  // Writes rows [first, first + count) into `out`: count * voxels.x voxels of info().voxel_type,
  // native byte order. Row r is row r % voxels.y of slice r / voxels.y. Rows ascend from call to
  // call; rows that were skipped between two calls are never read later. By one thread at a time.
  // If readsBoxes(), a source need not override it: then it is as many whole slices as there are,
  // by readBox(), so that every brick or chunk of them is read once.
  virtual void readRows(std::int64_t first, std::int64_t count, void* out);

  // True if readBox() may be used instead of readRows().
  virtual bool readsBoxes() const { return false; }
  // Writes the voxels of `box`, x fastest, box.count.x * y * z of them, into `out`. Any box, in any
  // order, by any number of threads at once. Only if readsBoxes().
  virtual void readBox(const IndexBox& box, void* out) const;
  // Says that these boxes will be read soon, in this order; what was said before counts no more. A
  // source that is far away begins to bring them in, as far as it has room, and goes on while it is
  // read; the others do nothing. Thread-safe.
  virtual void announce(std::span<const IndexBox> boxes) const;

  // If no pyramid holds the input's numbers: reads them all once, and chooses what is delivered
  // (VolumeInfo: voxel_type, values, range; a note says what changes); float32 without it. Before
  // the first voxel is read; the second call does nothing. `cancel` may be null, `progress` empty.
  virtual void chooseVoxels(const CancelFlag* cancel,
                            const std::function<void(double fraction)>& progress);
  // The same choice as that of another source of the same volume, whose info() this is.
  virtual void chooseVoxelsAs(const VolumeInfo& chosen);

  // Notes on the voxels that were read so far, a line each, beside those of info(). Not while
  // another thread reads.
  virtual std::vector<std::string> notesOfReading() const { return {}; }

  // Every file that the voxels depend on: the header first, if it is a file of its own, then the
  // data in the order of their slices. A file that is missing here can change unnoticed, and the
  // output can overwrite it. None for phantoms.
  virtual std::vector<std::string> files() const { return {}; }

  // For a source without files: one line with all its parameters in full precision, which differs
  // for any two sources whose voxels may differ. Empty if there are files. A source with neither
  // cannot be built.
  virtual std::string identity() const { return {}; }

  // The most bytes that the source itself holds at a time while it is read: a slice that its
  // library decodes as a whole, or the whole image of a format that cannot be streamed.
  virtual std::uint64_t bufferBytes() const { return 0; }
};

// For VolumeSource::readRows(): calls take(z, y, rows, out) with rows [first, first + count) of the
// volume as the rows y to y + rows of slice z, one slice after the other; `out` is their place.
template <typename Take>
void forEachSliceOfRows(const VolumeInfo& info, std::int64_t first, std::int64_t count, void* out,
                        Take&& take) {
  auto* to = static_cast<std::byte*>(out);
  for (const std::int64_t end = first + count; first < end;) {
    const std::int64_t z = first / info.voxels.y, y = first % info.voxels.y;
    const std::int64_t rows = std::min(info.voxels.y - y, end - first);
    take(z, y, rows, to);
    to += static_cast<std::size_t>(rows * info.voxels.x) * voxelBytes(info.voxel_type);
    first += rows;
  }
}

}  // namespace isobrick
