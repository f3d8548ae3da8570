// FILE of the commands that take a volume as they take a pyramid: the volume's pyramid is built
// into the cache (tools/pyramid_cache.h), or found there.
#pragma once

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

struct VolumeInput {
  std::string path;                          // as the user named it
  std::string pyramid;                       // the file to open, after findPyramid()
  std::map<std::string, std::string> words;  // how to read a volume, by option of `isobrick build`
  std::map<std::string, std::string> derivation;  // what is made of it, or of a pyramid; likewise
  std::vector<std::string> selections;  // the same of --select and --mask-nan, a word each
  std::string cache_folder;             // empty: the default one
  std::uint64_t cache_bytes = 0;        // of remote parts in that folder; 0: none stay
};

// The --help group of the options that say how to read a volume.
inline constexpr char kVolumeGroup[] = "If FILE is a volume";
// That of the options that make another volume of FILE.
inline constexpr char kDerivationGroup[] = "Volume";
// The same of those for a pyramid behind a URL.
inline constexpr char kRemoteGroup[] = "If FILE is a URL";

// The options of a command but for those of these names, and those of reading FILE.
template <typename App>
auto optionsBeside(App& app, std::initializer_list<const char*> names) {
  return app.get_options([&](const CLI::Option* option) {
    const std::string& group = option->get_group();
    return group != kVolumeGroup && group != kDerivationGroup && group != kRemoteGroup &&
           std::none_of(names.begin(), names.end(),
                        [&](const char* name) { return option->check_name(name); });
  });
}

// True if --mask-nan was given.
inline bool masksNan(const VolumeInput& input) {
  return std::find(input.selections.begin(), input.selections.end(), "--mask-nan") !=
         input.selections.end();
}

// Begins a line on stderr that reaches the user also if another program is in between.
inline constexpr std::string_view kWarningWord = "isobrick: warning: ";

// Larger volumes come into the cache only if its folder is named, and more in it is warned of: the
// home folder is small.
inline constexpr std::uint64_t kManyCachedBytes = 8'000'000'000;

// FILE, and the same of several.
CLI::Option* addVolumeInput(CLI::App& app, VolumeInput& input);
CLI::Option* addVolumeInputs(CLI::App& app, std::vector<std::string>& paths);
// Options for reading it if it is a volume, and those that make another volume of it.
void addVolumeOptions(CLI::App& app, VolumeInput& input);

// --cache-folder.
CLI::Option* addCacheFolderOption(CLI::App& app, std::string& folder);
// --cache-size, of the commands that read pyramids behind URLs.
CLI::Option* addCacheSizeOption(CLI::App& app, std::uint64_t& bytes);

// How a pyramid behind a URL is read. Throws Error if there is no folder for its parts.
RemoteOptions remoteOptions(const std::string& cache_folder, std::uint64_t cache_bytes);
inline RemoteOptions remoteOptions(const VolumeInput& input) {
  return remoteOptions(input.cache_folder, input.cache_bytes);
}

// A file or a folder that is there and is no pyramid, the URL of an OME-Zarr store, or the name of
// a phantom. Everything else is opened as a pyramid, and that says what is wrong.
bool isVolume(const std::string& path);

// True if it is read as a volume: it is one, or a pyramid of which another volume is made.
bool isReadAsVolume(const VolumeInput& input);

// Throws UsageError if words for volumes were given.
void refuseWordsForPyramid(const VolumeInput& input);

// What `isobrick build` says to its caller, which has these options.
Error tooLargeForCache(const std::string& volume, std::uint64_t bytes);

// Sets input.pyramid: the path itself, or if it is read as a volume the pyramid in the cache, which
// stays there
// until this process ends. Builds with `threads` and `memory_bytes` (nothing: the default), with a
// progress bar. Throws Error, Cancelled, and UsageError if words for volumes come with a
// pyramid.
void findPyramid(VolumeInput& input, int threads, std::optional<std::uint64_t> memory_bytes);

// For `isobrick info`: sets input.pyramid likewise if the pyramid is there, and returns nothing;
// else the facts of the volume, JSON of factsOfVolume(). Builds nothing.
std::string findPyramidOrFacts(VolumeInput& input);

// For a program that shows the progress itself.
struct VolumeBuild {
  std::string cache_folder;                         // empty: the default one
  std::vector<std::string> words;                   // for `isobrick build`
  std::function<void(std::string_view)> tell_line;  // each line of its stderr
};
// Runs `isobrick build` in a process of its own, so that this one needs neither ITK nor OpenVDB,
// and returns the pyramid's path. A build that was interrupted before goes on. Once cancelled, the
// process has ended when this throws; what is done by then stays for the next time.
std::string pyramidOfVolume(const std::string& volume, const VolumeBuild& build,
                            const CancelFlag& cancel);

// The words that were given, as `isobrick build` takes them: "--raw-dims=3,4,5".
std::vector<std::string> wordsForBuild(const VolumeInput& input);

}  // namespace isobrick
