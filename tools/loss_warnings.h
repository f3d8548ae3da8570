// Facts that an output does not keep: no failure, but users hear of them.
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "tools/line_words.h"

namespace isobrick {

// A line each on stderr.
inline void warnOfLosses(const std::string& output, const std::vector<std::string>& losses) {
  for (const std::string& loss : losses)
    fmt::print(stderr, "isobrick: warning: '{}': {}\n", oneLine(output), oneLine(loss));
}

}  // namespace isobrick
