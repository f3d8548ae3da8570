#include "tools/program_run.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <string_view>

namespace isobrick {
namespace {

// The two ends of a pipe; ends that are still open are closed.
class Pipe {
 public:
  Pipe() {
    if (pipe2(ends_.data(), O_CLOEXEC) != 0)
      throw Error(fmt::format("cannot make a pipe: {}", std::strerror(errno)));
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  ~Pipe() {
    closeEnd(0);
    closeEnd(1);
  }
  int readEnd() const { return ends_[0]; }
  int writeEnd() const { return ends_[1]; }
  void closeEnd(std::size_t end) {
    if (ends_[end] >= 0) close(ends_[end]);
    ends_[end] = -1;
  }

 private:
  std::array<int, 2> ends_{-1, -1};
};

std::string_view nameOf(std::string_view setting) { return setting.substr(0, setting.find('=')); }

std::vector<std::string> environmentWith(const std::vector<std::string>& settings) {
  std::vector<std::string> all = settings;
  for (char** own = environ; *own != nullptr; ++own) {
    const std::string_view name = nameOf(*own);
    if (std::none_of(settings.begin(), settings.end(),
                     [&](const std::string& s) { return nameOf(s) == name; }))
      all.emplace_back(*own);
  }
  return all;
}

// The arguments of execve(); the pointers live as long as `words`.
std::vector<char*> pointersTo(std::vector<std::string>& words) {
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return pointers;
}

pid_t start(const ProgramCall& call, const Pipe& out, const Pipe& err) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, out.writeEnd(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err.writeEnd(), STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  // A process whose caller is gone ends when it writes to it.
  sigset_t defaults;
  sigemptyset(&defaults);
  for (const int number : {SIGPIPE, SIGTERM, SIGINT}) sigaddset(&defaults, number);
  posix_spawnattr_setsigdefault(&attributes, &defaults);
  posix_spawnattr_setpgroup(&attributes, 0);
  if (call.tidy_end_milliseconds > 0)
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGDEF);
  std::vector<std::string> words = call.words;
  std::vector<std::string> environment = environmentWith(call.environment);
  pid_t pid = -1;
  const int failure = posix_spawn(&pid, call.words.front().c_str(), &actions, &attributes,
                                  pointersTo(words).data(), pointersTo(environment).data());
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  if (failure != 0)
    throw Error(fmt::format("cannot run '{}': {}", call.words.front(), std::strerror(failure)));
  return pid;
}

// Whether there may be more to read.
bool readSome(int descriptor, std::string& text) {
  std::array<char, 1 << 16> buffer;
  const ssize_t count = read(descriptor, buffer.data(), buffer.size());
  if (count > 0) text.append(buffer.data(), static_cast<std::size_t>(count));
  return count > 0 || (count < 0 && errno == EINTR);
}

int waitFor(pid_t pid) {
  int status = 0;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

std::string lastLine(std::string text) {
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text.substr(text.rfind('\n') + 1);
}

void throwIfFailed(const ProgramCall& call, int status, const std::string& errors) {
  const std::string name = std::filesystem::path(call.words.front()).filename().string();
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    throw Error(fmt::format("'{}' was killed by signal {} ({}){}", name, signal, strsignal(signal),
                            signal == SIGKILL ? ": perhaps it needed more memory than there is; "
                                                "give less --memory, or use a smaller volume"
                                              : ""));
  }
  if (WEXITSTATUS(status) == 0) return;
  std::string said = lastLine(errors);
  if (said.rfind(name + ": ", 0) == 0) said.erase(0, name.size() + 2);
  throw ProgramFailure(fmt::format("'{}' left with status {}: {}", name, WEXITSTATUS(status),
                                   said.empty() ? "it does not say why" : said),
                       said);
}

// Reports the complete lines so far, and keeps the last one alone, which a failure names.
void tellLines(const ProgramCall& call, std::string& text, std::size_t& told) {
  if (!call.on_error_line) return;
  for (std::size_t end = 0; (end = text.find('\n', told)) != std::string::npos; told = end + 1)
    call.on_error_line(std::string_view(text).substr(told, end - told));
  constexpr std::size_t kMostTold = 1 << 16;
  if (told < kMostTold) return;
  const std::size_t last = told < 2 ? std::string::npos : text.rfind('\n', told - 2);
  const std::size_t gone = last == std::string::npos ? 0 : last + 1;
  text.erase(0, gone);
  told -= gone;
}

void end(const ProgramCall& call, pid_t pid) {
  int status = 0;
  if (call.tidy_end_milliseconds > 0) {
    kill(pid, SIGTERM);
    constexpr int kMillisecondsBetweenLooks = 5;
    for (int waited = 0; waited < call.tidy_end_milliseconds; waited += kMillisecondsBetweenLooks) {
      if (waitpid(pid, &status, WNOHANG) == pid) return;
      usleep(1000 * kMillisecondsBetweenLooks);
    }
  }
  kill(pid, SIGKILL);
  waitFor(pid);
}

}  // namespace

std::string runProgram(const ProgramCall& call, const CancelFlag* cancel) {
  if (cancel != nullptr) cancel->check();
  Pipe out, err;
  const pid_t pid = start(call, out, err);
  out.closeEnd(1);
  err.closeEnd(1);

  std::string printed, errors;
  std::size_t told = 0;  // bytes of `errors` that make whole lines
  std::array<pollfd, 2> open_ends{{{out.readEnd(), POLLIN, 0}, {err.readEnd(), POLLIN, 0}}};
  const std::array<std::string*, 2> texts{&printed, &errors};
  constexpr int kMillisecondsBetweenLooks = 50;  // at `cancel`
  while (open_ends[0].fd >= 0 || open_ends[1].fd >= 0) {
    if (cancel != nullptr && cancel->requested()) {
      end(call, pid);
      throw Cancelled();
    }
    if (poll(open_ends.data(), open_ends.size(), kMillisecondsBetweenLooks) <= 0) continue;
    for (std::size_t i = 0; i < open_ends.size(); ++i)
      if (open_ends[i].revents != 0 && !readSome(open_ends[i].fd, *texts[i])) open_ends[i].fd = -1;
    tellLines(call, errors, told);
  }
  const int status = waitFor(pid);
  // Ctrl-C reaches the program as well, which then fails only for that reason.
  if (cancel != nullptr) cancel->check();
  throwIfFailed(call, status, errors);
  return printed;
}

}  // namespace isobrick
