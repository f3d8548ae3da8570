#include "tools/build/open_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <stdexcept>
#include <string_view>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "tools/command.h"
#include "tools/failure_text.h"
#include "tools/parse_text.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

const auto parseCount = integerWithin(0, std::numeric_limits<std::int64_t>::max());

ComponentChoice parseComponent(const std::string& text) {
  if (text == "magnitude") return {.magnitude = true};
  return {.index = parseCount(text)};
}

glm::dvec3 parseSpacing(const std::string& text) {
  const glm::dvec3 spacing = parsePoint(text);
  if (!(spacing.x > 0 && spacing.y > 0 && spacing.z > 0))
    throw std::invalid_argument(fmt::format("'{}': all three are to be above 0", text));
  return spacing;
}

double parseSigma(const std::string& text) {
  const double sigma = parseNumber(text);
  if (!(sigma > 0 && sigma <= Derivation::kMostSigma))
    throw std::invalid_argument(
        fmt::format("'{}' is not above 0 and at most {}", text, Derivation::kMostSigma));
  return sigma;
}

// A number, or "all".
void takeOneOrAll(const std::string& value, std::optional<std::int64_t>& number, bool& all) {
  all = value == "all";
  number = all ? std::nullopt : std::optional(parseCount(value));
}

// The keys of --select.
struct SelectKey {
  std::string_view key;
  unsigned choice;  // of ReadableFormat::Choice; 0: checked when the file is opened
  void (*set)(InputOptions&, const std::string&);
};
constexpr SelectKey kSelectKeys[] = {
    {"array", ReadableFormat::kGrid,
     [](InputOptions& o, const std::string& value) { o.grids.push_back(value); }},
    {"grid", ReadableFormat::kGrid,
     [](InputOptions& o, const std::string& value) { o.grids.push_back(value); }},
    {"series", ReadableFormat::kSeries,
     [](InputOptions& o, const std::string& value) { o.series = value; }},
    {"time", ReadableFormat::kTime,
     [](InputOptions& o, const std::string& value) { takeOneOrAll(value, o.time, o.all_times); }},
    {"channel", ReadableFormat::kChannel,
     [](InputOptions& o, const std::string& value) {
       takeOneOrAll(value, o.channel, o.all_channels);
     }},
    {"image", ReadableFormat::kImage,
     [](InputOptions& o, const std::string& value) { o.image = parseCount(value); }},
    {"component", 0,
     [](InputOptions& o, const std::string& value) { o.component = parseComponent(value); }},
};

// Takes "KEY=VALUE".
void select(InputOptions& options, const std::string& word) {
  const std::size_t equals = word.find('=');
  if (equals == std::string::npos || equals + 1 == word.size())
    throw std::invalid_argument(fmt::format("'{}' is not KEY=VALUE", word));
  for (const SelectKey& key : kSelectKeys)
    if (word.substr(0, equals) == key.key) return key.set(options, word.substr(equals + 1));
  std::string keys;
  for (const SelectKey& key : kSelectKeys)
    keys += fmt::format("{}{}", keys.empty() ? "" : ", ", key.key);
  throw std::invalid_argument(fmt::format("'{}' is none of {}", word.substr(0, equals), keys));
}

bool asksForAllGrids(const InputOptions& input) {
  return std::find(input.grids.begin(), input.grids.end(), "all") != input.grids.end();
}

enum class Side { kInput, kOutput };

// Options, or "--select KEY", that are for some formats alone.
struct OptionFit {
  Side side;
  std::initializer_list<const char*> options;
  const char* what_for;                             // in the line that refuses it
  std::initializer_list<std::string_view> formats;  // how VolumeInfo::format of an input begins, or
                                                    // the name of an output ends
};

const OptionFit kFits[] = {
    {Side::kInput, {"--dicom-float32"}, "DICOM series", {"DICOM"}},
    {Side::kInput, {"--raw-dims"}, "files without a header", {"raw"}},
    {Side::kInput,
     {"--level", "--all-levels", "--no-map", "--with-ranges", "--with-curvature"},
     "pyramids (.isb)",
     {"isobrick pyramid"}},
    {Side::kOutput,
     {"--half", "--vdb-codec", "--vdb-background", "--vdb-tolerance", "--with-ranges",
      "--with-curvature"},
     ".vdb",
     {".vdb"}},
    {Side::kOutput, {"--zarr-version", "--zarr-shard", "--part"}, ".ome.zarr", {".zarr"}},
    {Side::kOutput, {"--lossy"}, ".vdb and slices of .exr", {".vdb", ".exr"}},
    {Side::kOutput, {"--all-levels"}, ".vdb and .ome.zarr", {".vdb", ".zarr"}},
    {Side::kOutput, {"--codec", "--no-curvature"}, ".isb", {".isb"}},
};

