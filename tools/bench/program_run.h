// Another program: its words in, what it printed out.
#pragma once

#include <string>
#include <vector>

#include "isobrick/storage/cancel.h"

namespace isobrick {

struct ProgramCall {
  std::vector<std::string> words;        // the first is the path of the executable
  std::vector<std::string> environment;  // "NAME=value", beside or in place of one's own
};

// Runs the program to its end and returns what it wrote to its stdout. Throws Error where it cannot
// be started, leaves with another status than 0 (with the last line of its stderr), or is killed by
// a signal; Cancelled, with the program gone, once `cancel` asks for it. Not for two threads at a
// time: the pipes of one call would stay open in the program of the other.
std::string runProgram(const ProgramCall& call, const CancelFlag* cancel = nullptr);

}  // namespace isobrick
