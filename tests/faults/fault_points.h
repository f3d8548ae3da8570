// Calls to the system that fail when a test wants them to: the n-th from a moment on, once or for
// good.
//
// Linked into an executable, whose own code it leads here: the linker's --wrap names the calls
// (tests/CMakeLists.txt), operator new is replaced, and so is pthread_create(), which std::thread
// calls in the C++ library. Libraries that are loaded have their own memory, files and threads and
// are let be: an allocation that fails in TBB's scheduler or in a driver ends the process inside
// functions of theirs that may not throw, and nothing of ours can help that; so does one in the
// destructor of nlohmann's JSON, which is let be too. The C++ library counts as our own where we
// are its only user (`strings_too`).
#pragma once

#include <cstddef>
#include <cstdint>

namespace isobrick::test {

// Writes are also what changes names and what waits for the disk; those and sockets are wrapped in
// commands alone (isobrick_with_faults.cpp).
enum class FaultKind { kAllocation, kRead, kOpen, kMap, kThread, kWrite, kSocket };
inline constexpr FaultKind kFaultKinds[] = {
    FaultKind::kAllocation, FaultKind::kRead,  FaultKind::kOpen,  FaultKind::kMap,
    FaultKind::kThread,     FaultKind::kWrite, FaultKind::kSocket};
// "alloc", "read", "open", "map", "thread", "write", "socket"
const char* nameOf(FaultKind kind);

// From here on all calls are counted, and the n-th of the kind fails (`for_good`: and all after
// it): bad_alloc or nullptr, EIO, EMFILE, ENOMEM, EAGAIN, EIO, and EMFILE or ECONNRESET. 0: none.
struct FaultScope {
  bool strings_too = true;  // calls of the C++ library, too
  bool for_good = false;
};
void armFault(FaultKind kind, std::uint64_t n, FaultScope scope = {});
// Counts a call, and sets errno to `error` if it is one to fail.
bool failsWith(FaultKind kind, int error);
void disarmFaults();
// Since the last armFault().
std::uint64_t countedCalls(FaultKind kind);
bool hasFaultHappened();

// The n-th allocation of at least `bytes` fails, and all after it that are at least as large.
void armLargeAllocations(std::uint64_t n, std::size_t bytes);

// Allocations by operator new that were not given back, of the whole process.
std::int64_t liveAllocations();

}  // namespace isobrick::test
