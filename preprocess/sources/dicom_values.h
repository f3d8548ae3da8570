// The values that the slices of a DICOM series may hold, by their headers alone. Private to
// preprocess/sources/.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// How the stored numbers of one slice become values, by its header.
struct DicomValueMap {
  double slope = 1, intercept = 0;
  int bits_allocated = 16;
  int bits_stored = 16;
  int high_bit = 15;  // the uppermost of those stored
  bool is_signed = false;
  // Stored numbers, as the writer claims them; many leave them out, and some are wrong.
  std::optional<std::int64_t> smallest, largest;
  std::optional<std::int64_t> padding;  // the value of pixels that the scanner did not see

  bool operator==(const DicomValueMap&) const = default;
};

// True for slope and intercept that do not apply: images of this kind (MR) have none by the
// standard.
bool hasIdleRescale(const DicomHeader& header);

// Missing elements have their usual values; a slope of 0 is taken as 1, as GDCM does. `frame`
// counts from 0.
DicomValueMap dicomValueMap(const DicomHeader& header, std::size_t frame = 0);

// "1\2\3" -> {1, 2, 3}; empty if it is something else.
std::vector<double> decimalStrings(const std::string& text, std::size_t count);

struct DicomVoxelType {
  VoxelType type = VoxelType::kFloat32;
  std::string note;  // for VolumeInfo::notes; empty if there is nothing to say
};

// The voxel type of a series whose slices have these maps (at least one); no pixel is read.
//
//   0. All slices hold values of 8 bits as they are: uint8 or int8.
//   1. A slope or an intercept that is no whole number: float32.
//   2. All values that the bits stored allow, over all slices, fit int16, or else uint16: that.
//   3. All slices have their smallest and largest pixel value (0028,0106 and 0107), and with the
//      padding values (0028,0120) these fit int16, or else uint16: that.
//   4. At most 16 bits are stored, every slope is 1 or -1, none of 3's elements contradicts: int16
//      if the bits allow values below zero, else uint16. A CT that stores 12 significant bits in 16
//      and says -1024 for the intercept is such a series: its bits allow more values than a 16-bit
//      type has, its scanner does not make them.
//   5. float32, with a note.
//
// 3 and 4 trust facts of the header that it cannot prove. The reader of the slices compares every
// value with the type, and refuses one that does not fit: nothing is ever cut off.
DicomVoxelType dicomVoxelType(const std::vector<DicomValueMap>& maps);

// Adds a note if slopes and intercepts change what is stored.
void noteValueMaps(const std::vector<DicomValueMap>& maps, std::vector<std::string>& notes);

// Sets the type of the voxels of `info`, float32 if that is asked for, and notes what was mapped.
void takeDicomVoxelType(const std::vector<DicomValueMap>& maps, bool as_float32, VolumeInfo& info);

// Adds a note if small values are meant to be shown bright.
void noteMonochrome1(const std::string& photometric, std::vector<std::string>& notes);

}  // namespace isobrick
