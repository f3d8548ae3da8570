// Progress and time of long work.
#pragma once

#include <chrono>
#include <mutex>
#include <string>
#include <string_view>

namespace isobrick {

// The style of progress.
enum class ProgressStyle {
  kBar,    // drawn if stderr is a terminal, nothing anywhere else
  kLines,  // for programs, wherever stderr goes: "progress 0.612 read", share and phase
};

// Draws on stderr. The line is wiped when the bar goes out of scope, also by an exception, so that
// later output begins on a clean line. Thread-safe; cheap enough to be called for every brick (it
// draws ten times a second at most).
class ProgressBar {
 public:
  // `total` is the amount of a whole phase, in `unit`, for the rate: 268.4 and "MB".
  ProgressBar(double total, std::string unit, ProgressStyle style = ProgressStyle::kBar);
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  // "read  ######....  61 %  512 MB/s  3 s left"; a new phase starts its own clock, and its
  // progress by then (a resumed build begins in the middle) does not count as speed.
  void show(std::string_view phase, double fraction);
  // The same if the amount, in `unit`, does not follow from the fraction; `total` is not used.
  void show(std::string_view phase, double fraction, double amount);

 private:
  using Clock = std::chrono::steady_clock;
  void begin(std::string_view phase, double fraction, double amount);
  bool isTime();
  void draw(std::string line);

  const bool lines_, is_terminal_;
  const double total_;
  const std::string unit_;
  std::mutex mutex_;  // guards all below
  std::string phase_;
  Clock::time_point phase_begin_{};
  double first_fraction_ = 0, first_amount_ = 0;
  Clock::time_point last_drawn_{};
  bool is_dirty_ = false;
};

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  }

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace isobrick
