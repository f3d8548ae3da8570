// A request to stop that long work looks at.
#pragma once

#include <atomic>

#include "isobrick/storage/error.h"

namespace isobrick {

// Set by one thread (or a signal handler: the flag is lock-free), looked at by the workers between
// pieces of work of at most some milliseconds.
class CancelFlag {
 public:
  // Asks for a stop; for good.
  void request() noexcept { requested_.store(true, std::memory_order_relaxed); }
  // Whether a stop was asked for.
  bool requested() const noexcept { return requested_.load(std::memory_order_relaxed); }
  // Throws Cancelled once a stop was requested.
  void check() const {
    if (requested()) throw Cancelled();
  }

 private:
  std::atomic<bool> requested_{false};
};

}  // namespace isobrick
