// Threads that load parts for callers who may leave.
#include <gtest/gtest.h>

#include <atomic>
#include <barrier>
#include <memory>

#include "isobrick/storage/abandonable.h"

namespace isobrick::test {
namespace {

// A machine of forty cores unpacks on all of them: each job waits until all run.
TEST(LoadThreads, RunAsManyJobsAsTheyAreTold) {
  std::barrier all_run(40);
  std::atomic<int> done{0};
  {
    LoadThreads threads(40);
    for (int i = 0; i < 40; ++i)
      ASSERT_TRUE(threads.run([&] {
        all_run.arrive_and_wait();
        ++done;
      }));
    while (done < 40) std::this_thread::yield();
  }
  EXPECT_EQ(done, 40);
}

TEST(LoadThreads, DropWhatAFinishedJobHolds) {
  LoadThreads threads;
  auto held = std::make_shared<int>(1);
  const std::weak_ptr<int> watched = held;
  ASSERT_TRUE(threads.run([held] {}));
  held.reset();
  while (!watched.expired()) std::this_thread::yield();
}

}  // namespace
}  // namespace isobrick::test
