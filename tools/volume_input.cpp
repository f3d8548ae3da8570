#include "tools/volume_input.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/failure_text.h"
#include "tools/interrupt.h"
#include "tools/own_folder.h"
#include "tools/plain_text.h"
#include "tools/program_run.h"
#include "tools/progress_bar.h"
#include "tools/pyramid_cache.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// A build takes an arena of memory for its buffers, and libraries of formats may be slow to stop.
constexpr int kTidyEndMilliseconds = 3000;
constexpr std::string_view kOwnName = "isobrick: ";

constexpr char kFileHelp[] =
    "Pyramid (.isb), also behind http://, https://, s3:// or gs://; or a volume as 'isobrick "
    "build' reads "
    "it, a DICOM folder, OME-Zarr behind such a URL, or phantom:NAME:SIZE, of which a pyramid is "
    "built into the cache if one is needed";

// An option of `isobrick build` about a volume, which checks the value.
struct VolumeWord {
  const char *option, *type, *description;
};
constexpr VolumeWord kVolumeWords[] = {
    {"--spacing", "X,Y,Z[mm]", kSpacingHelp},
    {"--origin", "X,Y,Z[mm]", kOriginHelp},
    {"--input-unit", "UNIT", kInputUnitHelp},
    {"--raw-dims", "X,Y,Z", "The input has no header, and this many voxels per axis"},
    {"--raw-type", "T", "Its voxels, as for 'isobrick build'"},
    {"--raw-endian", "E", "Its byte order; default: little"},
    {"--raw-offset", "BYTES", "Bytes in front of its first voxel"},
};

constexpr VolumeWord kDerivationWords[] = {
    {"--label", "ID",
     "The surface of a label of an integer volume: half way between its voxels and all others; no "
     "isovalue is needed. 'isobrick extract' takes several, 3,7. Neighbours have walls of their "
     "own"},
    {"--denoise", "SIGMA",
     "Smooth the volume, or the label, first: a Gaussian of so many voxels, sharpened so that "
     "round shapes keep their size; up to 10"},
};

template <std::size_t kCount>
bool isOneOf(const VolumeWord (&words)[kCount], const std::string& option) {
  return std::any_of(std::begin(words), std::end(words),
                     [&](const VolumeWord& word) { return option == word.option; });
}

// Whether all options that the text names are among those, or are this command's too.
bool namesVolumeWordsOnly(const std::string& text) {
  const std::vector<std::string> options = optionsNamedIn(text);
  return std::all_of(options.begin(), options.end(), [](const std::string& option) {
    return option == "--select" || option == "--mask-nan" || option == "--cache-folder" ||
           isOneOf(kVolumeWords, option) || isOneOf(kDerivationWords, option);
  });
}

bool isPhantomName(const std::string& input) { return input.rfind("phantom:", 0) == 0; }

// Whole, so that no path is taken for an option, and a pyramid says of what it was made.
std::string wholePath(const std::string& volume) {
  if (isPhantomName(volume) || isRemotePath(volume)) return volume;
  const fs::path whole = absolutePath(volume);
  return (whole.has_filename() ? whole : whole.parent_path()).string();
}

struct BuiltPyramid {
  std::string path;
  bool is_new = false;
};

nlohmann::ordered_json outputOf(const ProgramCall& call, const CancelFlag& cancel) {
  try {
    auto json = nlohmann::ordered_json::parse(runProgram(call, &cancel), nullptr, false);
    if (json.is_object() && json.contains("output")) return json;
    throw Error("'isobrick-build' does not say what it built; install isobrick again");
  } catch (const ProgramFailure& failure) {
    std::string said = failure.said;
    if (said.rfind(kOwnName, 0) == 0) said.erase(0, kOwnName.size());
    if (said.empty()) throw Error(failure.what());
    said.resize(std::min(said.find("; try 'isobrick build --help'"), said.size()));
    // Options in it are those of `build`.
    throw Error(namesVolumeWordsOnly(said) ? said : "'isobrick build' says: " + said);
  }
}

