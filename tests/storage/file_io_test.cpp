// The loops around read and write, where the system does less than it was asked for.
#include "isobrick/storage/file_io.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <string>
#include <thread>

#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

class FileIo : public testing::Test {
 protected:
  FileIo() : fd_(open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600)) {}
  ~FileIo() override { close(fd_); }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.file("bytes");
  const int fd_;
};

TEST_F(FileIo, ReadsLessWhereTheFileEnds) {
  const std::string text = "0123456789";
  ASSERT_EQ(writeBytesAt(fd_, 0, text.data(), text.size()).bytes, 10u);
  std::string out(8, '.');
  const IoResult result = readBytesAt(fd_, 6, out.data(), out.size());
  EXPECT_EQ(result.bytes, 4u);
  EXPECT_EQ(result.error, 0);
  EXPECT_EQ(out, "6789....");
  EXPECT_EQ(ioFailureText(6, result), "at byte 10: it is shorter than it was");
}

TEST_F(FileIo, OffsetsThatNoFileHasAreItsEnd) {
  char byte = 0;
  for (const std::uint64_t offset : {~std::uint64_t{0}, std::uint64_t{1} << 63}) {
    const IoResult read = readBytesAt(fd_, offset, &byte, 1);
    EXPECT_EQ(read.bytes, 0u);
    EXPECT_EQ(read.error, 0);
    EXPECT_EQ(writeBytesAt(fd_, offset, &byte, 1).error, EFBIG);
    iovec span{&byte, 1};
    EXPECT_EQ(writeBytesAt(fd_, offset, {&span, 1}).error, EFBIG);
  }
}

TEST_F(FileIo, ErrorsAreHandedOn) {
  char byte = 0;
  EXPECT_EQ(readBytesAt(-1, 0, &byte, 1).error, EBADF);
  EXPECT_EQ(writeBytesAt(-1, 0, &byte, 1).error, EBADF);
  EXPECT_EQ(writeNextBytes(-1, &byte, 1).error, EBADF);
  EXPECT_EQ(ioFailureText(3, {4, EIO}), "at byte 7: Input/output error");
}

// The limit on the size of files cuts a write in the middle of a span; what fits is written. In a
// child, because the limit counts for the whole process.
TEST_F(FileIo, SpansAreWrittenUpToTheByteThatFits) {
  const pid_t child = fork();
  if (child == 0) {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{9, 9};
    setrlimit(RLIMIT_FSIZE, &limit);
    std::string a = "abc", b = "defg", c = "hijkl";
    std::array<iovec, 5> spans{{{a.data(), 3}, {nullptr, 0}, {b.data(), 4}, {c.data(), 5}, {}}};
    const IoResult result = writeBytesAt(fd_, 0, spans);
    _exit(result.bytes == 9 && result.error == EFBIG ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(readBytes(path_), "abcdefghi");
}

// A pipe takes little at a time, and signals interrupt the wait for more room.
TEST_F(FileIo, InterruptedWritesGoOn) {
  int ends[2];
  ASSERT_EQ(pipe2(ends, O_CLOEXEC), 0);
  std::string sent(std::size_t{4} << 20, '\0');
  for (std::size_t i = 0; i < sent.size(); ++i) sent[i] = static_cast<char>(i * 7 + i / 256);

  static volatile sig_atomic_t signals;
  signals = 0;
  struct sigaction interrupt = {}, before = {};
  interrupt.sa_handler = [](int) { signals = signals + 1; };  // without SA_RESTART
  sigaction(SIGUSR1, &interrupt, &before);
  const pthread_t writer = pthread_self();
  std::string received;
  std::thread reader([&] {
    std::array<char, 30000> some;
    while (received.size() < sent.size()) {
      pthread_kill(writer, SIGUSR1);
      const ssize_t got = read(ends[0], some.data(), some.size());
      if (got <= 0) break;
      received.append(some.data(), static_cast<std::size_t>(got));
    }
  });
  const IoResult result = writeNextBytes(ends[1], sent.data(), sent.size());
  close(ends[1]);
  reader.join();
  close(ends[0]);
  sigaction(SIGUSR1, &before, nullptr);
  EXPECT_EQ(result.bytes, sent.size());
  EXPECT_EQ(result.error, 0);
  EXPECT_GT(signals, 0);
  EXPECT_EQ(received, sent);
}

}  // namespace
}  // namespace isobrick::test
