// Options of a command line whose values go through the strict parsers of parse_text.h.
#pragma once

#include <CLI/CLI.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace isobrick {

// Adds an option that sets `target` to `parse(text)`. `target` lives as long as the parser; its
// type is that of the result or an optional of it. CLI11's own conversions depend on the locale and
// take "nan".
template <typename Target, typename Parse>
CLI::Option* addParsedOption(CLI::App& app, const std::string& names, Target& target, Parse parse,
                             const std::string& value_name, const std::string& description) {
  const auto set = [&target, parse, names](const std::string& text) {
    try {
      target = static_cast<Target>(parse(text));
    } catch (const std::invalid_argument& failure) {
      throw CLI::ValidationError(names, failure.what());
    }
  };
  return app.add_option_function<std::string>(names, set, description)->type_name(value_name);
}

// Adds an option that may be given again: calls `take(word)` for each of its words.
template <typename Take>
CLI::Option* addRepeatedOption(CLI::App& app, const std::string& name, Take take,
                               const std::string& value_name, const std::string& description) {
  const auto take_all = [take, name](const std::vector<std::string>& words) {
    try {
      for (const std::string& word : words) take(word);
    } catch (const std::invalid_argument& failure) {
      throw CLI::ValidationError(name, failure.what());
    }
  };
  return app.add_option_function<std::vector<std::string>>(name, take_all, description)
      ->type_name(value_name)
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

// The values of an option, in the order of --help.
template <typename T>
using Choices = std::vector<std::pair<std::string, T>>;

// Adds an option that sets `target` to the value of one of the choices.
template <typename T>
CLI::Option* addChoiceOption(CLI::App& app, const std::string& name, T& target,
                             const Choices<T>& choices, const std::string& value_name,
                             const std::string& description) {
  const auto set = [&target, choices](const std::string& text) {
    for (const auto& [word, value] : choices)
      if (word == text) target = value;
  };
  return app.add_option_function<std::string>(name, set, description)
      ->type_name(value_name)
      ->check(CLI::IsMember(choices));
}

}  // namespace isobrick
