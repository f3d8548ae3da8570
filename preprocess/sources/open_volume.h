// From a path to a volume source, whatever the format.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/preprocess/derived_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/grid.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The names that RawLayout::type takes: "u8", "i8", "u16", "i16", "f32", "u32", "i32" and "f64".
std::vector<std::string> rawTypeNames();

// How to read a file that has no header.
struct RawLayout {
  Index3 voxels{0};                // per axis 2 .. kMaxVoxelsPerAxis
  std::string type;                // one of rawTypeNames(), or such as "uint8", "uchar"
  bool big_endian = false;         // of types of several bytes
  std::uint64_t offset_bytes = 0;  // of the first voxel
};

// Picks one number of voxels that have several (vectors, colours, complex numbers).
struct ComponentChoice {
  bool magnitude = false;  // the root of the sum of all their squares, as float32
  std::int64_t index = 0;  // otherwise: this one, from 0
};

// Options of opening a volume. Spacing, origin and units replace those that the input states or
// lacks; for a coarser level of a pyramid, the spacing is that of level 0.
struct OpenOptions : GivenPlace {
  // If given, the file has no header, whatever its name.
  std::optional<RawLayout> raw;
  // Checked while the volume is opened, and by the source whenever it is read: it outlives the
  // source. Both throw Cancelled after a request.
  const CancelFlag* cancel = nullptr;
  // Called now and then on the caller's thread while the volume is opened, if that takes long: the
  // name of the phase, and the share of it that is done, 0 .. 1. Not called once the volume is
  // open.
  std::function<void(std::string_view phase, double fraction)> progress;
  // Makes a DICOM series float32, whatever its headers state: for a series with values that do not
  // fit the type that they suggest (dicom_values.h).
  bool dicom_float32 = false;
  // UID or number of the series to take from a folder with several DICOM series.
  std::string series;
  // Opens a pyramid (.isb) as a volume: this level of it. Without it pyramids are refused, so that
  // no pyramid is built of a pyramid by accident.
  std::optional<int> pyramid_level;
  // Name of the volume to take from a file with several (OpenVDB grids, also by their number;
  // arrays of VTI, stacks of an enhanced DICOM file); empty: the first that can be read (for
  // stacks: Error if there are several).
  std::string grid;
  // Number of the time step or channel to take from a volume with several (OME-Zarr, time steps of
  // NIfTI, DICOM); without it the first, and a note says so (for DICOM: Error).
  std::optional<std::int64_t> time;
  // See time.
  std::optional<std::int64_t> channel;
  // Number of the image to take from a file or store with several (TIFF, Zarr), from 0; without it
  // the only one that is a volume (Error if there are several).
  std::optional<std::int64_t> image;
  // The component to take from NRRD, MetaImage, NIfTI and VTI with several values per voxel.
  // Without it such volumes are refused; with it all others are.
  std::optional<ComponentChoice> component;
  // What is made of the volume as it is read, after all else.
  Derivation derivation;
  // Opens this level that an OME-Zarr store has of the volume, or its coarsest if it has fewer, for
  // a first look; 0 is the finest. Other formats take no heed of it.
  std::size_t store_level = 0;
  // Delivers numbers that no pyramid holds (float64, integers of 32 and 64 bits) as they are, for
  // writing them elsewhere. Without it VolumeSource::chooseVoxels() makes voxels of them. A
  // derivation takes no heed of it.
  bool keep_numbers = false;
  // The most bytes that the source should hold, if it has a choice: the pager of a pyramid, the
  // part of a grid that is in memory at a time. VolumeSource::bufferBytes() says how many it takes.
  std::uint64_t memory_bytes = std::uint64_t{256} << 20;

  // Throws Cancelled after a request.
  void checkCancel() const {
    if (cancel != nullptr) cancel->check();
  }
  // Calls `progress`, if there is one.
  void report(std::string_view phase, double fraction) const {
    if (progress) progress(phase, fraction);
  }
};

// A folder holds several DICOM series, and the options choose none of them, or not one.
class SeveralSeries : public Error {
 public:
  struct Series {
    std::string name;  // what OpenOptions::series takes: its UID or, for want of one, its number
    std::string text;  // number, description and size, one line
  };
  // `refusal`: the line, place and remedies.
  SeveralSeries(const Error& refusal, std::vector<Series> found)
      : Error(refusal), series(std::move(found)) {}
  const std::vector<Series> series;  // in the order of their numbers
};

