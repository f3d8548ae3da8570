// The viewer's session and its threads in which a call to the system fails: an error in its status
// or out of the call, and it goes on.
#include <gtest/gtest.h>

#include <random>
#include <stdexcept>
#include <thread>
#include <vector>

#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/session/view_session.h"
#include "tests/faults/fault_sweep.h"
#include "tests/support/child_process.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/null_renderer.h"

namespace isobrick::test {
namespace {

class ViewSubject : public FaultSubject {
 public:
  explicit ViewSubject(const std::string& path) : pyramid_(std::make_shared<Pyramid>(path)) {}

  void attempt() override {
    const std::string error = look();
    if (!error.empty()) throw std::runtime_error(error);
  }
  std::string afterwards() override {
    if (session_ != nullptr) {
      session_->state().surfaces[0].isovalue = 7;
      session_->state().focus.radius = 20;
    }
    const std::string error = look();
    if (!error.empty()) return error;
    return session_->status().triangles > 0 ? "" : "nothing is shown";
  }

 private:
  // Frames until all is there; returns what the status says of errors.
  std::string look() {
    if (session_ == nullptr) {
      session_ = std::make_unique<ViewSession>(pyramid_, renderer_, SessionOptions{2, 1 << 30});
      session_->apply(InputEvent::resized(200, 100), 0.0, false);
    }
    for (int frame = 0; frame < 20000; ++frame) {
      session_->update(clock_ += 0.05);
      session_->draw();
      session_->noteDrawing(0.001);
      if (session_->settled()) return session_->status().error;
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    return "it never settles";
  }

  std::shared_ptr<const Pyramid> pyramid_;
  NullRenderer renderer_;
  std::unique_ptr<ViewSession> session_;
  double clock_ = 0;
};

TEST(ViewFaults, ASessionSaysSoAndGoesOn) {
  const TemporaryFolder folder;
  const std::string path = folder.file("field.isb");
  expectChildLeavesWith(0, [&] {
    BuildOptions options;
    options.brick_cells = 16;
    buildField(
        folder, Index3(60),
        [](const glm::dvec3& p) { return 25.0 - glm::distance(p, glm::dvec3(30.0)); }, options);
    return 0;
  });
  sweepFaults("session", [&] { return std::make_unique<ViewSubject>(path); });
}

// Chunks are released in destructors and after other failures.
TEST(ViewFaults, GivingBackNeedsNoMemory) {
  FreeRuns runs(2000);
  std::vector<std::size_t> held;
  std::mt19937 random(5);
  for (int step = 0; step < 4000; ++step) {
    if (held.empty() || random() % 2 == 0) {
      if (const auto begin = runs.take(3)) held.push_back(*begin);
      continue;
    }
    std::swap(held[random() % held.size()], held.back());
    armFault(FaultKind::kAllocation, 0);
    runs.give(held.back(), 3);
    const std::uint64_t calls = countedCalls(FaultKind::kAllocation);
    disarmFaults();
    ASSERT_EQ(calls, 0u) << "step " << step;
    held.pop_back();
  }
}

}  // namespace
}  // namespace isobrick::test
