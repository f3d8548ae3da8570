// Every call of a kind fails once, in processes of their own: what ends otherwise than it should is
// found with its number, a crash and a hang among it.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tests/faults/fault_points.h"

namespace isobrick::test {

// The code that meets a fault. It is made, and asked afterwards, without one.
class FaultSubject {
 public:
  virtual ~FaultSubject() = default;
  // Throws what there is to say of the fault; nothing if the fault hit what is only a help.
  virtual void attempt() = 0;
  // The same again, on the same objects: what is wrong with it, or "".
  virtual std::string afterwards() = 0;
};

// The numbers of the calls, 1 .. count, that fail in turn: if they are more than `most`, the first
// and as many all over the others, always the same; fewer under a sanitizer by day.
std::vector<std::uint64_t> faultNumbers(std::uint64_t count, std::uint64_t most);

// Makes subjects in child processes, one for each fault of each kind, and fails the test for each
// that crashes, hangs, says something that is no line of text, is no good afterwards, or leaks. The
// process that calls has started no thread. Prints the counts.
void sweepFaults(const std::string& name,
                 const std::function<std::unique_ptr<FaultSubject>()>& make);

}  // namespace isobrick::test
