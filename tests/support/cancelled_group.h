// Calls of public functions in a TBB task whose group is cancelled.
#pragma once

#include <tbb/task_group.h>

#include <exception>

namespace isobrick::test {

// Calls f in such a task, and rethrows what it throws.
template <typename F>
void runInCancelledGroup(const F& f) {
  tbb::task_group group;
  std::exception_ptr failure;  // which a cancelled group drops
  group.run_and_wait([&] {
    group.cancel();
    try {
      f();
    } catch (...) {
      failure = std::current_exception();
    }
  });
  if (failure) std::rethrow_exception(failure);
}

}  // namespace isobrick::test
