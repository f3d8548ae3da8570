// Work of a test that may kill its process, in a child.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>
#include <stdexcept>

namespace isobrick::test {

// Runs `work` in a child process; returns its wait status. The child leaves with what `work`
// returns (99: it threw), and a signal that kills it shows in the status.
inline int statusOfChild(const std::function<int()>& work) {
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("cannot fork");
  if (child == 0) {
    const int silent = open("/dev/null", O_WRONLY);
    dup2(silent, STDERR_FILENO);
    int result = 99;
    try {
      result = work();
    } catch (...) {
    }
    _exit(result);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return status;
}

inline void expectChildLeavesWith(int result, const std::function<int()>& work) {
  const int status = statusOfChild(work);
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), result);
}

inline void expectChildDiesBy(int signal, const std::function<int()>& work) {
  const int status = statusOfChild(work);
  ASSERT_TRUE(WIFSIGNALED(status)) << "left with " << WEXITSTATUS(status);
  EXPECT_EQ(WTERMSIG(status), signal);
}

}  // namespace isobrick::test
