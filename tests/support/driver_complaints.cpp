// Of every executable of tests: contexts are made for debugging, and what a driver complains of
// fails the test that drew.
#include "tests/support/driver_complaints.h"

#include <gtest/gtest.h>

#include <mutex>
#include <string_view>

#include "isobrick/viewer/render/gl_debug_output.h"

namespace isobrick::test {
namespace {

// Messages that contain these words, with the reason why they are no fault of ours.
struct HarmlessMessage {
  std::string_view words, reason;
};
constexpr HarmlessMessage kHarmless[] = {
    {"Buffer performance warning", "a hint on where a buffer should lie, from drivers of cards"},
    {"Program/shader state performance warning",
     "NVIDIA's driver compiles a shader again for other planes, samples or targets"},
};

struct Heard {
  std::mutex mutex;
  bool is_expected = false;
  std::vector<std::string> lines;
};
Heard& heardComplaints() {
  static Heard heard;
  return heard;
}

void onComplaint(const DriverMessage& message) {
  for (const HarmlessMessage& harmless : kHarmless)
    if (message.text.find(harmless.words) != std::string::npos) return;
  Heard& heard = heardComplaints();
  const std::lock_guard lock(heard.mutex);
  if (heard.is_expected)
    heard.lines.push_back(message.line());
  else
    ADD_FAILURE() << "the OpenGL driver complains (" << message.line() << ")";
}

[[maybe_unused]] const bool kListens = [] {
  listenToDrivers(onComplaint);
  return true;
}();

}  // namespace

ExpectedComplaints::ExpectedComplaints() {
  Heard& heard = heardComplaints();
  const std::lock_guard lock(heard.mutex);
  heard.is_expected = true;
  heard.lines.clear();
}

ExpectedComplaints::~ExpectedComplaints() {
  Heard& heard = heardComplaints();
  const std::lock_guard lock(heard.mutex);
  heard.is_expected = false;
}

std::vector<std::string> ExpectedComplaints::heard() const {
  Heard& heard = heardComplaints();
  const std::lock_guard lock(heard.mutex);
  return heard.lines;
}

}  // namespace isobrick::test
