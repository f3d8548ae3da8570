// SIGBUS: pages of ours that cannot be read become zeros and a note, and whatever else there is of
// that signal goes to whom it belongs. A test that may die does so in a child.

#include "isobrick/storage/bus_error_guard.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <csetjmp>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/storage/bus_error_guard.h"
#include "isobrick/storage/paged_file.h"
#include "tests/support/child_process.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr std::size_t kPageBytes = 4096;

void touch(const void* address) { (void)*static_cast<const volatile unsigned char*>(address); }

// Calls of handlers; in memory that a child shares with its parent.
struct Seen {
  volatile std::sig_atomic_t calls = 0, signal = 0, code = 0, usr1_blocked = 0, bus_blocked = 0;
  const void* volatile address = nullptr;
};

Seen& seen() {
  static void* const memory =
      mmap(nullptr, sizeof(Seen), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  return *static_cast<Seen*>(memory);
}

class BusErrorGuardTest : public testing::Test {
 protected:
  // Before anything is forked: children and their parent share it.
  void SetUp() override { seen() = Seen(); }
  std::string makeFile(const std::string& name, std::size_t bytes) const {
    std::ofstream(folder_.file(name), std::ios::binary) << std::string(bytes, 'x');
    return folder_.file(name);
  }
  static void cut(const std::string& path, std::size_t bytes = 0) {
    std::filesystem::resize_file(path, bytes);
  }
  // A page that faults and is not ours.
  unsigned char* makeForeignPage(const std::string& name = "foreign") const {
    const std::string path = makeFile(name, kPageBytes);
    const int fd = open(path.c_str(), O_RDWR | O_CLOEXEC);
    void* const page = mmap(nullptr, kPageBytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    close(fd);
    cut(path);
    if (page == MAP_FAILED) throw std::runtime_error("cannot map a page");
    return static_cast<unsigned char*>(page);
  }
  // True if a file of ours that was cut ends in a note rather than in a signal for somebody
  // else.
  bool isGuarded(const std::string& name = "ours") const {
    const std::string path = makeFile(name, 3 * kPageBytes);
    const PagedFile file(path);
    cut(path);
    touch(file.data() + kPageBytes + 7);
    return file.failedOffset() == kPageBytes;
  }

  TemporaryFolder folder_;
};

struct sigaction g_previous;  // of the handlers that know it
sigjmp_buf g_way_out;

void noteCall(int signal, const siginfo_t* info) {
  sigset_t blocked;
  pthread_sigmask(SIG_SETMASK, nullptr, &blocked);
  seen().calls = seen().calls + 1;
  seen().signal = signal;
  seen().usr1_blocked = sigismember(&blocked, SIGUSR1);
  seen().bus_blocked = sigismember(&blocked, SIGBUS);
  if (info == nullptr) return;
  seen().code = info->si_code;
  seen().address = info->si_addr;
}

// Puts a page there, so that the instruction goes on.
void mendPage(const void* address) {
  const auto page = reinterpret_cast<std::uintptr_t>(address) / kPageBytes * kPageBytes;
  mmap(reinterpret_cast<void*>(page), kPageBytes, PROT_READ | PROT_WRITE,
       MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0);
}

void onSignalMending(int signal, siginfo_t* info, void*) {
  noteCall(signal, info);
  mendPage(info->si_addr);
}
// Handlers without siginfo must know the place from elsewhere.
unsigned char* g_page_to_mend;
void onSignalWithoutInfo(int signal) {
  noteCall(signal, nullptr);
  mendPage(g_page_to_mend);
}
void onSignalJumping(int signal, siginfo_t* info, void*) {
  noteCall(signal, info);
  siglongjmp(g_way_out, 1);
}
void onSignalCallingPrevious(int signal, siginfo_t* info, void* context) {
  noteCall(signal, info);
  if ((g_previous.sa_flags & SA_SIGINFO) != 0)
    g_previous.sa_sigaction(signal, info, context);
  else if (g_previous.sa_handler != SIG_DFL && g_previous.sa_handler != SIG_IGN)
    g_previous.sa_handler(signal);
}
// The instruction is to fault again.
void onSignalRestoringPrevious(int signal, siginfo_t* info, void*) {
  noteCall(signal, info);
  sigaction(signal, &g_previous, nullptr);
}
// As Python's faulthandler does.
void onSignalRaisingAgain(int signal) {
  noteCall(signal, nullptr);
  sigaction(signal, &g_previous, nullptr);
  raise(signal);
}

using InfoHandler = void (*)(int, siginfo_t*, void*);
void install(InfoHandler handler, int flags = 0) {
  struct sigaction action = {};
  action.sa_sigaction = handler;
  action.sa_flags = SA_SIGINFO | flags;
  sigemptyset(&action.sa_mask);
  sigaddset(&action.sa_mask, SIGUSR1);
  sigaction(SIGBUS, &action, &g_previous);
}
void installPlain(void (*handler)(int), int flags = 0) {
  struct sigaction action = {};
  action.sa_handler = handler;
  action.sa_flags = flags;
  sigemptyset(&action.sa_mask);
  sigaction(SIGBUS, &action, &g_previous);
}

// A file mapped and guarded at a place that the test chooses.
class PlacedMapping {
 public:
  PlacedMapping(const std::string& path, std::byte* place, std::size_t bytes) : data(place) {
    const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
    const void* const map = mmap(place, bytes, PROT_READ, MAP_SHARED | MAP_FIXED, fd, 0);
    close(fd);
    if (map != place || !guard.guard(place, bytes)) throw std::runtime_error("cannot map");
  }
  std::byte* const data;
  BusErrorGuard guard;
};

TEST_F(BusErrorGuardTest, MappingsThatTouchReportTheirOwnOffsets) {
  expectChildLeavesWith(0, [&] {
    const std::size_t bytes = 3 * kPageBytes + 100;  // a mapping ends with its last page
    const std::string lower_path = makeFile("lower", bytes), upper_path = makeFile("upper", bytes);
    void* const place =
        mmap(nullptr, 8 * kPageBytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (place == MAP_FAILED) return 1;
    auto* const first = static_cast<std::byte*>(place);
    {
      const PlacedMapping lower(lower_path, first, bytes);
      const PlacedMapping upper(upper_path, first + 4 * kPageBytes, bytes);
      cut(lower_path);
      touch(lower.data + 3 * kPageBytes + 50);
      if (lower.guard.failedOffset() != 3 * kPageBytes || upper.guard.failedOffset()) return 2;
      touch(upper.data);  // still whole
      cut(upper_path);
      touch(upper.data + 1);
      touch(upper.data + 2 * kPageBytes);  // the first counts
      if (lower.guard.failedOffset() != 3 * kPageBytes || upper.guard.failedOffset() != 0) return 3;
    }
    // A slot that is taken again has forgotten.
    return isGuarded() ? 0 : 4;
  });
}

TEST_F(BusErrorGuardTest, AForeignFaultDiesByTheSignalWhereNobodyHandlesIt) {
  for (const bool is_ignored : {false, true})  // no fault can be ignored
    expectChildDiesBy(SIGBUS, [&] {
      std::signal(SIGBUS, is_ignored ? SIG_IGN : SIG_DFL);
      if (!isGuarded()) return 1;
      touch(makeForeignPage());
      return 2;
    });
}

TEST_F(BusErrorGuardTest, ASignalThatSomebodySendsIsNoFault) {
  expectChildDiesBy(SIGBUS, [&] {
    std::signal(SIGBUS, SIG_DFL);
    if (!isGuarded()) return 1;
    raise(SIGBUS);
    return 2;
  });
  expectChildLeavesWith(0, [&] {
    std::signal(SIGBUS, SIG_IGN);
    if (!isGuarded()) return 1;
    raise(SIGBUS);
    kill(getpid(), SIGBUS);
    return isGuarded("again") ? 0 : 2;
  });
}

TEST_F(BusErrorGuardTest, AForeignFaultGoesToTheEarlierHandlerAndOursStays) {
  expectChildLeavesWith(0, [&] {
    install(onSignalMending);
    const std::string path = makeFile("open", 4 * kPageBytes);
    const PagedFile open_all_the_while(path);
    for (int round = 1; round <= 3; ++round) {
      if (seen().calls != round - 1) return 10 * round + 1;
      unsigned char* const page = makeForeignPage();
      touch(page + 77);
      if (seen().calls != round || seen().signal != SIGBUS) return 10 * round + 2;
      if (seen().code != BUS_ADRERR || seen().address != page + 77) return 10 * round + 3;
      if (seen().usr1_blocked != 1 || seen().bus_blocked != 1) return 10 * round + 4;
      sigset_t blocked;  // the mask was for the handler alone
      pthread_sigmask(SIG_SETMASK, nullptr, &blocked);
      if (sigismember(&blocked, SIGUSR1) || sigismember(&blocked, SIGBUS)) return 10 * round + 5;
    }
    cut(path);
    touch(open_all_the_while.data() + kPageBytes);
    return open_all_the_while.failedOffset() == kPageBytes ? 0 : 1;
  });
}

TEST_F(BusErrorGuardTest, ItsFlagsHoldForTheEarlierHandler) {
  expectChildLeavesWith(0, [&] {
    install(onSignalMending, SA_NODEFER);
    if (!isGuarded()) return 1;
    touch(makeForeignPage());
    return seen().calls == 1 && seen().bus_blocked == 0 && seen().usr1_blocked == 1 ? 0 : 2;
  });
  seen() = Seen();
  expectChildLeavesWith(0, [&] {
    installPlain(onSignalWithoutInfo);
    if (!isGuarded()) return 1;
    touch(g_page_to_mend = makeForeignPage());
    return seen().calls == 1 && seen().signal == SIGBUS && isGuarded() ? 0 : 2;
  });
  seen() = Seen();
  // Once, and then the default.
  expectChildDiesBy(SIGBUS, [&] {
    install(onSignalMending, SA_RESETHAND);
    if (!isGuarded()) return 1;
    touch(makeForeignPage());
    if (seen().calls != 1 || !isGuarded("again")) return 2;
    touch(makeForeignPage("second"));
    return 3;
  });
  EXPECT_EQ(seen().calls, 1);
  seen() = Seen();
}

// Such a handler never comes back to us.
TEST_F(BusErrorGuardTest, HandlersMayJumpOut) {
  expectChildLeavesWith(0, [&] {
    install(onSignalJumping);
    volatile int guarded = 0;  // volatile, for it is changed after sigsetjmp()
    while (guarded < 3) {
      if (!isGuarded() || seen().calls != guarded) return 1;
      guarded = guarded + 1;
      unsigned char* const page = makeForeignPage();
      if (sigsetjmp(g_way_out, 1) == 0) touch(page);
      if (seen().calls != guarded) return 2;
    }
    return 0;
  });
  seen() = Seen();
}

TEST_F(BusErrorGuardTest, AHandlerThatCameLaterIsPutBehindOurs) {
  expectChildLeavesWith(0, [&] {
    std::signal(SIGBUS, SIG_DFL);
    const std::string path = makeFile("early", 4 * kPageBytes);
    const PagedFile early(path);
    installPlain(onSignalRaisingAgain, SA_NODEFER);
    // A new mapping and the use of an old one put ours in front.
    if (!isGuarded()) return 1;
    installPlain(onSignalRaisingAgain, SA_NODEFER);
    if (!early.reaches(0, 1)) return 2;
    cut(path);
    touch(early.data() + 2 * kPageBytes);
    return early.failedOffset() == 2 * kPageBytes && seen().calls == 0 ? 0 : 3;
  });
  seen() = Seen();
}

TEST_F(BusErrorGuardTest, AHandlerThatCameLaterGetsWhatIsForeign) {
  expectChildLeavesWith(0, [&] {
    if (!isGuarded()) return 1;
    install(onSignalMending);
    for (int round = 1; round <= 3; ++round) {
      if (!isGuarded()) return 2;
      touch(makeForeignPage());
      if (seen().calls != round) return 3;
    }
    return 0;
  });
  seen() = Seen();
}

// The later handler's own way back leads to ours: it is called once, and then what was before us
// has its turn.
TEST_F(BusErrorGuardTest, ALaterHandlerThatPassesOnMakesNoLoop) {
  const auto dieAfter = [&](const std::function<void()>& install_it) {
    expectChildDiesBy(SIGBUS, [&] {
      std::signal(SIGBUS, SIG_DFL);
      if (!isGuarded()) return 1;
      install_it();
      if (!isGuarded("again")) return 2;
      touch(makeForeignPage());
      return 3;
    });
    EXPECT_EQ(seen().calls, 1);
    seen() = Seen();
  };
  dieAfter([] { install(onSignalCallingPrevious); });
  dieAfter([] { install(onSignalRestoringPrevious); });
  dieAfter([] { installPlain(onSignalRaisingAgain, SA_NODEFER); });
  dieAfter([] { installPlain(onSignalRaisingAgain); });
}

// Somebody who comes and goes (faulthandler.enable(), disable()) wears nothing out.
TEST_F(BusErrorGuardTest, LaterHandlersMayComeAndGo) {
  expectChildDiesBy(SIGBUS, [&] {
    std::signal(SIGBUS, SIG_DFL);
    if (!isGuarded()) return 1;
    for (int round = 0; round < 100; ++round) {
      install(onSignalCallingPrevious);
      if (!isGuarded()) return 2;
      sigaction(SIGBUS, &g_previous, nullptr);
      if (!isGuarded()) return 3;
    }
    install(onSignalCallingPrevious);
    if (!isGuarded()) return 4;
    touch(makeForeignPage());
    return 5;
  });
  EXPECT_EQ(seen().calls, 1);
  seen() = Seen();
}

// The signal handler never pairs the begin of one range with the size of another.
TEST(RangeSlot, IsReadWholeOrNotAtAll) {
  RangeSlot slot;
  std::atomic<bool> is_done{false};
  std::thread changing([&] {
    for (std::uint64_t i = 0; !is_done; ++i) {
      slot.set({static_cast<std::uintptr_t>(1 + i % 1000), 2 * (1 + i % 1000)});
      if (i % 3 == 0) slot.set({});
    }
  });
  std::int64_t read = 0, torn = 0;
  while (read < 5000000) {
    const auto range = slot.read();
    if (!range) continue;
    ++read;
    if (range->size != 2 * range->begin) ++torn;
  }
  is_done = true;
  changing.join();
  EXPECT_EQ(torn, 0);
  slot.set({});
  EXPECT_FALSE(slot.read());
}

// Mappings come and go on all threads while the signal handler looks for the one that failed.
TEST_F(BusErrorGuardTest, FaultsWhileOthersOpenAndClose) {
  expectChildLeavesWith(0, [&] {
    constexpr int kFaulting = 2, kOpening = 3, kRounds = 300;
    for (int t = 0; t < kOpening; ++t) makeFile("whole" + std::to_string(t), 2 * kPageBytes);
    std::atomic<int> wrong{0}, running{kFaulting};
    std::vector<std::thread> threads;
    for (int t = 0; t < kFaulting; ++t)
      threads.emplace_back([&, t] {
        for (std::size_t round = 0; round < kRounds; ++round) {
          const std::string path = makeFile("cut" + std::to_string(t), 5 * kPageBytes);
          const PagedFile file(path);
          cut(path);
          const std::size_t page = round % 5;
          touch(file.data() + page * kPageBytes + round % kPageBytes);
          if (file.failedOffset() != page * kPageBytes) ++wrong;
        }
        --running;
      });
    for (int t = 0; t < kOpening; ++t)
      threads.emplace_back([&, t] {
        while (running > 0) {
          const PagedFile file(folder_.file("whole" + std::to_string(t)));
          touch(file.data() + kPageBytes);
          if (file.failedOffset()) ++wrong;
        }
      });
    for (std::thread& thread : threads) thread.join();
    return wrong == 0 ? 0 : 1;
  });
}

}  // namespace
}  // namespace isobrick::test