// Opens the volume at `path`: a file of any format that isobrick reads, or a folder with a DICOM
// series or a stack of TIFF slices. VTI and VDB files are recognised by their ending, others by
// their content; with options.raw the file is read as raw voxels, whatever it is called. Reads
// headers, and no voxels. May be called by several threads at once.
//
// Throws Error if the path cannot be opened or read, for formats that this build of isobrick leaves
// out, for pyramids, and (with Remedy::kDescribeRawFile) for files that are known to have no header
// if options.raw is missing; SeveralSeries; Cancelled.
std::unique_ptr<VolumeSource> openVolume(const std::string& path, const OpenOptions& options = {});

// The names of the grids of numbers in an OpenVDB file, as OpenOptions::grid takes them, in its
// order; none for files of other formats. Throws as openVolume().
std::vector<std::string> gridNames(const std::string& path, const OpenOptions& options = {});

// A format that openVolume() reads, for a list of them.
struct ReadableFormat {
  // What OpenOptions choose from.
  enum Choice : unsigned { kGrid = 1, kTime = 2, kChannel = 4, kImage = 8, kSeries = 16 };

  const char* name;  // "NRRD"; the first word of VolumeInfo::format is part of it
  std::array<std::string_view, 8> endings;  // ".mhd", ".mha", and empty ones behind them
  std::string_view others;                  // what else names it: "or folder of slices"
  bool is_built_in;                         // false: this build of isobrick leaves it out
  bool file_is_volume;  // a file of one of these endings, and no slice of a volume
  unsigned choices;     // of Choice
  // ".tif .tiff, or folder of slices"
  std::string namedBy() const;
  // Those of files that are volumes.
  std::vector<std::string_view> volumeEndings() const;
  // Whether a volume of this VolumeInfo::format is one.
  bool isOf(const std::string& format) const {
    return std::string_view(name).find(format.substr(0, format.find(' '))) !=
           std::string_view::npos;
  }
};
// All of them.
std::vector<ReadableFormat> readableFormats();

// Gives a source that was opened otherwise, level `level` of a pyramid, the spacing and the origin
// of the options, if they have them, and derives from it what they say, as openVolume() does.
std::unique_ptr<VolumeSource> viewAsGiven(std::unique_ptr<VolumeSource> source,
                                          const OpenOptions& options, int level = 0);

// Throws the Error of openVolume() if the name or the kind of the path shows that it is not usable;
// opens nothing.
void refuseUnusablePath(const std::string& path, const OpenOptions& options = {});

// The samples of `level`, whole: voxel (i,j,k) is sample (i,j,k) of the level, at the world
// position that docs/FORMAT.md gives it. Spacing is 2^level times the volume's, and the origin is
// the same. If the last sample of an axis repeats the border voxel, a note says so: it lies further
// in than a regular grid can express. Holds what the pager of `pyramid` holds, `budget_bytes`, and
// nothing more; boxes are read by any number of threads, and one call uses the calling TBB arena.
//
// Throws Error if the pyramid has no such level; while it is read, what Pyramid::samples()
// throws, and Cancelled. `cancel`, which may be null, outlives the source.
std::unique_ptr<VolumeSource> makePyramidSource(std::shared_ptr<const Pyramid> pyramid,
                                                std::uint64_t budget_bytes, int level,
                                                const CancelFlag* cancel = nullptr);

// A number that a pyramid stores of each of its nodes beside the samples (docs/FORMAT.md, sections
// 6 to 8): of the tiles of a level, or of the blocks of level 0.
enum class NodeValue {
  kLeast,      // of a tile's range
  kGreatest,   // likewise
  kCurvature,  // the first of kDeviationCoefficients of a block's curvature bound, float32, in
               // voxels; infinite if no bound is known. The others follow
};

// The nodes that reach into the box `voxels` of level 0 as the voxels of a volume: each is the
// middle of its node; the last node of an axis may be thinner than the spacing says, and an axis
// may have a single one. `level` exists, and is 0 for coefficients. exportVolume() writes it behind
// the levels into a .vdb, exactly, as a grid of its own: "min", "max_level2", "curvature_0". All
// else as of makePyramidSource(). Throws Error with Remedy::kBuildWithCurvature.
std::unique_ptr<VolumeSource> makeNodeSource(const std::shared_ptr<const Pyramid>& pyramid,
                                             std::uint64_t budget_bytes, NodeValue value, int level,
                                             const IndexBox& voxels,
                                             const CancelFlag* cancel = nullptr);

}  // namespace isobrick
