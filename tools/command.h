// A subcommand: a parser for its words and the work that follows.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

struct Command {
  CLI::App* parser = nullptr;  // owned by the App that it was added to
  std::function<int()> run;    // returns the exit status; throws Error, Cancelled and UsageError
};

// The words given do not fit together, which shows only after they were parsed: exit status 2.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// The option of this name, or nullptr. Unlike CLI::App::get_option(), which ends the program if it
// finds no memory, it throws std::bad_alloc then.
template <typename App>
auto findOption(App& app, const std::string& name) {
  const auto found =
      app.get_options([&](const CLI::Option* option) { return option->check_name(name); });
  return found.empty() ? nullptr : found.front();
}

// Whether `app` has an option, for tools/failure_text.h.
inline auto optionsOf(const CLI::App& app) {
  return [&app](const std::string& name) { return findOption(app, name) != nullptr; };
}

// The subcommands of this executable (isobrick_commands.cpp, build/isobrick_build_commands.cpp,
// view/view_command.cpp).
std::vector<Command> addCommands(CLI::App& app);

// The subcommand for a file that is named without one; nothing if the word is no file.
std::optional<std::string> commandOfFile(const std::string& word);

// If another executable has the subcommand `name`, becomes that executable, with the words `argv`;
// else returns. Throws Error if it cannot be run.
void runExternalCommand(std::string_view name, char** argv);

// Makes the index of a pyramid of many files, whose files are all there.
using PyramidJoin = int(const std::string& folder, std::uint64_t memory_bytes, int threads,
                        bool json);
// isobrick-build does it: `isobrick` becomes that here, which begins anew.
PyramidJoin* pyramidJoin();

// One file each.
inline constexpr char kBuildDescription[] = "Make pyramids (.isb) of volumes";
inline constexpr char kConvertDescription[] =
    "Write volumes and pyramids in other formats: VDB, NRRD, NIfTI, OME-Zarr, HDF5, ...";
inline constexpr char kViewDescription[] = "Explore a volume in a window";
Command addBuildCommand(CLI::App& app);
Command addConvertCommand(CLI::App& app);
Command addInfoCommand(CLI::App& app);
Command addVerifyCommand(CLI::App& app);
Command addExtractCommand(CLI::App& app);
Command addMergeCommand(CLI::App& app);
Command addRenderCommand(CLI::App& app);
Command addViewCommand(CLI::App& app);
Command addServeCommand(CLI::App& app);
Command addPhantomCommand(CLI::App& app);
Command addBenchCommand(CLI::App& app);
Command addCacheCommand(CLI::App& app);
Command addFormatsCommand(CLI::App& app);
Command addVolumeFormatsCommand(CLI::App& app);
Command addBenchRowCommand(CLI::App& app);

}  // namespace isobrick
