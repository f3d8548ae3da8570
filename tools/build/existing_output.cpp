#include "tools/build/existing_output.h"

#include <fmt/format.h>

#include <filesystem>

#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// What a pyramid says of its making; empty where it says nothing.
struct Origin {
  std::string source, identity;
};

// Anybody may have made the file: what is no JSON, or is nested without end, says nothing.
Origin originOf(const Pyramid& pyramid) {
  using Json = nlohmann::json;
  const Json json = parseShallowJson(pyramid.provenance());
  const auto text = [&](const char* key) {
    const auto found = json.is_object() ? json.find(key) : json.end();
    return found != json.end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  return {text("source"), text("identity")};
}

// The first line of an identity: the files' sizes, times and content, without any option.
std::string inputLine(const std::string& identity) {
  return identity.substr(0, identity.find('\n'));
}

// Which voxels of the input, and where: what users say of it is in these lines.
std::string volumeLines(const std::string& identity) {
  std::string lines;
  for (const char* name : {"\nvoxels=", "\nformat="}) {
    const std::size_t at = identity.find(name);
    if (at != std::string::npos) lines += identity.substr(at, identity.find('\n', at + 1) - at);
  }
  return lines;
}

// A relative path names another file in another folder, and a pyramid does not say where it was
// built. One that lies in the current folder, or below it, was most likely built from here.
bool meansTheSameFile(const std::string& source, const std::string& output) {
  if (fs::path(source).is_absolute()) return true;
  std::error_code error;
  const fs::path from_here = fs::proximate(output, error);
  return !error && from_here.is_relative() && *from_here.begin() != "..";
}

}  // namespace

bool isUpToDate(const std::string& output, const VolumeInfo& info,
                const std::string& input_identity, const BuildOptions& options, bool any_options,
                bool force) {
  std::error_code ignored;
  if (!fs::is_regular_file(output, ignored)) return false;
  const auto inTheWay = [&](const std::string& why) {
    if (!force)
      throw Error(fmt::format("'{}' exists and {}; replace it with --force, or choose another "
                              "output with -o or --out-dir",
                              output, why),
                  {.path = output});
    return false;
  };
  Origin origin;
  try {
    origin = originOf(Pyramid(output));
  } catch (const Error& error) {
    return inTheWay(fmt::format("from what it was made is unknown ({})", error.what()));
  }
  const std::string identity = buildIdentity(info, input_identity, options);
  if (origin.identity == identity) return true;
  if (inputLine(origin.identity) == inputLine(identity))
    return any_options &&
           (info.encoding.empty() || volumeLines(origin.identity) == volumeLines(identity));
  if (origin.source != info.source)
    return inTheWay(fmt::format("was made from '{}'", origin.source));
  if (!meansTheSameFile(origin.source, output))
    return inTheWay(fmt::format("was made from another '{}', or from this one before it changed",
                                origin.source));
  return false;
}

}  // namespace isobrick