// "--level", or "--select time" for "--select time=3".
bool wasGiven(const CLI::App& parser, const std::string& name) {
  const std::size_t space = name.find(' ');
  const CLI::Option* const option = findOption(parser, name.substr(0, space));
  if (option == nullptr || option->count() == 0) return false;
  if (space == std::string::npos) return true;
  const std::vector<std::string> values = option->results();
  return std::any_of(values.begin(), values.end(), [&](const std::string& value) {
    return value.starts_with(name.substr(space + 1) + "=");
  });
}

template <typename Fits>
void refuseUnfit(const CLI::App& parser, Side side, const std::string& name, const char* is_what,
                 const Fits& fits) {
  for (const OptionFit& fit : kFits)
    for (const char* const option : fit.options)
      if (fit.side == side && wasGiven(parser, option) &&
          std::none_of(fit.formats.begin(), fit.formats.end(), fits))
        throw UsageError(fmt::format("{} is for {}, and '{}' is {}; leave it out", option,
                                     fit.what_for, name, is_what));
}

}  // namespace

std::vector<InputOptions> inputsOfGrids(const InputOptions& input) {
  std::vector<std::string> names = input.grids;
  if (asksForAllGrids(input)) {
    InputOptions any = input;
    any.grids.clear();
    names = gridNames(input.path, openOptionsOf(any));
    if (names.empty())
      throw UsageError(
          fmt::format("--select grid=all is for .vdb files with grids of numbers, and '{}' is none",
                      input.path));
  }
  if (names.empty()) return {input};
  std::vector<InputOptions> inputs;
  for (const std::string& name : names) {
    inputs.push_back(input);
    inputs.back().grids = {name};
  }
  return inputs;
}

void addInputOptions(CLI::App& app, std::vector<std::string>& paths, InputOptions& options) {
  app.add_option("INPUT", paths,
                 "Volumes of the formats that 'isobrick formats' lists, folders of a DICOM "
                 "series or of slices, or raw files; quoted patterns ('scans/*.nrrd') too; "
                 "URLs of OME-Zarr; phantom:NAME:SIZE, or phantom:NAME:SIZE:TYPE")
      ->type_name("PATH")
      ->required();
  addOpenOptions(app, options);
}

void addOpenOptions(CLI::App& app, InputOptions& options) {
  options.parser = &app;
  CLI::Option* const dims =
      addParsedOption(app, "--raw-dims", options.raw_dims, parseIndex3, "X,Y,Z",
                      "The input has no header, and this many voxels per axis");
  CLI::Option* const type =
      app.add_option("--raw-type", options.raw.type, "Its voxels; u32, i32 and f64 become float32")
          ->type_name("T")
          ->check(CLI::IsMember(rawTypeNames()));
  dims->needs(type);
  type->needs(dims);
  app.add_option("--raw-endian", options.raw_endian, "Its byte order; default: little")
      ->type_name("E")
      ->check(CLI::IsMember({"little", "big"}))
      ->needs(dims);
  addParsedOption(app, "--raw-offset", options.raw.offset_bytes, parseCount, "BYTES",
                  "Bytes in front of its first voxel; default: 0")
      ->needs(dims);
  const auto behindUnit = [](auto parse, std::string& unit) {
    return [parse, &unit](std::string text) {
      unit = takeUnitName(text);
      return parse(text);
    };
  };
  addParsedOption(app, "--spacing", options.spacing, behindUnit(parseSpacing, options.spacing_unit),
                  "X,Y,Z[mm]", kSpacingHelp);
  addParsedOption(app, "--origin", options.origin, behindUnit(parsePoint, options.origin_unit),
                  "X,Y,Z[mm]", kOriginHelp);
  addParsedOption(app, "--input-unit", options.unit, parseLengthUnit, "UNIT", kInputUnitHelp);
  addParsedOption(
      app, "--label", options.derivation.label, parseLabel, "ID",
      "Take the indicator of a label instead: 1 where a voxel is this number, and 0 "
      "elsewhere, whose half-way surface is that of the label; of integers of any size");
  addParsedOption(app, "--denoise", options.derivation.denoise, parseSigma, "SIGMA",
                  "Smooth the volume first, after --label, with a Gaussian of so many voxels that "
                  "is sharpened so that round shapes keep their size; up to 10. The result is "
                  "float32");
  addSelectOption(app, [&options](const std::string& word) { select(options, word); });
  app.add_flag("--dicom-float32", options.dicom_float32,
               "Take a DICOM series as float32, if its headers promise 16 bits and its values do "
               "not keep to them");
}

