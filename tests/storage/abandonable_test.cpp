// runAbandonable(): the thread is gone when it returns, unless the call was given up.
#include "isobrick/storage/abandonable.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <string>
#include <thread>

namespace isobrick {
namespace {

std::atomic<bool> g_thread_has_ended{false};

// As a library keeps something for each thread, which takes its time to go.
struct SlowlyGone {
  bool is_used = false;
  ~SlowlyGone() {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    g_thread_has_ended = is_used;
  }
};

void useThreadsOwn() {
  static thread_local SlowlyGone of_thread;
  of_thread.is_used = true;
}

TEST(Abandonable, TheThreadHasEndedWithAllThatWasItsOwn) {
  const CancelFlag cancel;
  for (const bool fails : {false, true}) {
    g_thread_has_ended = false;
    const auto work = [&] {
      useThreadsOwn();
      if (fails) throw Error("no");
      return 7;
    };
    if (fails)
      EXPECT_THROW(runAbandonable(&cancel, work), Error);
    else
      EXPECT_EQ(runAbandonable(&cancel, work), 7);
    EXPECT_TRUE(g_thread_has_ended);
  }
}

TEST(Abandonable, ACancelledCallIsLeftToItself) {
  CancelFlag cancel;
  const auto go_on = std::make_shared<std::promise<void>>();
  const auto went_on = std::make_shared<std::promise<void>>();
  EXPECT_THROW(runAbandonable(&cancel,
                              [go_on = go_on->get_future().share(), went_on, &cancel] {
                                cancel.request();  // there as long as it is waited for
                                go_on.wait();
                                went_on->set_value();
                                return 0;
                              }),
               Cancelled);
  go_on->set_value();
  EXPECT_EQ(went_on->get_future().wait_for(std::chrono::seconds(30)), std::future_status::ready);
}

}  // namespace
}  // namespace isobrick
