// Options of a command line whose values go through the strict parsers of parse_text.h.
#pragma once

#include <CLI/CLI.hpp>
#include <stdexcept>
#include <string>

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

}  // namespace isobrick
