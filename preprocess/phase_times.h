// The time that each step of a build takes.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>

namespace isobrick {

enum class BuildStep { kRead, kLowPass, kRanges, kCount, kCurvature, kPack, kWrite, kPublish };
inline constexpr std::array<const char*, 8> kBuildStepNames = {
    "read", "low-pass", "ranges", "count", "curvature", "pack", "write", "publish"};

// Seconds that all threads together spent in each step. Thread-safe.
class PhaseTimes {
 public:
  using Clock = std::chrono::steady_clock;

  // Adds the time of its life to a step.
  class Timer {
   public:
    Timer(PhaseTimes& times, BuildStep step) : times_(times), step_(step) {}
    ~Timer() {
      times_.nanoseconds_[static_cast<std::size_t>(step_)].fetch_add(
          std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - begin_).count(),
          std::memory_order_relaxed);
    }
    Timer(const Timer&) = delete;
    Timer& operator=(const Timer&) = delete;

   private:
    PhaseTimes& times_;
    BuildStep step_;
    Clock::time_point begin_ = Clock::now();
  };

  double seconds(BuildStep step) const {
    return static_cast<double>(nanoseconds_[static_cast<std::size_t>(step)].load()) * 1e-9;
  }

 private:
  std::array<std::atomic<std::int64_t>, kBuildStepNames.size()> nanoseconds_{};
};

}  // namespace isobrick
