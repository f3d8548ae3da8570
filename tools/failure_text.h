// What the user is told of a failure.
#pragma once

#include <exception>
#include <string>

namespace isobrick {

// The failure's own line, and for an Error the options of this command that would help.
std::string failureText(const std::exception& failure);

}  // namespace isobrick
