// LeakSanitizer looks through all threads when a process ends. TBB's workers are told to end just
// then, and one that is on its way out makes it fail. So they are waited for when the tests are
// done.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <new>

namespace isobrick::test {
namespace {

class WorkersEnd : public testing::Environment {
 public:
  void TearDown() override {
    tbb::task_scheduler_handle handle{tbb::attach{}};
    tbb::finalize(handle, std::nothrow);
  }
};

const testing::Environment* const kWorkersEnd =
    testing::AddGlobalTestEnvironment(new WorkersEnd);  // gtest's

}  // namespace
}  // namespace isobrick::test
