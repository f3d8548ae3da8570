// isobrick cache: the pyramids that were built of volumes, and parts of those behind URLs.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/part_cache.h"
#include "isobrick/storage/pyramid.h"
#include "tools/command.h"
#include "tools/json_output.h"
#include "tools/plain_text.h"
#include "tools/pyramid_cache.h"
#include "tools/shared_options.h"
#include "tools/volume_input.h"

namespace isobrick {
namespace {

struct CacheArguments {
  std::string folder;  // empty: the default one
  bool clear = false;
  bool json = false;
};

std::string pyramidsText(std::size_t count) {
  return fmt::format("{} pyramid{}", count, count == 1 ? "" : "s");
}

// The volume that it was made of; empty if its file does not state it.
std::string sourceOf(const CachedPyramid& entry) try {
  const Pyramid pyramid(entry.path);
  return textOf(member(parseShallowJson(pyramid.provenance()), "source"));
} catch (const Error&) {
  return {};
}

std::string timeText(const std::timespec& time) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(time.tv_sec));
}

void printCacheJson(const std::string& folder, const std::vector<CachedPyramid>& entries) {
  Json json = Json::object();
  json["folder"] = folder;
  json["bound_bytes"] = cacheBound();
  std::uint64_t total = 0;
  json["pyramids"] = Json::array();
  for (const CachedPyramid& entry : entries) {
    total += entry.bytes;
    json["pyramids"].push_back({{"path", entry.path},
                                {"bytes", entry.bytes},
                                {"last_used", timeText(entry.last_used)},
                                {"whole", entry.is_whole},
                                {"source", sourceOf(entry)}});
  }
  json["bytes"] = total;
  const KeptParts parts = keptParts(folder);
  json["remote_parts"] = {{"count", parts.count}, {"bytes", parts.bytes}};
  printJson(json);
}

void printCacheText(const std::string& folder, const std::vector<CachedPyramid>& entries) {
  std::uint64_t total = 0;
  TextTable table("LRLL");
  for (const CachedPyramid& entry : entries) {
    total += entry.bytes;
    table.add({entry.path.substr(entry.path.rfind('/') + 1), byteSizeText(entry.bytes),
               timeText(entry.last_used),
               entry.is_whole ? oneLine(sourceOf(entry)) : "(unfinished)"});
  }
  fmt::print("{}{}: {}, {} of at most {}\n", table.text(), oneLine(folder), entries.size(),
             byteSizeText(total), byteSizeText(cacheBound()));
  if (const KeptParts parts = keptParts(folder); parts.count > 0)
    fmt::print("parts of pyramids behind URLs: {}, {}\n", countText(parts.count),
               byteSizeText(parts.bytes));
}

void printRemoval(const std::string& folder, const CacheRemoval& removal, const KeptParts& parts,
                  bool as_json) {
  if (as_json) {
    Json json = Json::object();
    json["folder"] = folder;
    json["removed"] = removal.removed;
    json["removed_bytes"] = removal.bytes;
    json["in_use"] = removal.in_use;
    json["remote_parts"] = {{"count", parts.count}, {"bytes", parts.bytes}};
    return printJson(json);
  }
  fmt::print(
      "{}: removed {}, {}{}\n", oneLine(folder), pyramidsText(removal.removed),
      byteSizeText(removal.bytes),
      removal.in_use > 0 ? fmt::format("; {} in use, kept", pyramidsText(removal.in_use)) : "");
  if (parts.count > 0)
    fmt::print("parts of pyramids behind URLs: removed {}, {}\n", countText(parts.count),
               byteSizeText(parts.bytes));
}

int runCache(const CacheArguments& arguments) {
  const std::string folder = arguments.folder.empty() ? defaultCacheFolder() : arguments.folder;
  if (arguments.clear) {
    const CacheRemoval removal = clearCache(folder);
    printRemoval(folder, removal, trimParts(folder, 0), arguments.json);
    return 0;
  }
  std::vector<CachedPyramid> entries = listCache(folder);
  std::erase_if(entries, [](const CachedPyramid& entry) { return entry.bytes == 0; });
  if (arguments.json)
    printCacheJson(folder, entries);
  else
    printCacheText(folder, entries);
  return 0;
}

}  // namespace

Command addCacheCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("cache",
                         "List or clear what commands keep: pyramids of volumes, and parts "
                         "of pyramids behind URLs");
  const auto arguments = std::make_shared<CacheArguments>();
  sub->add_flag("--clear", arguments->clear, "Remove all but those that a process uses");
  addCacheFolderOption(*sub, arguments->folder);
  addJsonFlag(*sub, arguments->json);
  sub->footer(fmt::format(R"(
'extract', 'render', 'view', 'bench' and 'info' build the pyramid of a volume here, and find it again
until the volume changes. Beyond {} (or what the variable ISOBRICK_CACHE_SIZE says, such as 100G) the
least recently used pyramids go; the newest one stays, however large it is. Parts of pyramids behind
URLs come here with --cache-size, which bounds them.

Example:
  isobrick cache --clear)",
                          byteSizeText(kDefaultCacheBytes)));
  return {sub, [arguments] { return runCache(*arguments); }};
}

}  // namespace isobrick
