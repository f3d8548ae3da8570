// Another program: its words in, its output out.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

struct ProgramCall {
  std::vector<std::string> words;        // the first is the path of the executable
  std::vector<std::string> environment;  // "NAME=value", beside or in place of one's own
  // Called with each whole line of its stderr, as it comes; may be empty.
  std::function<void(std::string_view line)> on_error_line = {};
  // Milliseconds that a cancelled program has to end by itself, after SIGTERM. It is then in a
  // group of its own: Ctrl-C reaches it through its caller alone. 0: it is killed at once.
  int tidy_end_milliseconds = 0;
};

// The program ended with a status other than 0; `said` is the last line of its stderr.
class ProgramFailure : public Error {
 public:
  ProgramFailure(const std::string& what, std::string said_last)
      : Error(what), said(std::move(said_last)) {}
  const std::string said;
};

// Runs the program to its end and returns its stdout. Throws Error if it cannot be started or is
// killed by a signal, ProgramFailure if it ends with another status than 0, and Cancelled, with the
// program gone, after a request of `cancel`. Not for two threads at a time: the pipes of one call
// would stay open in the program of the other.
std::string runProgram(const ProgramCall& call, const CancelFlag* cancel = nullptr);

}  // namespace isobrick
