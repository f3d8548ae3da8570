// The message to the user about a failure.
#pragma once

#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

// Whether the current command has an option, "--memory" or "-o".
using HasOption = std::function<bool(const std::string& option)>;

// The failure's own line, and for an Error the remedies, with options that this command has.
std::string failureText(const std::exception& failure, const HasOption& has);

// The remedy, in the words of a command that has such options; never empty. A text with options of
// another command names that command: 'isobrick build'.
std::string adviceOf(Remedy remedy, const HasOption& has);

// "--raw-dims" and "-o" of "give --raw-dims X,Y,Z, or choose another file with -o".
std::vector<std::string> optionsNamedIn(const std::string& text);

}  // namespace isobrick
