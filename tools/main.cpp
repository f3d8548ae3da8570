// The common part of the executables of the `isobrick` command: words in, exit status out.
#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/source_bricks.h"
#include "tools/command.h"
#include "tools/failure_text.h"
#include "tools/interrupt.h"
#include "tools/own_folder.h"
#include "tools/plain_text.h"
#include "tools/shared_options.h"
#include "tools/user_words.h"

namespace isobrick {
namespace {

enum ExitStatus { kSucceeded = 0, kFailed = 1, kWrongUsage = 2, kInterrupted = 130 };

// CLI11 hides the options of a group without a name, but gives them no name in messages either.
class HelpText : public CLI::Formatter {
 public:
  std::string make_group(std::string group, bool is_positional,
                         std::vector<const CLI::Option*> options) const override {
    return group == kProgramGroup ? std::string()
                                  : CLI::Formatter::make_group(group, is_positional, options);
  }
  // Nor blank lines in its place.
  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override {
    return CLI::detail::find_and_replace(CLI::Formatter::make_help(app, std::move(name), mode),
                                         "\n\n\n\n", "\n\n\n");
  }
};

void describe(CLI::App& app) {
  app.formatter(std::make_shared<HelpText>());
  app.name("isobrick");
  app.set_version_flag("--version", "isobrick " ISOBRICK_VERSION, "Print the version and exit");
  app.set_help_flag("-h,--help", "Print this help and exit");
  app.get_formatter()->column_width(38);
  app.require_subcommand(1);
}

int reportUsage(const CLI::App& app, const std::string& message) {
  std::string command = "isobrick";
  for (const CLI::App* chosen : app.get_subcommands()) command += " " + chosen->get_name();
  fmt::print(stderr, "isobrick: {}; try '{} --help'\n", oneLine(message), command);
  return kWrongUsage;
}

// Of a word that begins with '-' the options of the command, else the commands.
std::string guessFor(const CLI::App& app, const std::string& word) {
  std::vector<std::string> known;
  const std::string name = word.substr(0, word.find('='));
  if (app.get_subcommands().empty())
    for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
      known.push_back(sub->get_name());
  else if (name.starts_with("--"))
    for (const CLI::Option* option : app.get_subcommands().front()->get_options())
      if (option->get_group() != kProgramGroup)
        for (const std::string& one : option->get_lnames()) known.push_back("--" + one);
  return guessOf(name, known);
}

// Of the first word that nothing took.
std::string guessOfRest(const CLI::App& app) {
  const std::vector<std::string> rest = app.remaining(true);
  return rest.empty() ? std::string() : guessFor(app, rest.front());
}

// The exit status if the words themselves end the run (help, version, wrong usage). The words begin
// with the last one, as CLI11 takes them.
std::optional<int> parseArguments(CLI::App& app, const std::vector<std::string>& words) {
  const std::vector<std::string> values = withVariables(words);
  const auto refuse = [&](const std::string& message) {
    return reportUsage(app, withoutValues(message, words, values));
  };
  try {
    app.parse(std::vector(values));
  } catch (const CLI::Success& wish) {
    app.exit(wish);
    return std::fflush(stdout) == 0 ? kSucceeded : kFailed;
  } catch (const CLI::RequiredError& error) {
    // For an unknown subcommand CLI11 only says that one is missing.
    const std::vector<std::string> unknown = app.remaining();
    if (app.get_subcommands().empty() && !unknown.empty())
      return refuse(fmt::format("unknown subcommand or option '{}'{}", unknown.front(),
                                guessFor(app, unknown.front())));
    return refuse(error.what() + guessOfRest(app));
  } catch (const CLI::ParseError& error) {
    return refuse(error.what() + guessOfRest(app));
  }
  return std::nullopt;
}

int runChosen(const std::vector<Command>& commands) {
  const auto chosen = std::find_if(commands.begin(), commands.end(),
                                   [](const Command& c) { return c.parser->parsed(); });
  const int status = chosen->run();
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0)
    throw Error(fmt::format("cannot write to the standard output: {}", std::strerror(errno)));
  return status;
}

// Also for a lack of memory, which may go on during the report.
int reportFailure(const std::exception& failure, const HasOption& has) noexcept try {
  const bool lacks_memory = dynamic_cast<const std::bad_alloc*>(&failure) != nullptr;
  fmt::print(stderr, "isobrick: {}\n",
             lacks_memory ? "not enough memory; close other programs, or ask for less: a coarser "
                            "level or a box"
                          : oneLine(failureText(failure, has)));
  return kFailed;
} catch (const std::exception&) {
  std::fputs("isobrick: not enough memory; close other programs\n", stderr);
  return kFailed;
}

int runReportingFailures(const CLI::App& app, const std::vector<Command>& commands) {
  const HasOption has = optionsOf(*app.get_subcommands().front());
  try {
    return runChosen(commands);
  } catch (const UsageError& error) {
    return reportUsage(app, error.what());
  } catch (const Cancelled& cancelled) {
    reportFailure(cancelled, has);
    return kInterrupted;
  } catch (const std::exception& failure) {
    // A read of a server that was ended by it.
    if (interruptFlag().requested()) {
      reportFailure(Cancelled(), has);
      return kInterrupted;
    }
    return reportFailure(failure, has);
  }
}

bool isSubcommand(const CLI::App& app, const std::string& word) {
  const auto named =
      app.get_subcommands([&](const CLI::App* sub) { return sub->check_name(word); });
  return !named.empty();
}

// `isobrick scan.nrrd` is `isobrick view scan.nrrd`; returns if the word is no file.
void runCommandOfFile(int argc, char** argv) {
  std::optional<std::string> command = commandOfFile(argv[1]);
  if (!command) return;
  std::vector<char*> words(argv, argv + argc + 1);
  words.insert(words.begin() + 1, command->data());
  runExternalCommand(*command, words.data());
}

// Opens level 0 of indexes, by a library that brings ITK, OpenVDB and HDF5. It stays loaded: what
// it opened is used to the end of the process.
const SourceOpener& openerOfPlugin() {
  static const SourceOpener* const opener = [] {
    const std::string path = requireOwn("isobrick-sources.so", R_OK);
    void* const library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    void* const symbol = library != nullptr ? dlsym(library, "isobrickSourceOpener") : nullptr;
    if (symbol == nullptr)
      throw Error(fmt::format("cannot load '{}': {}; install isobrick again", path, dlerror()));
    return reinterpret_cast<const SourceOpener* (*)()>(symbol)();
  }();
  return *opener;
}

int runWords(int given, char** given_words) {
  std::vector<std::string> texts = todaysWords(given, given_words);
  std::vector<char*> words;
  for (std::string& text : texts) words.push_back(text.data());
  words.push_back(nullptr);
  const int argc = static_cast<int>(texts.size());
  char** const argv = words.data();
  noteWords(argv);
  setSourceOpener([](const SourceRequest& request) { return openerOfPlugin()(request); });
  if (argc > 1) runExternalCommand(argv[1], argv);
  CLI::App app("Adaptive, crack-free isosurfaces of volumes that are larger than memory.");
  describe(app);
  const std::vector<Command> commands = addCommands(app);
  if (argc == 1) {
    fmt::print("{}", app.help());
    return std::fflush(stdout) == 0 ? kSucceeded : kFailed;
  }
  if (!isSubcommand(app, argv[1])) runCommandOfFile(argc, argv);
  // Not before: what this process becomes would have them among its words.
  const auto status = parseArguments(app, {texts.rbegin(), texts.rend() - 1});
  if (status) return *status;
  installInterruptHandler();
  const int ended = runReportingFailures(app, commands);
  if (ended == kInterrupted) {
    // A call of a library may still be under way (storage/abandonable.h), which uses objects that
    // destructors of global objects would destroy.
    std::fflush(nullptr);
    std::_Exit(ended);
  }
  return ended;
}

}  // namespace
}  // namespace isobrick

int main(int argc, char** argv) {
  using namespace isobrick;
  // A file that grows past the limit of `ulimit -f` is to be an error, not the end of the process.
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return runWords(argc, argv);
  } catch (const std::exception& failure) {
    return reportFailure(failure, [](const std::string&) { return false; });
  }
}
