#include "tests/faults/fault_sweep.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <exception>
#include <iterator>
#include <new>
#include <string_view>

#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

constexpr unsigned kMostSeconds = 60;  // for one fault; more is a hang
constexpr std::uint64_t kUsualFaults = 48;

// The notes of a child, also of one that dies.
struct Notes {
  std::uint64_t counts[std::size(kFaultKinds)];
  std::uint64_t at;  // the place in the list of numbers
  std::uint64_t happened, errors, wrong;
  char text[2000];  // of what was wrong

  void add(const char* kind, std::uint64_t number, const std::string& what) {
    ++wrong;
    const std::size_t length = std::strlen(text);
    std::snprintf(text + length, sizeof text - length, "%s %llu: %.300s\n", kind,
                  static_cast<unsigned long long>(number), what.c_str());
  }
};

// Runs `work` in a child; returns how it ended, or "".
std::string endOfChild(const std::function<void()>& work) {
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    try {
      work();
    } catch (const std::exception& failure) {
      std::fprintf(stderr, "without a fault: %s\n", failure.what());
      _exit(99);
    }
    _exit(0);
  }
  int status = 0;
  waitpid(child, &status, 0);
  if (WIFSIGNALED(status))
    return WTERMSIG(status) == SIGALRM ? "hangs"
                                       : "dies by signal " + std::to_string(WTERMSIG(status));
  return WEXITSTATUS(status) == 0 ? "" : "leaves with " + std::to_string(WEXITSTATUS(status));
}

// The subject's message about the fault; "": none.
std::string attemptUnder(FaultKind kind, std::uint64_t number, FaultSubject& subject) {
  std::string said;
  armFault(kind, number);
  try {
    subject.attempt();
    disarmFaults();
  } catch (const std::exception& failure) {
    disarmFaults();
    said = failure.what();
    if (said.empty()) said = "an error without words\n";
  }
  return said;
}

void tryOne(const std::function<std::unique_ptr<FaultSubject>()>& make, FaultKind kind,
            std::uint64_t number, bool is_first, Notes& notes) {
  alarm(kMostSeconds);
  const std::unique_ptr<FaultSubject> subject = make();
  const std::string said = attemptUnder(kind, number, *subject);
  const bool happened = hasFaultHappened();
  if (is_first) {
    notes.happened += happened ? 1 : 0;
    notes.errors += said.empty() ? 0 : 1;
  }
  if (!happened && !said.empty()) notes.add(nameOf(kind), number, "fails without a fault: " + said);
  if (said.find('\n') != std::string::npos)
    notes.add(nameOf(kind), number, "says more than a line: " + said);
  try {
    const std::string wrong = subject->afterwards();
    if (!wrong.empty()) notes.add(nameOf(kind), number, "afterwards: " + wrong);
  } catch (const std::exception& failure) {
    notes.add(nameOf(kind), number, std::string("afterwards: ") + failure.what());
  }
}

// Memory that is kept from run to run grows once; memory that grows each time is lost.
void tryOneForLeaks(const std::function<std::unique_ptr<FaultSubject>()>& make, FaultKind kind,
                    std::uint64_t number, Notes& notes) {
  constexpr int kMostTimes = 6;
  for (int times = 0; times < kMostTimes; ++times) {
    const std::int64_t before = liveAllocations();
    tryOne(make, kind, number, times == 0, notes);
    if (liveAllocations() <= before || !hasFaultHappened()) return;
  }
  notes.add(nameOf(kind), number, "leaks");
}

}  // namespace

std::vector<std::uint64_t> faultNumbers(std::uint64_t count, std::uint64_t most) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  if (!environmentSays("ISOBRICK_ALL_FAULTS")) most /= 4;  // each takes as many times longer
#endif
  std::vector<std::uint64_t> numbers;
  const bool are_all = count <= most;
  const std::uint64_t first = are_all ? count : most / 3;
  for (std::uint64_t n = 1; n <= first; ++n) numbers.push_back(n);
  if (are_all) return numbers;
  for (std::uint64_t i = 1; i <= most - first; ++i)
    numbers.push_back(first + i * (count - first) / (most - first));
  return numbers;
}

void sweepFaults(const std::string& name,
                 const std::function<std::unique_ptr<FaultSubject>()>& make) {
  auto* const notes = static_cast<Notes*>(
      mmap(nullptr, sizeof(Notes), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
  ASSERT_NE(static_cast<void*>(notes), MAP_FAILED);
  const std::string counting = endOfChild([&] {
    alarm(kMostSeconds);
    for (int times = 0; times < 3; ++times) {
      const std::unique_ptr<FaultSubject> subject = make();
      armFault(FaultKind::kAllocation, 0);
      subject->attempt();
      disarmFaults();
      for (const FaultKind kind : kFaultKinds) {
        std::uint64_t& count = notes->counts[static_cast<std::size_t>(kind)];
        count = std::max(count, countedCalls(kind));
      }
    }
  });
  ASSERT_EQ(counting, "") << name << ", without a fault";
  for (const FaultKind kind : kFaultKinds) {
    const std::uint64_t count = notes->counts[static_cast<std::size_t>(kind)];
    const std::vector<std::uint64_t> numbers =
        faultNumbers(count, environmentSays("ISOBRICK_ALL_FAULTS") ? count : kUsualFaults);
    notes->at = notes->happened = notes->errors = notes->wrong = 0;
    notes->text[0] = '\0';
    while (notes->at < numbers.size()) {
      const std::string end = endOfChild([&] {
        for (; notes->at < numbers.size(); ++notes->at)
          tryOneForLeaks(make, kind, numbers[notes->at], *notes);
      });
      if (end.empty()) continue;
      notes->add(nameOf(kind), numbers[notes->at], end);
      ++notes->at;
    }
    std::printf("%s: %s: %llu calls, %zu tried, %llu faults, %llu errors, %llu wrong\n",
                name.c_str(), nameOf(kind), static_cast<unsigned long long>(count), numbers.size(),
                static_cast<unsigned long long>(notes->happened),
                static_cast<unsigned long long>(notes->errors),
                static_cast<unsigned long long>(notes->wrong));
    EXPECT_EQ(notes->wrong, 0u) << name << "\n" << notes->text;
  }
  munmap(notes, sizeof(Notes));
}

}  // namespace isobrick::test
