#include "tools/build/existing_output.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "tools/failure_text.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr char kWaysOut[] =
    "replace it with --force, or choose another output with -o or --out-dir";

bool beginsAsPyramid(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  char magic[sizeof format::kMagic] = {};
  return file.read(magic, sizeof magic) &&
         std::equal(std::begin(magic), std::end(magic), std::begin(format::kMagic));
}

// What a pyramid says of its making; empty where it says nothing.
struct Origin {
  std::string source, identity;
};

// Anybody may have made the file: what is no JSON, or is nested without end, says nothing.
Origin originOf(const Pyramid& pyramid) {
  using Json = nlohmann::json;
  constexpr int kDeepest = 32;
  const auto guard = [](int depth, Json::parse_event_t, Json&) { return depth <= kDeepest; };
  const Json json = Json::parse(pyramid.provenance(), guard, false);
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

// A relative path names another file in another folder, and a pyramid does not say where it was
// built. One that lies in the current folder, or below it, was most likely built from here.
bool meansTheSameFile(const std::string& source, const std::string& output) {
  if (fs::path(source).is_absolute()) return true;
  std::error_code error;
  const fs::path from_here = fs::proximate(output, error);
  return !error && from_here.is_relative() && *from_here.begin() != "..";
}

}  // namespace

void refusePreciousOutput(const std::string& input, const std::string& output, bool force) {
  std::error_code ignored;
  if (fs::equivalent(input, output, ignored))
    throw Error(fmt::format("'{}' is the input; choose another output with -o", output));
  if (!fs::is_regular_file(output, ignored) || beginsAsPyramid(output)) return;
  if (fs::file_size(output, ignored) > 0)
    throw Error(
        fmt::format("'{}' exists and is not a pyramid, and only pyramids are ever replaced; choose "
                    "another output with -o or --out-dir",
                    output));
  if (!force) throw Error(fmt::format("'{}' exists already; {}", output, kWaysOut));
}

bool isUpToDate(const std::string& output, const VolumeInfo& info,
                const std::string& input_identity, const BuildOptions& options, bool any_options) {
  std::error_code ignored;
  if (!fs::is_regular_file(output, ignored)) return false;
  Origin origin;
  try {
    origin = originOf(Pyramid(output));
  } catch (const Error& error) {
    throw Error(fmt::format("'{}' exists, and from what it was made is unknown ({}); {}", output,
                            failureText(error), kWaysOut));
  }
  const std::string identity = buildIdentity(info, input_identity, options);
  if (origin.identity == identity) return true;
  if (inputLine(origin.identity) == inputLine(identity)) return any_options;
  if (origin.source != info.source)
    throw Error(
        fmt::format("'{}' exists and was made from '{}'; {}", output, origin.source, kWaysOut));
  if (!meansTheSameFile(origin.source, output))
    throw Error(
        fmt::format("'{}' exists and was made from another '{}', or from this one before it "
                    "changed; {}",
                    output, origin.source, kWaysOut));
  return false;
}

}  // namespace isobrick
