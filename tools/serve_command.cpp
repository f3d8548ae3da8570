// isobrick serve: volumes in browsers.
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/serve/access.h"
#include "isobrick/viewer/serve/serve.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/plain_text.h"
#include "tools/shared_options.h"
#include "tools/volume_input.h"

namespace isobrick {
namespace {

struct ServeArguments {
  std::vector<std::string> paths;
  ServeOptions options;
  std::string cache_folder;
  std::uint64_t cache_bytes = 0;
  std::string unit;  // of the input's lengths; empty: as it says
  bool json = false;
};

// A folder of other files, as of DICOM, is one volume.
bool isListedVolume(const std::string& path) {
  static const Json formats = volumeFormats();
  const auto isOf = [&](const Json& format) {
    return std::ranges::any_of(format["volume_endings"], [&](const Json& ending) {
      return lowercase(path).ends_with(ending.get<std::string>());
    });
  };
  return isPyramidFile(path) || std::ranges::any_of(formats["read"], isOf);
}

ServedVolume namedAfter(const std::string& path) {
  const std::string shown = isRemotePath(path) ? withoutSecrets(path) : path;
  const std::string name = std::filesystem::path(shown).filename().string();
  return {shownName(name.empty() ? shown : name), path};
}

// The volumes of a folder, or the folder as one.
std::vector<ServedVolume> volumesAt(const std::string& path) {
  if (!isRemotePath(path) && !isVolume(path) && !isPresent(path))
    throw Error(fmt::format("cannot open '{}': No such file or directory; check the path", path),
                {.path = path});
  std::vector<ServedVolume> volumes;
  if (!isRemotePath(path) && isFolder(path) && !isListedVolume(path)) {
    const FolderListing listing = listFolder(path, interruptFlag());
    for (const FolderEntry& entry : listing.entries) {
      const std::string member = (std::filesystem::path(listing.folder) / entry.name).string();
      if (isListedVolume(member)) volumes.push_back(namedAfter(member));
    }
  }
  if (volumes.empty()) volumes.push_back(namedAfter(path));
  return volumes;
}

VolumeBuilder builderOf(const ServeArguments& arguments) {
  const auto one_at_a_time = std::make_shared<std::mutex>();  // see runProgram()
  std::vector<std::string> words = {"--threads", std::to_string(arguments.options.threads)};
  if (!arguments.unit.empty()) words.insert(words.end(), {"--input-unit", arguments.unit});
  return [folder = arguments.cache_folder, words, one_at_a_time](
             const std::string& volume, const BuildListener& listener, const CancelFlag& cancel) {
    const std::lock_guard lock(*one_at_a_time);
    const auto tell = [&](std::string_view line) {
      double share = 0.0;
      if (takeWord(line, "progress") && takeNumber(line, share)) listener.progress(line, share);
    };
    return pyramidOfVolume(volume, {folder, words, tell}, cancel);
  };
}

std::string checkedBasePath(const std::string& path) {
  constexpr std::string_view kAllowed =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._~/";
  if (path.empty() || path == "/") return {};
  if (path.front() != '/' || path.back() == '/' ||
      path.find_first_not_of(kAllowed) != std::string::npos)
    throw std::invalid_argument("begins with / and ends without it, such as /isobrick");
  return path;
}

void warnOfAddress(const ServeOptions& options) {
  if (options.address.rfind("127.", 0) == 0 || options.address == "::1") return;
  fmt::print(stderr,
             "isobrick: warning: whoever can read the network between here and a browser can read "
             "key and volumes; put a proxy with TLS in front (docs/SERVE.md has the lines for "
             "nginx and Caddy), and leave --listen out\n");
}

int runServeCommand(ServeArguments& arguments) {
  ServeOptions& options = arguments.options;
  for (const std::string& path : arguments.paths)
    for (ServedVolume& volume : volumesAt(path)) options.volumes.push_back(std::move(volume));
  if (options.are_steps && options.volumes.size() < 2)
    throw UsageError("--steps goes through several FILE; give more of them");
  options.build = builderOf(arguments);
  options.remote = remoteOptions(arguments.cache_folder, arguments.cache_bytes);
  options.cancel = &interruptFlag();
  options.on_ready = [&arguments](const std::string& url) {
    if (!hasPage())
      fmt::print(stderr,
                 "isobrick: this build has no page: run tools/web_page.sh, "
                 "and build isobrick again\n");
    Json json = {{"url", url}, {"volumes", Json::array()}};
    for (const ServedVolume& volume : arguments.options.volumes)
      json["volumes"].push_back({{"name", volume.name}, {"path", withoutSecrets(volume.path)}});
    if (arguments.json)
      printJson(json);
    else
      fmt::print("{}\n", url);
    std::fflush(stdout);
  };
  warnOfAddress(options);
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(options.threads) + 1);
  const ServeSummary summary = runServer(options);
  fmt::print(stderr, "isobrick: {} requests and {} clients in {:.0f} s, {} sent\n",
             countText(summary.requests), countText(summary.clients), summary.seconds,
             byteSizeText(summary.bytes));
  return 0;
}

}  // namespace

Command addServeCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("serve", "Explore volumes in a browser");
  const auto arguments = std::make_shared<ServeArguments>();
  ServeOptions& options = arguments->options;
  options.memory_bytes = kDefaultMemoryBytes;
  options.threads = allCores();
  sub->add_option(
         "FILE", arguments->paths,
         "Pyramids (.isb), also behind http://, https://, s3:// or gs://; volumes as 'isobrick "
         "build' reads them, of which pyramids are built into the cache when they are "
         "asked for; folders of these")
      ->type_name("PATH")
      ->required();
  sub->add_flag("--steps", options.are_steps,
                "The volumes are steps of time, all of one grid: the page has a slider for them, "
                "and plays them");
  addParsedOption(*sub, "--input-unit", arguments->unit, parseLengthUnit, "UNIT", kInputUnitHelp);
  addCacheFolderOption(*sub, arguments->cache_folder);
  addCacheSizeOption(*sub, arguments->cache_bytes);
  addJsonFlag(*sub, arguments->json)
      ->description("Print one JSON object in place of the address, as soon as it listens");
  beginGroup(*sub, "Network");
  addParsedOption(*sub, "--port", options.port, integerWithin(0, 65535), "N",
                  "Port to listen on; default: 0, a free one");
  sub->add_option("--listen", options.address,
                  "Address of this machine to listen on; default: 127.0.0.1, which no other "
                  "machine reaches")
      ->type_name("ADDRESS");
  addRepeatedOption(
      *sub, "--origin",
      [&options](const std::string& word) {
        try {
          options.origins.insert(checkedOrigin(word));
        } catch (const Error& failure) {
          throw std::invalid_argument(failure.what());
        }
      },
      "URL",
      "Pages from there may use the server, and a proxy may have that name, such as "
      "https://scans.example.org; may be given again");
  addParsedOption(*sub, "--base-path", options.base_path, checkedBasePath, "/PATH",
                  "In front of all paths, if a proxy leaves it there");
  beginGroup(*sub, kResourceGroup);
  addMemoryOption(*sub, options.memory_bytes);
  addThreadsOption(*sub, options.threads);
  sub->footer(R"(
It prints the address to open, with a key that lets in, and ends with Ctrl-C. docs/SERVE.md says
more, and how to put it behind a proxy.

Examples:
  isobrick serve head.isb
  isobrick serve scans/ --memory 4G --port 8080
  isobrick serve run-*.isb --steps)");
  return {sub, [arguments] { return runServeCommand(*arguments); }};
}

}  // namespace isobrick
