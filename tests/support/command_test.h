// Runs of the real `isobrick` command from a test: in a folder of its own, with what it printed.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_paths.h"

namespace isobrick::test {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using Words = std::vector<std::string>;

struct Outcome {
  int status = -1;  // exit status, or minus the signal that ended the process
  std::string out, err;

  std::ptrdiff_t errorLines() const { return std::count(err.begin(), err.end(), '\n'); }
};

class CommandTest : public testing::Test {
 protected:
  // Pyramids that commands build of volumes stay in this test.
  CommandTest() { setenv("XDG_CACHE_HOME", log_.file("cache").c_str(), 1); }

  // Starts a program in the work folder.
  pid_t start(Words words) {
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addchdir_np(&actions, work_.path().c_str());
    const int flags = O_WRONLY | O_CREAT | O_TRUNC;
    posix_spawn_file_actions_addopen(&actions, 1, log_.file("out").c_str(), flags, 0600);
    posix_spawn_file_actions_addopen(&actions, 2, log_.file("err").c_str(), flags, 0600);
    // A test that runs in the background may have inherited an ignored SIGINT.
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t defaults;
    sigemptyset(&defaults);
    sigaddset(&defaults, SIGINT);
    sigaddset(&defaults, SIGTERM);
    sigaddset(&defaults, SIGHUP);
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);

    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_t pid = -1;
    EXPECT_EQ(posix_spawn(&pid, argv[0], &actions, &attributes, argv.data(), environ), 0);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    return pid;
  }

  Outcome wait(pid_t pid) {
    int status = 0;
    EXPECT_EQ(waitpid(pid, &status, 0), pid);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status),
            readBytes(log_.file("out")), readBytes(log_.file("err"))};
  }

  Outcome run(Words words) {
    words.insert(words.begin(), isobrickCommand());
    return wait(start(std::move(words)));
  }

  // A run that has to succeed; its stdout.
  std::string runWell(const Words& words) {
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return outcome.out;
  }
  Json runForJson(Words words) {
    words.push_back("--json");
    return Json::parse(runWell(words));
  }

  // A run that has to fail: one line on stderr, nothing on stdout, no file more or less.
  void expectFailure(int status, const Words& words, const std::string& message) {
    const std::set<std::string> before = files();
    checkFailure(run(words), status, message, words);
    EXPECT_EQ(files(), before);
  }
  void checkFailure(const Outcome& outcome, int status, const std::string& message,
                    const Words& words = {}) {
    std::string line;
    for (const std::string& word : words) line += word + " ";
    EXPECT_EQ(outcome.status, status) << line << "\n" << outcome.err;
    EXPECT_EQ(outcome.out, "") << line;
    EXPECT_EQ(outcome.errorLines(), 1) << line << "\n" << outcome.err;
    EXPECT_EQ(outcome.err.rfind("isobrick: ", 0), 0u) << line << "\n" << outcome.err;
    EXPECT_NE(outcome.err.find(message), std::string::npos) << line << "\n" << outcome.err;
  }

  std::string path(const std::string& name) const { return work_.file(name); }

  // All that lies in the work folder.
  std::set<std::string> files() const {
    std::set<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(work_.path()))
      names.insert(fs::relative(entry.path(), work_.path()).string());
    return names;
  }

  TemporaryFolder work_, log_;
};

}  // namespace isobrick::test