// `isobrick build` of a volume into the cache.
ProgramCall callOfBuild(const std::string& volume, const VolumeBuild& build) {
  ProgramCall call;
  const bool is_url = isRemotePath(volume);  // whose query may be a secret (tools/user_words.h)
  if (is_url) call.environment.push_back("ISOBRICK_URL=" + volume);
  call.words = {
      requireOwn("isobrick-build"),
      "build",
      is_url ? "env:ISOBRICK_URL" : wholePath(volume),
      "--into-cache",
      build.cache_folder.empty() ? defaultCacheFolder() : absolutePath(build.cache_folder).string(),
      "--progress-lines",
      "--json"};
  call.words.insert(call.words.end(), build.words.begin(), build.words.end());
  call.on_error_line = [tell = build.tell_line](std::string_view line) {
    if (line.starts_with(kWarningWord))
      fmt::print(stderr, "{}\n", line);
    else if (tell)
      tell(line);
  };
  call.tidy_end_milliseconds = kTidyEndMilliseconds;
  return call;
}

BuiltPyramid buildIntoCache(const std::string& volume, const VolumeBuild& build,
                            const CancelFlag& cancel) {
  ProgramCall call = callOfBuild(volume, build);
  if (build.cache_folder.empty())
    call.words.insert(call.words.end(), {"--cache-most", std::to_string(kManyCachedBytes)});
  // Another process may remove a pyramid before this one has it.
  constexpr int kMostTimes = 10;
  for (int time = 0; time < kMostTimes; ++time) {
    const nlohmann::ordered_json json = outputOf(call, cancel);
    const BuiltPyramid built{json["output"].get<std::string>(), !json.value("skipped", false)};
    if (usePyramid(built.path)) return built;
  }
  throw Error(fmt::format("the pyramid of '{}' was removed from the cache again and again before "
                          "it could be opened; build it with 'isobrick build'",
                          volume),
              {.path = volume});
}

}  // namespace

CLI::Option* addVolumeInput(CLI::App& app, VolumeInput& input) {
  return app.add_option("FILE", input.path, kFileHelp)->type_name("PATH");
}

CLI::Option* addVolumeInputs(CLI::App& app, std::vector<std::string>& paths) {
  return app.add_option("FILE", paths, std::string(kFileHelp) + "; several, one after the other")
      ->type_name("PATH");
}

void addVolumeOptions(CLI::App& app, VolumeInput& input) {
  addSelectOption(app, [&input](const std::string& word) {
    input.selections.push_back("--select=" + word);
  })->group(kVolumeGroup);
  app.add_flag_callback(
         "--mask-nan", [&input] { input.selections.emplace_back("--mask-nan"); }, kMaskNanHelp)
      ->group(kVolumeGroup);
  for (const VolumeWord& word : kVolumeWords)
    app.add_option(word.option, input.words[word.option], word.description)
        ->type_name(word.type)
        ->group(kVolumeGroup);
  for (const VolumeWord& word : kDerivationWords)
    app.add_option(word.option, input.derivation[word.option], word.description)
        ->type_name(word.type)
        ->group(kDerivationGroup);
  addCacheFolderOption(app, input.cache_folder)->group(kVolumeGroup);
  addCacheSizeOption(app, input.cache_bytes);
}

CLI::Option* addCacheFolderOption(CLI::App& app, std::string& folder) {
  return app
      .add_option("--cache-folder", folder,
                  "Folder for pyramids of volumes, and for parts of pyramids behind URLs; default: "
                  "isobrick in XDG_CACHE_HOME or ~/.cache")
      ->type_name("DIR");
}

CLI::Option* addCacheSizeOption(CLI::App& app, std::uint64_t& bytes) {
  return addParsedOption(app, "--cache-size", bytes, parseByteSize, "SIZE",
                         "Keep the parts that were read in the cache folder, at most so much of "
                         "all pyramids, such as 4G; default: none stay")
      ->group(kRemoteGroup);
}

