// The hidden subcommand `pages`: man pages, and completions for bash, zsh and fish, from the
// commands' own definitions.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/own_folder.h"
#include "tools/program_run.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

std::string textOf(const Json& json, const char* key) { return json[key].get<std::string>(); }

// All commands; those of other executables by the executables' own definitions, with the options.
Json allDefinitions(const CLI::App& app) {
  Json all = definitionsOf(app);
  for (const char* const executable : {"isobrick-build", "isobrick-view"}) {
    const auto path = findOwnExecutable(executable);
    if (!path) continue;
    const Json other =
        Json::parse(runProgram({{*path, "definitions"}, {}}, &interruptFlag()), nullptr, false);
    if (!other.is_object())
      throw Error(fmt::format("'{}' does not define its commands; install isobrick again", *path));
    for (const Json& command : other["commands"])
      for (Json& own : all["commands"])
        if (own["name"] == command["name"]) own = command;
  }
  return all;
}

std::string replaced(std::string text, std::string_view what, std::string_view by) {
  for (std::size_t at = text.find(what); at != std::string::npos;
       at = text.find(what, at + by.size()))
    text.replace(at, what.size(), by);
  return text;
}

// ---- man pages

std::string roff(std::string text) {
  text = replaced(replaced(std::move(text), "\\", "\\e"), "-", "\\-");
  text = replaced(replaced(std::move(text), "\n.", "\n\\&."), "\n'", "\n\\&'");
  return text.starts_with('.') || text.starts_with('\'') ? "\\&" + text : text;
}

std::string roffHead(const std::string& name, const std::string& description) {
  return fmt::format(".TH {} 1 \"\" \"isobrick {}\" \"isobrick\"\n.SH NAME\n{} \\- {}\n",
                     roff(name), ISOBRICK_VERSION, roff(name), roff(description));
}

std::string roffFooter(const std::string& footer) {
  if (footer.empty()) return {};
  const std::size_t begin = footer.find_first_not_of('\n');
  return fmt::format(".SH NOTES\n.nf\n{}\n.fi\n", roff(footer.substr(begin)));
}

std::string roffOption(const Json& option) {
  std::string names = roff(textOf(option, "positional"));
  for (const Json& name : option["names"])
    names += fmt::format("{}\\fB{}\\fR", names.empty() ? "" : ", ", roff(name.get<std::string>()));
  const std::string value = textOf(option, "value");
  if (!value.empty()) names += fmt::format(" \\fI{}\\fR", roff(value));
  return fmt::format(".TP\n{}\n{}\n", names, roff(textOf(option, "description")));
}

std::string manPageOf(const Json& command) {
  const std::string name = textOf(command, "name");
  std::string positionals;
  std::vector<std::string> groups;
  std::map<std::string, std::string> options;
  for (const Json& option : command["options"]) {
    const std::string positional = textOf(option, "positional");
    if (!positional.empty()) positionals += " \\fI" + roff(positional) + "\\fR";
    const std::string group = positional.empty() ? textOf(option, "group") : "Arguments";
    if (!options.contains(group)) groups.push_back(group);
    options[group] += roffOption(option);
  }
  std::string page = roffHead("isobrick-" + name, textOf(command, "description"));
  page += fmt::format(".SH SYNOPSIS\n\\fBisobrick {}\\fR [\\fIOPTIONS\\fR]{}\n.SH OPTIONS\n",
                      roff(name), positionals);
  for (const std::string& group : groups) page += ".SS " + group + "\n" + options[group];
  return page + roffFooter(textOf(command, "footer")) + ".SH SEE ALSO\n.BR isobrick (1)\n";
}

std::string mainManPage(const Json& all) {
  std::string page = roffHead("isobrick", textOf(all, "description"));
  page +=
      ".SH SYNOPSIS\n\\fBisobrick\\fR \\fISUBCOMMAND\\fR [\\fIOPTIONS\\fR]\n.br\n\\fBisobrick\\fR "
      "\\fIFILE\\fR\n.SH SUBCOMMANDS\n";
  for (const Json& command : all["commands"])
    page += fmt::format(".TP\n.BR isobrick\\-{} (1)\n{}\n", roff(textOf(command, "name")),
                        roff(textOf(command, "description")));
  return page + roffFooter(textOf(all, "footer"));
}

// ---- completions

void appendWord(std::string& words, const std::string& word) {
  if (!words.empty()) words += ' ';
  words += word;
}

std::string namesOf(const Json& options) {
  std::string names;
  for (const Json& option : options)
    for (const Json& name : option["names"]) appendWord(names, name.get<std::string>());
  return names;
}

std::string choicesText(const Json& option) {
  std::string text;
  for (const Json& choice : option["choices"]) appendWord(text, choice.get<std::string>());
  return text;
}

// As much of a description as fits beside a name, without characters that shells interpret.
std::string shortText(const std::string& description) {
  std::string text = description.substr(
      0, std::min({description.find(". "), description.find(';'), description.find(':')}));
  for (char& c : text)
    if (std::string_view("'\"`[]\\$").find(c) != std::string_view::npos) c = ' ';
  return text;
}

