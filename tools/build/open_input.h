// From the name of an input to a volume source.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/sources/open_volume.h"

namespace isobrick {

struct InputOptions : GivenPlace {
  const CLI::App* parser = nullptr;  // of the words that the rest comes from
  std::string path;
  std::optional<Index3> raw_dims;  // given: the file has no header
  RawLayout raw;                   // everything but the dimensions
  std::string raw_endian = "little";
  bool dicom_float32 = false;
  std::vector<std::string> grids;  // of a file with several; "all": each of them
  std::optional<std::int64_t> time, channel, image;
  bool all_times = false, all_channels = false;  // each of them; see jobsOfMembers()
  std::optional<ComponentChoice> component;
  std::string series;
  bool keep_numbers = false;         // of types that pyramids do not hold
  std::optional<int> pyramid_level;  // given: pyramids are inputs too
  Derivation derivation;             // given: likewise, level 0 of them
};

// INPUT..., which go to `paths`, and the --raw-... options, which hold for each of them.
void addInputOptions(CLI::App& app, std::vector<std::string>& paths, InputOptions& options);

// The --raw-... options and all others for opening an input, without the inputs.
void addOpenOptions(CLI::App& app, InputOptions& options);

// The input with each of the grids that it asks for, in the order of the words or of the file; the
// input itself if it asks for one, or for none. Reads the file's headers for "all", and throws what
// that throws, and UsageError for a file that has no grids.
std::vector<InputOptions> inputsOfGrids(const InputOptions& input);

// The options of opening the volume that these words give. Throws UsageError for several grids.
OpenOptions openOptionsOf(const InputOptions& input);

// Throws Error for files whose names show that they are not supported, and UsageError for files
// that need --raw-dims. Opens nothing.
void refuseKnownMisfits(const InputOptions& input);

// An option that would change nothing is refused, not ignored: both throw UsageError for the first
// option that was given to `parser` and is not for the format of the input, as its source names it,
// or of the output, by its ending.
void refuseUnfitInputOptions(const CLI::App& parser, const VolumeInfo& input);
void refuseUnfitOutputOptions(const CLI::App& parser, const std::string& output);

// The phantom that "phantom:head:512" names (256 voxels per axis if no size is given); nothing for
// other words. Throws Error for a size that is none.
std::optional<PhantomSpec> phantomOf(const std::string& input);

// "head.isb" for "scans/head.nii.gz", and for the folder "scans/head"; "head-512.isb" for
// "phantom:head:512".
std::string defaultOutputName(const std::string& input_path);

}  // namespace isobrick
