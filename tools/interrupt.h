// Ctrl-C: the first stops the work tidily, the second at once.
#pragma once

#include "isobrick/storage/error.h"

namespace isobrick {

// Set by SIGINT and SIGTERM once installInterruptHandler() was called.
CancelFlag& interruptFlag();

// After the first signal both have their default action again. A signal that was ignored when the
// program started (nohup, jobs in the background) stays ignored.
void installInterruptHandler();

}  // namespace isobrick