std::string bashCompletion(const Json& all) {
  std::string commands, choices, options;
  for (const Json& command : all["commands"]) {
    const std::string name = textOf(command, "name");
    appendWord(commands, name);
    options += fmt::format("    {}) words='{}' ;;\n", name, namesOf(command["options"]));
    for (const Json& option : command["options"])
      if (!option["choices"].empty())
        for (const Json& flag : option["names"])
          choices += fmt::format("    '{} {}') words='{}' ;;\n", name, flag.get<std::string>(),
                                 choicesText(option));
  }
  return fmt::format(R"(# bash completion for isobrick
_isobrick() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD-1]}} words=''
  COMPREPLY=()
  if ((COMP_CWORD == 1)); then
    mapfile -t COMPREPLY < <(compgen -W '{} --help --version' -- "$current"; compgen -f -- "$current")
    return
  fi
  case "${{COMP_WORDS[1]}} $previous" in
{}  esac
  if [[ -z $words && $current == -* ]]; then
    case "${{COMP_WORDS[1]}}" in
{}    esac
  fi
  if [[ -n $words ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
  else
    mapfile -t COMPREPLY < <(compgen -f -- "$current")
    compopt -o filenames 2> /dev/null
  fi
}}
complete -F _isobrick isobrick
)",
                     commands, choices, options);
}

std::string zshCompletion(const Json& all) {
  std::string commands, cases;
  for (const Json& command : all["commands"]) {
    const std::string name = textOf(command, "name");
    commands += fmt::format("    '{}:{}'\n", name, shortText(textOf(command, "description")));
    cases += fmt::format("    {})\n      _arguments", name);
    for (const Json& option : command["options"])
      for (const Json& flag : option["names"]) {
        const std::string value = textOf(option, "value");
        const std::string choices = choicesText(option);
        cases += fmt::format(
            " \\\n        '{}[{}]{}'", flag.get<std::string>(),
            shortText(textOf(option, "description")),
            value.empty() ? ""
                          : fmt::format(": :{}", choices.empty() ? "_files" : "(" + choices + ")"));
      }
    cases += " \\\n        '*: :_files' ;;\n";
  }
  return fmt::format(R"(#compdef isobrick
_isobrick() {{
  local -a commands
  commands=(
{}  )
  if ((CURRENT == 2)); then
    _describe command commands
    _files
    return
  fi
  local command=$words[2]
  shift words
  ((CURRENT--))
  case $command in
{}  esac
}}
_isobrick "$@"
)",
                     commands, cases);
}

std::string fishCompletion(const Json& all) {
  std::string text = "# fish completion for isobrick\n";
  for (const Json& command : all["commands"]) {
    const std::string name = textOf(command, "name");
    text += fmt::format("complete -c isobrick -n __fish_use_subcommand -a {} -d '{}'\n", name,
                        shortText(textOf(command, "description")));
    for (const Json& option : command["options"]) {
      if (option["names"].empty()) continue;
      text += fmt::format("complete -c isobrick -n '__fish_seen_subcommand_from {}'", name);
      for (const Json& flag : option["names"]) {
        const std::string word = flag.get<std::string>();
        text += word.starts_with("--") ? " -l " + word.substr(2) : " -s " + word.substr(1);
      }
      const std::string choices = choicesText(option);
      if (!choices.empty())
        text += fmt::format(" -x -a '{}'", choices);
      else if (!textOf(option, "value").empty())
        text += " -r";
      text += fmt::format(" -d '{}'\n", shortText(textOf(option, "description")));
    }
  }
  return text;
}

void writeText(const fs::path& path, const std::string& text) {
  if (const std::error_code failure = makeFolders(path.parent_path()))
    failWriting(path.string(), failure.value());
  AtomicFile file(path.string());
  file.write(text.data(), text.size());
  file.commit();
}

int writePages(const CLI::App& app, const std::string& folder) {
  const Json all = allDefinitions(app);
  const fs::path root(folder);
  writeText(root / "man1/isobrick.1", mainManPage(all));
  for (const Json& command : all["commands"])
    writeText(root / ("man1/isobrick-" + textOf(command, "name") + ".1"), manPageOf(command));
  writeText(root / "bash/isobrick", bashCompletion(all));
  writeText(root / "zsh/_isobrick", zshCompletion(all));
  writeText(root / "fish/isobrick.fish", fishCompletion(all));
  return 0;
}

}  // namespace

Command addPagesCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("pages", "Write man pages and completions into a folder");
  sub->group("");  // for the build of isobrick
  const auto folder = std::make_shared<std::string>();
  sub->add_option("DIR", *folder, "Folder")->required();
  const CLI::App* const parser = &app;
  return {sub, [parser, folder] { return writePages(*parser, *folder); }};
}

}  // namespace isobrick
