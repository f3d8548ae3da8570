#include "tools/build/open_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <limits>
#include <string_view>

#include "preprocess/sources/itk_source.h"
#include "preprocess/sources/raw_source.h"
#include "preprocess/sources/vdb_source.h"
#include "preprocess/sources/vti_source.h"
#include "storage/error.h"
#include "tools/command.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

std::string lowerExtension(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

bool isOneOf(std::string_view extension, std::initializer_list<std::string_view> all) {
  return std::find(all.begin(), all.end(), extension) != all.end();
}

}  // namespace

void addInputOptions(CLI::App& app, std::vector<std::string>& paths, InputOptions& options) {
  app.add_option("INPUT", paths,
                 "Volumes: NRRD, MetaImage, NIfTI, VTI, VDB, TIFF, ... files, folders of a DICOM "
                 "series or of TIFF slices, or raw files; quoted patterns ('scans/*.nrrd') too")
      ->type_name("PATH")
      ->required();
  CLI::Option* const dims =
      addParsedOption(app, "--raw-dims", options.raw_dims, parseIndex3, "X,Y,Z",
                      "The input has no header, and this many voxels per axis");
  CLI::Option* const type =
      app.add_option("--raw-type", options.raw.type, "Its voxels; u32, i32 and f64 become float32")
          ->type_name("T")
          ->check(CLI::IsMember({"u8", "i8", "u16", "i16", "f32", "u32", "i32", "f64"}));
  dims->needs(type);
  type->needs(dims);
  app.add_option("--raw-endian", options.raw_endian, "Its byte order; default: little")
      ->type_name("E")
      ->check(CLI::IsMember({"little", "big"}))
      ->needs(dims);
  addParsedOption(app, "--raw-spacing", options.raw.spacing, parsePoint, "X,Y,Z",
                  "Distances between its voxels in world units; default: 1,1,1")
      ->needs(dims);
  addParsedOption(
      app, "--raw-offset", options.raw.offset_bytes,
      [](const std::string& text) {
        return parseInteger(text, 0, std::numeric_limits<std::int64_t>::max());
      },
      "BYTES", "Where its first voxel is; default: 0")
      ->needs(dims);
  app.add_flag("--dicom-float32", options.dicom_float32,
               "Take a DICOM series as float32, where its headers promise 16 bits and its values "
               "do not keep to them");
}

// ITK has a word for most files that it does not know; for these there is a better one.
void refuseKnownMisfits(const InputOptions& options) {
  const std::string& path = options.path;
  std::error_code ignored;
  const fs::file_status status = fs::status(path, ignored);
  // Opening a pipe would wait for its other end, for ever.
  if (fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status))
    throw Error(fmt::format(
        "cannot read '{}': it is neither a file nor a folder; copy it to a file", path));
  if (options.raw_dims || !fs::is_regular_file(status)) return;
  const std::string extension = lowerExtension(path);
  if (extension == ".isb")
    throw Error(
        fmt::format("'{}' is a pyramid already; give the volume that it was made of", path));
  if (isOneOf(extension, {".raw", ".bin", ".dat", ".vol", ".u8", ".u16", ".i16", ".f32"}))
    throw UsageError(
        fmt::format("'{}' has no header; give its dimensions and voxel type with "
                    "--raw-dims X,Y,Z and --raw-type T (and --raw-endian, "
                    "--raw-spacing, --raw-offset where they are not little, 1,1,1 "
                    "and 0)",
                    path));
}

std::unique_ptr<VolumeSource> openInput(const InputOptions& options, OpenOptions open) {
  open.dicom_float32 = options.dicom_float32;
  if (options.raw_dims) {
    RawLayout layout = options.raw;
    layout.voxels = *options.raw_dims;
    layout.big_endian = options.raw_endian == "big";
    return openRawSource(options.path, layout);
  }
  std::error_code ignored;
  if (!fs::is_directory(options.path, ignored)) {
    const std::string extension = lowerExtension(options.path);
    if (extension == ".vti") return openVtiSource(options.path, open);
    if (extension == ".vdb") return openVdbSource(options.path, open);
  }
  return openItkSource(options.path, open);
}

std::string defaultOutputName(const std::string& input_path) {
  std::error_code error;
  fs::path path = fs::path(input_path);
  if (fs::is_directory(path, error)) {
    // "." and "scans/" have a name too.
    const fs::path whole = fs::weakly_canonical(path, error);
    return (whole.has_filename() ? whole.filename().string() : "volume") + ".isb";
  }
  if (lowerExtension(path) == ".gz") path = path.stem();
  return path.stem().string() + ".isb";
}

}  // namespace isobrick
