#include "tools/interrupt.h"

#include <csignal>

namespace isobrick {
namespace {

CancelFlag the_flag;

// Makes only calls that are safe in a signal handler: a lock-free store and signal().
extern "C" void onInterrupt(int) {
  the_flag.request();
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  std::signal(SIGHUP, SIG_DFL);
}

}  // namespace

CancelFlag& interruptFlag() { return the_flag; }

void installInterruptHandler() {
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction previous = {};
    sigaction(number, nullptr, &previous);
    if (previous.sa_handler == SIG_IGN) continue;
    struct sigaction action = {};
    action.sa_handler = onInterrupt;
    // Libraries that read files do not expect calls to be cut short.
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    sigaction(number, &action, nullptr);
  }
}

}  // namespace isobrick
