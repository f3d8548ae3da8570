// What the functions that open volumes take beside the path.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/cancel.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// What RawLayout::type may be: "u8", "i8", "u16", "i16", "f32", and "u32", "i32" and "f64", which
// become float32 with a note.
std::vector<std::string> rawTypeNames();

// How to read a file that has no header.
struct RawLayout {
  Index3 voxels{0};
  std::string type;  // one of them, or as "uint8", "uchar"
  bool big_endian = false;
  std::uint64_t offset_bytes = 0;
};

// Which number of voxels with several of them (vectors, colours, complex numbers).
struct ComponentChoice {
  bool magnitude = false;  // the root of the sum of all their squares, as float32
  std::int64_t index = 0;  // otherwise: this one, from 0
};

struct OpenOptions {
  // Given: the file has no header, whatever its name.
  std::optional<RawLayout> raw;
  // Looked at while the volume is opened, and by the source whenever it is read: it outlives the
  // source. Both throw Cancelled after a request.
  const CancelFlag* cancel = nullptr;
  // Called now and then on the caller's thread while the volume is opened, where that takes long:
  // what is being done, and how much of it is done, 0 .. 1. Not called once the volume is open.
  std::function<void(std::string_view phase, double fraction)> progress;
  // A DICOM series becomes float32, whatever its headers say: for one with values that do not fit
  // the type that they suggest (dicom_values.h).
  bool dicom_float32 = false;
  // Of a folder with several DICOM series, the one of this UID or number.
  std::string series;
  // Given: take the place of what the input says, or lacks. Of a coarser level of a pyramid too,
  // these are of level 0. Finite, `spacing` above 0.
  std::optional<glm::dvec3> spacing, origin;
  // Given: a pyramid (.isb) is opened, this level of it. Without, pyramids are refused: nobody
  // needs one of a pyramid by accident.
  std::optional<int> pyramid_level;
  // Of a file with several volumes (OpenVDB, arrays of VTI, stacks of an enhanced DICOM file), the
  // one of this name; empty: the first that will do (of stacks: Error where there are several).
  std::string grid;
  // Of a volume with several time steps or channels (OME-Zarr, time steps of NIfTI, DICOM), which
  // one; without, the first, and a note says so (of DICOM: Error).
  std::optional<std::int64_t> time, channel;
  // Of NRRD, MetaImage, NIfTI and VTI with several values per voxel, what becomes of them. Without,
  // such volumes are refused; given, all others are.
  std::optional<ComponentChoice> component;
  // What the source should hold at most, where it has a choice: the pager of a pyramid, the part of
  // a grid that is in memory at a time. It says in bufferBytes() what it takes.
  std::uint64_t memory_bytes = std::uint64_t{256} << 20;

  void checkCancel() const {
    if (cancel != nullptr) cancel->check();
  }
  void report(std::string_view phase, double fraction) const {
    if (progress) progress(phase, fraction);
  }
};

}  // namespace isobrick
