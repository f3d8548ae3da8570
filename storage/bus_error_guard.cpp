#include "isobrick/storage/bus_error_guard.h"

#include <sys/mman.h>
#include <sys/syscall.h>
#include <ucontext.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <csignal>
#include <mutex>
#include <utility>

#include "isobrick/storage/bus_error_guard.h"

namespace isobrick {
namespace {

constexpr std::uint64_t kNothingFailed = ~std::uint64_t{0};

using Notes = std::atomic<std::uint64_t>;  // 64 pages
static_assert(Notes::is_always_lock_free && sizeof(Notes) == 8);
constexpr std::uint64_t kPagesPerNote = 64;

struct GuardedRange {
  RangeSlot range;
  std::atomic<std::uint64_t> failed_offset{kNothingFailed};
  // A bit for each page that could not be read. Changes only while the range is none.
  Notes* failed_pages = nullptr;
};

// The process's own action for SIGBUS, which an entry of ours replaced.
struct EarlierAction {
  struct sigaction action;
  std::atomic<bool> is_spent{false};  // SA_RESETHAND: it had its one call
};

GuardedRange g_ranges[BusErrorGuard::kMostRanges];
std::mutex g_ranges_mutex;  // for taking and leaving slots; the handler needs none

// Each is written once, before the entry that leads to it is installed.
EarlierAction g_earlier[BusErrorGuard::kMostHandlers];
std::atomic<std::size_t> g_earlier_count{0};
std::mutex g_earlier_mutex;  // for adding one and installing

std::uintptr_t pageBytes() {
  static const auto bytes = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  return bytes;
}
std::atomic<std::uintptr_t> g_page_bytes{0};  // for the handler

std::uint64_t bytesOfNotes(std::uint64_t range_bytes) {
  return ((range_bytes - 1) / pageBytes() / kPagesPerNote + 1) * sizeof(Notes);
}

// ---- only async-signal-safe calls from here ----

// A signal that the kernel sends because an instruction cannot go on. It can neither be ignored nor
// blocked.
bool isFault(const siginfo_t& info) { return info.si_code > 0 && info.si_code != BUS_MCEERR_AO; }

// True if the address is in a guarded range, and now a page of zeros lies there.
bool mendGuardedPage(std::uintptr_t address) {
  const std::uintptr_t page_bytes = g_page_bytes.load();
  for (GuardedRange& guarded : g_ranges) {
    const std::optional<RangeSlot::Range> range = guarded.range.read();
    // A mapping ends with its last page, and another may begin right there.
    if (!range || address < range->begin ||
        (address - range->begin) / page_bytes > (range->size - 1) / page_bytes)
      continue;
    const std::uintptr_t page = address / page_bytes * page_bytes;
    if (mmap(reinterpret_cast<void*>(page), page_bytes, PROT_READ,
             MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0) == MAP_FAILED)
      return false;
    const std::uint64_t offset = page - range->begin;
    const std::uint64_t number = offset / page_bytes;
    guarded.failed_pages[number / kPagesPerNote].fetch_or(std::uint64_t{1}
                                                          << number % kPagesPerNote);
    // Last: a thread that reads this sees the note too.
    std::uint64_t nothing = kNothingFailed;
    guarded.failed_offset.compare_exchange_strong(nothing, offset);
    return true;
  }
  return false;
}

// The same signal once more, for the default action: its facts of the fault show in the core.
void dieAsWithoutUs(int signal, siginfo_t* info) {
  struct sigaction action = {};
  action.sa_handler = SIG_DFL;
  sigaction(signal, &action, nullptr);
  syscall(SYS_rt_tgsigqueueinfo, getpid(), syscall(SYS_gettid), signal, info);
}

void callHandler(const struct sigaction& action, int signal, siginfo_t* info, void* context) {
  sigset_t before, own;
  pthread_sigmask(SIG_BLOCK, &action.sa_mask, &before);
  const bool was_blocked = sigismember(&static_cast<ucontext_t*>(context)->uc_sigmask, signal) == 1;
  if ((action.sa_flags & SA_NODEFER) != 0 && !was_blocked &&
      sigismember(&action.sa_mask, signal) == 0) {
    sigemptyset(&own);
    sigaddset(&own, signal);
    pthread_sigmask(SIG_UNBLOCK, &own, nullptr);
  }
  if ((action.sa_flags & SA_SIGINFO) != 0)
    action.sa_sigaction(signal, info, context);
  else
    action.sa_handler(signal);
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

void passOn(EarlierAction& earlier, int signal, siginfo_t* info, void* context) {
  const struct sigaction& action = earlier.action;
  const bool is_handler = (action.sa_flags & SA_SIGINFO) != 0 ||
                          (action.sa_handler != SIG_DFL && action.sa_handler != SIG_IGN);
  if (!is_handler) {
    if (action.sa_handler == SIG_DFL || isFault(*info)) dieAsWithoutUs(signal, info);
    return;
  }
  if ((action.sa_flags & SA_RESETHAND) != 0 && earlier.is_spent.exchange(true)) {
    dieAsWithoutUs(signal, info);
    return;
  }
  callHandler(action, signal, info, context);
}

// The handler, as often as there are actions to pass signals on to. A handler that came after entry
// k has found that entry, and we put another one in front of it: when it calls or restores what it
// found, entry k passes the signal on to the action below it, and there is no loop.
template <std::size_t kEntry>
void onBusError(int signal, siginfo_t* info, void* context) {
  const int saved_errno = errno;
  const bool is_mended =
      info->si_code > 0 && mendGuardedPage(reinterpret_cast<std::uintptr_t>(info->si_addr));
  // The count was raised before this entry was installed; reading it makes the entry visible.
  if (!is_mended && kEntry < g_earlier_count.load())
    passOn(g_earlier[kEntry], signal, info, context);
  errno = saved_errno;
}

// ---- to here ----

using Entry = void (*)(int, siginfo_t*, void*);
constexpr auto kEntries = []<std::size_t... kIndex>(std::index_sequence<kIndex...>) {
  return std::array<Entry, sizeof...(kIndex)>{onBusError<kIndex>...};
}
(std::make_index_sequence<BusErrorGuard::kMostHandlers>());

bool isOurs(const struct sigaction& action) {
  if ((action.sa_flags & SA_SIGINFO) == 0) return false;
  for (const Entry entry : kEntries)
    if (action.sa_sigaction == entry) return true;
  return false;
}

// Signal by signal, as the system fills in only a part of the mask.
bool isSameMask(const sigset_t& a, const sigset_t& b) {
  for (int signal = 1; signal < NSIG; ++signal)
    if (sigismember(&a, signal) != sigismember(&b, signal)) return false;
  return true;
}

bool isSame(const struct sigaction& a, const struct sigaction& b) {
  return a.sa_sigaction == b.sa_sigaction && a.sa_flags == b.sa_flags &&
         isSameMask(a.sa_mask, b.sa_mask);
}

// The entry that passes on to `action`; kMostHandlers if there is none left. The same one again for
// an action that was here before: it went away and came back. (A handler that installs itself over
// itself makes a loop without us, too.)
std::size_t entryFor(const struct sigaction& action) {
  const std::size_t count = g_earlier_count.load();
  std::size_t entry = 0;
  while (entry < count && !isSame(g_earlier[entry].action, action)) ++entry;
  if (entry == BusErrorGuard::kMostHandlers) return entry;
  if (entry == count) {
    g_earlier[entry].action = action;
    g_earlier_count.store(count + 1);
  }
  g_earlier[entry].is_spent.store(false);
  return entry;
}

}  // namespace

void BusErrorGuard::keepInFront() noexcept {
  struct sigaction found = {};
  if (sigaction(SIGBUS, nullptr, &found) != 0 || isOurs(found)) return;
  const std::lock_guard lock(g_earlier_mutex);
  g_page_bytes.store(pageBytes());
  sigaction(SIGBUS, nullptr, &found);
  // Again if another one came between the two calls.
  while (!isOurs(found)) {
    const std::size_t entry = entryFor(found);
    if (entry == kMostHandlers) return;
    struct sigaction ours = {}, replaced = {};
    ours.sa_sigaction = kEntries[entry];
    // On the alternate stack, as the thread's own may be the memory that cannot be read.
    ours.sa_flags = SA_SIGINFO | SA_ONSTACK | (found.sa_flags & SA_RESTART);
    sigemptyset(&ours.sa_mask);
    sigaction(SIGBUS, &ours, &replaced);
    if (isSame(replaced, found)) return;
    found = replaced;
  }
}

bool BusErrorGuard::guard(const void* begin, std::uint64_t size) {
  leave();
  keepInFront();
  const std::lock_guard lock(g_ranges_mutex);
  std::size_t slot = 0;
  while (slot < kMostRanges && g_ranges[slot].range.read()) ++slot;
  if (slot == kMostRanges) return false;
  void* const notes = mmap(nullptr, bytesOfNotes(size), PROT_READ | PROT_WRITE,
                           MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (notes == MAP_FAILED) return false;
  g_ranges[slot].failed_pages = static_cast<Notes*>(notes);
  g_ranges[slot].failed_offset.store(kNothingFailed);
  g_ranges[slot].range.set({reinterpret_cast<std::uintptr_t>(begin), size});
  slot_ = slot;
  return true;
}

void BusErrorGuard::leave() noexcept {
  if (slot_ == kNone) return;
  const std::lock_guard lock(g_ranges_mutex);
  GuardedRange& guarded = g_ranges[slot_];
  const std::uint64_t size = guarded.range.read().value_or(RangeSlot::Range{}).size;
  guarded.range.set({});
  munmap(guarded.failed_pages, bytesOfNotes(size));
  slot_ = kNone;
}

std::optional<std::uint64_t> BusErrorGuard::failedOffset() const noexcept {
  if (slot_ == kNone) return std::nullopt;
  const std::uint64_t offset = g_ranges[slot_].failed_offset.load();
  if (offset == kNothingFailed) return std::nullopt;
  return offset;
}

std::optional<std::uint64_t> BusErrorGuard::failedOffset(std::uint64_t offset,
                                                         std::uint64_t bytes) const noexcept {
  if (!failedOffset()) return std::nullopt;
  const std::uint64_t end = (offset + bytes - 1) / pageBytes() + 1;
  for (std::uint64_t page = offset / pageBytes(); page < end;) {
    const std::uint64_t notes =
        g_ranges[slot_].failed_pages[page / kPagesPerNote].load() >> page % kPagesPerNote;
    if (notes == 0) {
      page = (page / kPagesPerNote + 1) * kPagesPerNote;
      continue;
    }
    page += static_cast<std::uint64_t>(std::countr_zero(notes));
    if (page < end) return page * pageBytes();
  }
  return std::nullopt;
}

}  // namespace isobrick