RemoteOptions remoteOptions(const std::string& cache_folder, std::uint64_t cache_bytes) {
  RemoteOptions remote;
  remote.cache_bytes = cache_bytes;
  if (cache_bytes > 0)
    remote.cache_folder = cache_folder.empty() ? defaultCacheFolder() : cache_folder;
  return remote;
}

bool isVolume(const std::string& path) {
  const std::string file = splitHdf5Name(path).first;
  return isPhantomName(path) || isRemoteVolume(path) ||
         ((isFolder(file) || isRegularFile(file)) && !isPyramidFile(file));
}

std::vector<std::string> wordsForBuild(const VolumeInput& input) {
  std::vector<std::string> all = input.selections;
  for (const auto& words : {input.words, input.derivation})
    for (const auto& [option, value] : words)
      if (!value.empty()) all.push_back(option + "=" + value);
  return all;
}

bool isReadAsVolume(const VolumeInput& input) {
  return isVolume(input.path) || std::any_of(input.derivation.begin(), input.derivation.end(),
                                             [](const auto& word) { return !word.second.empty(); });
}

void refuseWordsForPyramid(const VolumeInput& input) {
  const std::vector<std::string> words = wordsForBuild(input);
  if (!words.empty() && !isRemotePath(input.path) && !isNameTaken(input.path))
    throw Error(
        fmt::format("cannot open '{}': No such file or directory; check the path", input.path),
        {.path = input.path});
  if (!words.empty())
    throw UsageError(words.front() +
                     " says how to read a volume; give it with the volume, or to "
                     "'isobrick build', and leave it out of a pyramid");
}

Error tooLargeForCache(const std::string& volume, std::uint64_t bytes) {
  return Error(fmt::format("'{}' has {} of voxels, and so much goes into the cache only if its "
                           "folder is named with --cache-folder; or build its pyramid where it is "
                           "to stay, with 'isobrick build'",
                           volume, byteSizeText(bytes)),
               {.path = volume});
}

std::string pyramidOfVolume(const std::string& volume, const VolumeBuild& build,
                            const CancelFlag& cancel) {
  return buildIntoCache(volume, build, cancel).path;
}

std::string findPyramidOrFacts(VolumeInput& input) {
  input.pyramid = input.path;
  if (!isReadAsVolume(input)) {
    refuseWordsForPyramid(input);
    return {};
  }
  ProgramCall call = callOfBuild(input.path, {input.cache_folder, wordsForBuild(input), {}});
  call.words.emplace_back("--only-facts");
  const nlohmann::ordered_json json = outputOf(call, interruptFlag());
  if (!json["output"].is_string()) return json.value("facts", nlohmann::ordered_json()).dump();
  input.pyramid = json["output"].get<std::string>();
  usePyramid(input.pyramid);
  return {};
}

void findPyramid(VolumeInput& input, int threads, std::optional<std::uint64_t> memory_bytes) {
  input.pyramid = input.path;
  if (!isReadAsVolume(input)) return refuseWordsForPyramid(input);
  VolumeBuild build{input.cache_folder, wordsForBuild(input), {}};
  build.words.insert(build.words.end(), {"--threads", std::to_string(threads)});
  if (memory_bytes)
    build.words.insert(build.words.end(), {"--memory", std::to_string(*memory_bytes)});
  BuiltPyramid built;
  {
    ProgressBar bar(100, "%");
    build.tell_line = [&](std::string_view line) {
      double share = 0;
      if (takeWord(line, "progress") && takeNumber(line, share)) bar.show(line, share);
    };
    built = buildIntoCache(input.path, build, interruptFlag());
  }
  input.pyramid = built.path;
  if (built.is_new && isatty(STDERR_FILENO) == 1)
    fmt::print(stderr,
               "isobrick: the pyramid of '{}' ({}) is in the cache: {}; 'isobrick cache' lists "
               "and clears it\n",
               oneLine(input.path), byteSizeText(fileBytes(built.path)), oneLine(built.path));
}

}  // namespace isobrick
