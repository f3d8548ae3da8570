// A command gives advice that it can follow: every remedy and every text against the options of the
// command.
#include "tools/failure_text.h"

#include <fstream>
#include <map>
#include <regex>
#include <sstream>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

const char* const kCommands[] = {"build",   "convert", "view", "extract", "render",
                                 "phantom", "bench",   "info", "verify",  "cache"};

class FailureTextTest : public CommandTest {
 protected:
  // As --help lists them, and those for programs that messages name.
  const std::set<std::string>& optionsOfCommand(const std::string& command) {
    std::set<std::string>& options = options_[command];
    if (options.empty()) {
      if (command == "build") options = {"--progress-lines", "--preview-folder"};  // for programs
      std::istringstream lines(runWell({command, "--help"}));
      for (std::string line; std::getline(lines, line);) {
        const std::size_t word = line.find_first_not_of(' ');
        if (word == std::string::npos || line[word] != '-') continue;
        // "-o,--output OUT ..." and no more: the description may name others.
        for (const std::string& option :
             optionsNamedIn(line.substr(word, line.find(' ', word) - word)))
          options.insert(option);
      }
    }
    return options;
  }
  // Those of `text`, which a command prints; it may speak of another command, and of what that
  // takes.
  void expectKnown(const std::string& text, const std::string& command, const std::string& where) {
    const std::regex other("isobrick (build|convert|view|render)|extract (--|needs)|use --iso");
    std::smatch named;
    std::string further = command;
    if (std::regex_search(text, named, other))
      further = named[1].matched ? named[1].str() : "extract";
    for (const std::string& option : optionsNamedIn(text))
      EXPECT_TRUE(optionsOfCommand(command).contains(option) ||
                  optionsOfCommand(further).contains(option))
          << where << ": '" << text << "' names " << option << ", which '" << command
          << "' has not";
  }

  std::map<std::string, std::set<std::string>> options_;
};

TEST_F(FailureTextTest, OptionsInATextAreFound) {
  EXPECT_EQ(optionsNamedIn("give --raw-dims X,Y,Z, or choose non-zero ones -- with -o."),
            (std::vector<std::string>{"--raw-dims", "-o"}));
  EXPECT_TRUE(optionsNamedIn("-1e300 to -1, a-o").empty());
}

TEST_F(FailureTextTest, EveryRemedyNamesOnlyOptionsThatTheCommandHas) {
  for (const std::string command : kCommands) {
    const std::set<std::string>& options = optionsOfCommand(command);
    ASSERT_GT(options.size(), 1u) << command;
    const HasOption has = [&](const std::string& option) { return options.contains(option); };
    for (int remedy = 0; remedy <= static_cast<int>(Remedy::kChooseSeries); ++remedy) {
      const std::string advice = adviceOf(static_cast<Remedy>(remedy), has);
      EXPECT_NE(advice, "");
      EXPECT_NE(advice, "see the documentation") << remedy;
      expectKnown(advice, command, "remedy " + std::to_string(remedy));
    }
  }
  const auto none = [](const std::string&) { return false; };
  EXPECT_EQ(failureText(Error("it is full", {}, {Remedy::kResume}), none), "it is full; delete it");
}

// The literals of a file that belongs to some commands, against each of them.
TEST_F(FailureTextTest, TheTextsOfTheCommandsNameTheirOwnOptions) {
  const std::vector<std::string> of_queries{"extract", "render", "bench"};
  const std::map<std::string, std::vector<std::string>> commands_of{
      {"volume_input.cpp", {"extract", "render", "view", "bench", "info"}},
      {"cache_command.cpp", {"cache"}},
      {"pyramid_cache.cpp", {"cache"}},
      {"view_command.cpp", {"view"}},
      {"build_command.cpp", {"build"}},
      {"build_one.cpp", {"build"}},
      {"build_batch.cpp", {"build"}},
      {"build_report.cpp", {"build"}},
      {"open_input.cpp", {"build", "convert"}},
      {"convert_command.cpp", {"convert"}},
      {"extract_command.cpp", {"extract"}},
      {"render_command.cpp", {"render"}},
      {"picture_output.cpp", {"render"}},
      {"phantom_command.cpp", {"phantom"}},
      {"bench_command.cpp", {"bench"}},
      {"query_options.cpp", of_queries},
      {"choice_options.cpp", of_queries},
      {"outputs.cpp", {"build", "convert", "extract", "render", "phantom", "view"}}};
  const fs::path tools = fs::path(goldenFolder()).parent_path().parent_path() / "tools";
  std::size_t looked_at = 0;
  for (const auto& entry : fs::recursive_directory_iterator(tools)) {
    const auto found = commands_of.find(entry.path().filename().string());
    if (found == commands_of.end()) continue;
    ++looked_at;
    std::string source = readBytes(entry.path().string());
    // Literals that follow each other are one.
    source = std::regex_replace(source, std::regex("\"\\s*\\+?\\s*\""), "");
    // One that is nothing but an option is that of a parser, or a word for another program.
    const std::regex literal("\"([^\"\\n]* [^\"\\n]*)\"");
    for (std::sregex_iterator it(source.begin(), source.end(), literal), end; it != end; ++it)
      for (const std::string& command : found->second)
        expectKnown((*it)[1].str(), command, entry.path().filename().string());
  }
  EXPECT_EQ(looked_at, commands_of.size());
}

}  // namespace
}  // namespace isobrick::test
