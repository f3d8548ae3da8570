#include "tools/view/build_volume.h"

#include <fmt/format.h>

#include <charconv>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "isobrick/storage/error.h"
#include "tools/failure_text.h"
#include "tools/own_folder.h"
#include "tools/program_run.h"
#include "tools/view/preview_folder.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// A build takes an arena of memory for its buffers, and libraries of formats may be slow to stop.
constexpr int kTidyEndMilliseconds = 3000;
constexpr std::string_view kOwnName = "isobrick: ";

bool isPhantomName(const std::string& input) { return input.rfind("phantom:", 0) == 0; }

// Takes a word and the space behind it off the line; false where it begins with another one.
bool takeWord(std::string_view& line, std::string_view word) {
  if (line.substr(0, word.size()) != word || line.substr(word.size(), 1) != " ") return false;
  line.remove_prefix(word.size() + 1);
  return true;
}

// The same of a number.
template <typename T>
bool takeNumber(std::string_view& line, T& number) {
  const auto read = std::from_chars(line.data(), line.data() + line.size(), number);
  if (read.ec != std::errc()) return false;
  return takeWord(line, line.substr(0, static_cast<std::size_t>(read.ptr - line.data())));
}

// "progress 0.612 bricks", "preview 4 512 512 234 /dev/shm/1.isb"
void tellLine(std::string_view line, const BuildListener& listener) {
  if (takeWord(line, "progress")) {
    double share = 0.0;
    if (takeNumber(line, share)) listener.progress(line, share);
  } else if (takeWord(line, "preview")) {
    PreviewOf of;
    if (takeNumber(line, of.step) && takeNumber(line, of.voxels.x) &&
        takeNumber(line, of.voxels.y) && takeNumber(line, of.voxels.z))
      listener.preview(std::string(line), of);
  }
}

// Volumes of one name in several folders are to have a pyramid each.
std::string folderName(const fs::path& folder) {
  std::uint64_t hash = 0xcbf29ce484222325u;  // FNV-1a
  for (const char c : folder.string())
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  return fmt::format("{:016x}", hash);
}

// Where the pyramid goes. Throws Error where a folder for it cannot be made.
fs::path outputFolder(const fs::path& input, const std::string& cache_folder) {
  const fs::path beside = isPhantomName(input.string()) ? fs::current_path() : input.parent_path();
  if (cache_folder.empty()) return beside;
  const fs::path folder = fs::path(cache_folder) / folderName(beside);
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (failure)
    throw Error(fmt::format("cannot make the folder '{}': {}; choose another --cache",
                            folder.string(), failure.message()));
  return folder;
}

std::string builtPath(const std::string& printed) {
  const nlohmann::json json = nlohmann::json::parse(printed, nullptr, false);
  if (!json.is_object() || !json.contains("output") || !json["output"].is_string())
    throw Error("'isobrick-build' does not say what it built; install isobrick again");
  return json["output"].get<std::string>();
}

}  // namespace

VolumeBuilder volumeBuilder(ViewBuildOptions options) {
  return [options = std::move(options)](const std::string& input, const BuildListener& listener,
                                        const CancelFlag& cancel) {
    // Whole, so that no path is taken for an option, and a pyramid says of what it was made.
    fs::path whole =
        isPhantomName(input) ? fs::path(input) : fs::absolute(input).lexically_normal();
    if (!whole.has_filename()) whole = whole.parent_path();
    ProgramCall call;
    call.words = {(ownFolder() / "isobrick-build").string(),
                  "build",
                  whole.string(),
                  "--out-dir",
                  outputFolder(whole, options.cache_folder).string(),
                  "--threads",
                  std::to_string(options.threads),
                  "--any-options",
                  "--progress-lines",
                  "--json"};
    if (input == options.described_volume)
      call.words.insert(call.words.end(), options.description.begin(), options.description.end());
    const PreviewFolder previews;
    if (!previews.path().empty()) {
      call.words.insert(call.words.end(), {"--preview-folder", previews.path()});
      if (options.preview_share)
        call.words.insert(call.words.end(),
                          {"--preview-share", fmt::format("{}", *options.preview_share)});
    }
    call.on_error_line = [&](std::string_view line) { tellLine(line, listener); };
    call.tidy_end_milliseconds = kTidyEndMilliseconds;
    ProgramCall going_on = call;
    going_on.words.emplace_back("--resume");
    try {
      try {
        return builtPath(runProgram(going_on, &cancel));
      } catch (const ProgramFailure& failure) {
        // What was begun of another content, or differently, cannot be gone on with.
        if (failure.said.find("leave out --resume") == std::string::npos) throw;
        return builtPath(runProgram(call, &cancel));
      }
    } catch (const ProgramFailure& failure) {
      std::string said = failure.said;
      if (said.rfind(kOwnName, 0) == 0) said.erase(0, kOwnName.size());
      if (said.empty()) throw Error(failure.what());
      // Options in it are those of `build`.
      throw Error(optionsNamedIn(said).empty() ? said : "'isobrick build' says: " + said);
    }
  };
}

}  // namespace isobrick
