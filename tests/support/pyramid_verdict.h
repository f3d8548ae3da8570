// All that opening and verifying say of a file that may be damaged.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace isobrick::test {

struct Verdict {
  std::string open_error;            // empty: the file opened
  std::vector<std::size_t> damaged;  // rows of the bricks that verifyBrick reports
  std::vector<std::string> rest;     // what verifyRest reports

  bool isGood() const { return open_error.empty() && damaged.empty() && rest.empty(); }
};

// Opens the file and verifies every brick and the rest; the only ways to say no are Error,
// BrickDamage and a line of verifyRest. The form of what they say is expected too.
Verdict judge(const std::string& path);

}  // namespace isobrick::test