OpenOptions openOptionsOf(const InputOptions& input) {
  if (input.all_times || input.all_channels)
    throw UsageError(
        fmt::format("--select {0}=all makes a pyramid of each, and goes with 'isobrick build'; "
                    "choose one, --select {0}=N",
                    input.all_channels ? "channel" : "time"));
  OpenOptions options;
  options.dicom_float32 = input.dicom_float32;
  options.pyramid_level = input.pyramid_level;
  if (!input.derivation.isNone() && !options.pyramid_level) options.pyramid_level = 0;
  options.derivation = input.derivation;
  options.keep_numbers = input.keep_numbers;
  if (input.grids.size() > 1 || asksForAllGrids(input))
    throw UsageError(
        "several grids go into pyramids of their own, or into one .vdb; choose one of "
        "them with --select grid=NAME");
  if (!input.grids.empty()) options.grid = input.grids.front();
  options.time = input.time;
  options.channel = input.channel;
  options.image = input.image;
  options.component = input.component;
  options.series = input.series;
  static_cast<GivenPlace&>(options) = input;
  if (input.raw_dims) {
    options.raw = input.raw;
    options.raw->voxels = *input.raw_dims;
    options.raw->big_endian = input.raw_endian == "big";
  }
  return options;
}

void refuseKnownMisfits(const InputOptions& input) {
  try {
    refuseUnusablePath(input.path, openOptionsOf(input));
  } catch (const Error& error) {
    const std::vector<Remedy>& remedies = error.remedies();
    if (std::find(remedies.begin(), remedies.end(), Remedy::kDescribeRawFile) == remedies.end())
      throw;
    throw UsageError(failureText(error, optionsOf(*input.parser)));
  }
}

std::optional<PhantomSpec> phantomOf(const std::string& input) {
  constexpr std::string_view kPrefix = "phantom:";
  if (input.rfind(kPrefix, 0) != 0) return std::nullopt;
  PhantomSpec spec;
  spec.name = input.substr(kPrefix.size());
  const std::size_t colon = spec.name.find(':');
  if (colon == std::string::npos) return spec;
  std::string size = spec.name.substr(colon + 1);
  spec.name.resize(colon);
  if (const std::size_t second = size.find(':'); second != std::string::npos) {
    const std::string type = size.substr(second + 1);
    size.resize(second);
    spec.voxel_type = voxelTypeNamed(type);
    if (!spec.voxel_type)
      throw Error(
          fmt::format("the type of '{}' cannot be used: it is u8, i8, u16, i16 or f32", input));
  }
  try {
    spec.size = parseInteger(size, 2, kMaxVoxelsPerAxis);
  } catch (const std::invalid_argument& wrong) {
    throw Error(fmt::format("the size of '{}' cannot be used: {}", input, wrong.what()));
  }
  return spec;
}

std::string defaultOutputName(const std::string& input_path) {
  if (const auto phantom = phantomOf(input_path))
    return fmt::format("{}-{}.isb", phantom->name, phantom->size);
  fs::path path = fs::path(input_path);
  if (isFolder(path)) {
    // "." and "scans/" have a name too.
    const fs::path whole = canonicalPath(path);
    return (whole.has_filename() ? whole.filename().string() : "volume") + ".isb";
  }
  if (lowerExtension(path) == ".gz") path = path.stem();
  return path.stem().string() + ".isb";
}

void refuseUnfitInputOptions(const CLI::App& parser, const VolumeInfo& input) {
  for (const SelectKey& key : kSelectKeys) {
    const std::string option = fmt::format("--select {}", key.key);
    if (key.choice == 0 || !wasGiven(parser, option)) continue;
    std::string names;
    bool fits = false;
    for (const ReadableFormat& format : readableFormats())
      if ((format.choices & key.choice) != 0) {
        names += fmt::format("{}{}", names.empty() ? "" : ", ", format.name);
        fits |= format.isOf(input.format);
      }
    if (!fits)
      throw UsageError(fmt::format("{} is for {}, and '{}' is {}; leave it out", option, names,
                                   input.source, input.format));
  }
  refuseUnfit(parser, Side::kInput, input.source, input.format.c_str(),
              [&](std::string_view format) { return input.format.starts_with(format); });
}

void refuseUnfitOutputOptions(const CLI::App& parser, const std::string& output) {
  refuseUnfit(parser, Side::kOutput, output, "none",
              [&](std::string_view ending) { return output.ends_with(ending); });
}

}  // namespace isobrick
