#include "tools/progress_bar.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace isobrick {
namespace {

constexpr auto kBetweenDrawings = std::chrono::milliseconds(100);
constexpr int kBarCharacters = 24;
// Earlier than this a rate is a guess.
constexpr double kSecondsToRate = 0.5;

double secondsSince(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

std::string timeText(double seconds) {
  const auto whole = static_cast<long>(seconds + 0.5);
  if (whole < 60) return fmt::format("{} s", whole);
  if (whole < 3600) return fmt::format("{} min {:02} s", whole / 60, whole % 60);
  return fmt::format("{} h {:02} min", whole / 3600, whole / 60 % 60);
}

std::size_t terminalColumns() {
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 80;
  return size.ws_col;
}

}  // namespace

ProgressBar::ProgressBar(double total, std::string unit, ProgressStyle style)
    : lines_(style == ProgressStyle::kLines),
      is_terminal_(!lines_ && isatty(STDERR_FILENO) == 1),
      total_(total),
      unit_(std::move(unit)) {}

ProgressBar::~ProgressBar() {
  if (is_dirty_) std::fputs("\r\033[K", stderr);
}

void ProgressBar::show(std::string_view phase, double fraction) {
  show(phase, fraction, fraction * total_);
}

void ProgressBar::show(std::string_view phase, double fraction, double amount) {
  if (!lines_ && !is_terminal_) return;
  const std::lock_guard lock(mutex_);
  fraction = std::clamp(fraction, 0.0, 1.0);
  if (phase != phase_) begin(phase, fraction, amount);
  if (!isTime()) return;
  if (lines_) {
    fmt::print(stderr, "progress {:.3f} {}\n", fraction, phase);
    return;
  }
  const auto filled = static_cast<std::size_t>(fraction * kBarCharacters);
  std::string line = fmt::format("{}  {}{} {:3.0f} %", phase, std::string(filled, '#'),
                                 std::string(kBarCharacters - filled, '.'), 100 * fraction);
  const double seconds = secondsSince(phase_begin_);
  const double gained = fraction - first_fraction_;
  if (seconds > kSecondsToRate && gained > 0)
    line += fmt::format("  {:.3g} {}/s  {} left", (amount - first_amount_) / seconds, unit_,
                        timeText(seconds * (1 - fraction) / gained));
  draw(std::move(line));
}

void ProgressBar::begin(std::string_view phase, double fraction, double amount) {
  phase_ = phase;
  phase_begin_ = Clock::now();
  first_fraction_ = fraction;
  first_amount_ = amount;
  last_drawn_ = {};
}

bool ProgressBar::isTime() {
  const auto now = Clock::now();
  if (now - last_drawn_ < kBetweenDrawings) return false;
  last_drawn_ = now;
  return true;
}

void ProgressBar::draw(std::string line) {
  // A line that wraps could not be wiped. All text is ASCII, so bytes are columns.
  line.resize(std::min(line.size(), terminalColumns() - 1));
  std::fputs(("\r\033[K" + line).c_str(), stderr);
  std::fflush(stderr);
  is_dirty_ = true;
}

}  // namespace isobrick
