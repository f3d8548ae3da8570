// The hidden subcommand `definitions` of each executable: its commands and their options as JSON,
// of which `isobrick pages` makes man pages and completions.
#include <algorithm>

#include "tools/command.h"
#include "tools/json_output.h"

namespace isobrick {
namespace {

// The words of "C:{none,lz4,zstd}" in braces.
Json choicesOf(const std::string& type) {
  Json choices = Json::array();
  const std::size_t begin = type.find('{'), end = type.find('}');
  if (begin == std::string::npos || end == std::string::npos) return choices;
  for (std::size_t at = begin + 1; at < end;) {
    const std::size_t next = std::min(type.find(',', at), end);
    choices.push_back(type.substr(at, next - at));
    at = next + 1;
  }
  return choices;
}

Json jsonOfOption(const CLI::Option& option) {
  Json names = Json::array();
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  const std::string type = option.get_type_name();
  return {{"names", names},
          {"positional", option.get_positional() ? option.get_name() : std::string()},
          {"group", option.get_group()},
          {"value", option.get_items_expected_max() == 0 ? "" : type.substr(0, type.find(':'))},
          {"choices", choicesOf(type)},
          {"required", option.get_required()},
          {"description", option.get_description()}};
}

}  // namespace

Json definitionsOf(const CLI::App& app) {
  Json commands = Json::array();
  for (const CLI::App* const sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (sub->get_group().empty()) continue;
    Json options = Json::array();
    for (const CLI::Option* const option :
         sub->get_options([](const CLI::Option*) { return true; }))
      if (!option->get_group().empty()) options.push_back(jsonOfOption(*option));
    commands.push_back({{"name", sub->get_name()},
                        {"description", sub->get_description()},
                        {"options", options},
                        {"footer", sub->get_footer()}});
  }
  return {
      {"commands", commands}, {"description", app.get_description()}, {"footer", app.get_footer()}};
}

Command addDefinitionsCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("definitions", "The commands and options, as JSON");
  sub->group("");  // not for people
  const CLI::App* const parser = &app;
  return {sub, [parser] {
            printJson(definitionsOf(*parser));
            return 0;
          }};
}

}  // namespace isobrick
