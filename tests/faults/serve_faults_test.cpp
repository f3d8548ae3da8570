// The server in which a call to the system fails, once or for good: what asks for it then may get
// an error, and after a fault that passes the next one gets the whole.
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <deque>
#include <fstream>
#include <map>
#include <thread>
#include <utility>
#include <vector>

#include "isobrick/storage/checksum.h"
#include "tests/faults/fault_sweep.h"
#include "tests/support/command_test.h"
#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

// A connection to a port of this machine; a peer that says nothing for 20 s ends it.
class Line {
 public:
  explicit Line(int port) : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const timeval patience = {20, 0};
    setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    is_good_ = connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  ~Line() { close(fd_); }
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;

  bool hangs() const { return hangs_; }
  void say(const std::string& text) {
    is_good_ = is_good_ && send(fd_, text.data(), text.size(), MSG_NOSIGNAL) ==
                               static_cast<ssize_t>(text.size());
  }
  // Up to and with `end`, or "" if the line ends before.
  std::string until(const std::string& end) {
    std::size_t at = 0;
    while ((at = heard_.find(end)) == std::string::npos)
      if (!hear()) return "";
    return take(at + end.size());
  }
  std::string bytes(std::size_t count) {
    while (heard_.size() < count)
      if (!hear()) return "";
    return take(count);
  }
  std::string toTheEnd() {
    while (hear()) {
    }
    return take(heard_.size());
  }

 private:
  bool hear() {
    char buffer[1 << 16];
    const ssize_t count = is_good_ ? recv(fd_, buffer, sizeof buffer, 0) : -1;
    hangs_ = hangs_ || (is_good_ && count < 0 && errno == EAGAIN);
    if (count <= 0) return is_good_ = false;
    heard_.append(buffer, static_cast<std::size_t>(count));
    return true;
  }
  std::string take(std::size_t count) {
    std::string taken = heard_.substr(0, count);
    heard_.erase(0, count);
    return taken;
  }

  int fd_;
  bool is_good_ = false, hangs_ = false;
  std::string heard_;
};

class ServeFaults : public CommandTest {
 protected:
  void SetUp() override { runWell({"build", "phantom:head:40", "--brick", "8", "-o", "head.isb"}); }
  void TearDown() override { unsetenv("TMPDIR"); }

  // The server under a fault: its port and key, unless it ended first.
  struct Server {
    std::string fault;
    pid_t pid = -1;
    int port = 0, status = 0;
    std::string key, temporary;  // its TMPDIR
    bool has_ended = false;
  };
  bool hasEnded(Server& server) {
    if (!server.has_ended) server.has_ended = waitpid(server.pid, &server.status, WNOHANG) != 0;
    return server.has_ended;
  }
  Server serve(const std::string& fault) {
    Server server;
    server.fault = fault;
    server.temporary = log_.file("tmp" + std::to_string(++servers_));
    fs::create_directory(server.temporary);
    setenv("TMPDIR", server.temporary.c_str(), 1);
    // Another one may still write to those that have these names.
    for (const char* const name : {"out", "err"}) fs::remove(log_.file(name));
    server.pid = start({isobrickExtractWithFaults(), fault, "serve", "head.isb", "--threads", "1"});
    for (int n = 0; n < 20000 && !hasEnded(server); ++n) {
      const std::string said = readBytes(log_.file("out"));
      char key[64] = {};
      if (said.ends_with("\n") &&
          std::sscanf(said.c_str(), "http://127.0.0.1:%d/#token=%63s", &server.port, key) == 2) {
        server.key = key;
        return server;
      }
      sleepMillisecond();
    }
    return server;
  }
  // True if it ended, of itself or asked to, and by no signal.
  bool end(Server& server) {
    if (!hasEnded(server)) kill(server.pid, SIGTERM);
    for (int n = 0; n < 20000; ++n) {
      if (hasEnded(server)) return WIFEXITED(server.status);
      sleepMillisecond();
    }
    kill(server.pid, SIGKILL);
    waitpid(server.pid, &server.status, 0);
    return false;
  }
  static void sleepMillisecond() {
    const timespec millisecond = {0, 1000000};
    nanosleep(&millisecond, nullptr);
  }

  std::string head(const Server& server, const std::string& path) const {
    return "GET " + path + " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(server.port) +
           "\r\nAuthorization: Bearer " + server.key + "\r\n";
  }
  // The body of a good answer; "" for any other end.
  std::string get(const Server& server, const std::string& path) {
    for (int times = 0; times < 100; ++times) {
      Line line(server.port);
      line.say(head(server, path) + "Connection: close\r\n\r\n");
      const std::string head = line.until("\r\n\r\n"), body = line.toTheEnd();
      hangs_ = hangs_ || line.hangs();
      if (head.rfind("HTTP/1.1 202", 0) != 0) return head.rfind("HTTP/1.1 200", 0) == 0 ? body : "";
      sleepMillisecond();
    }
    return "";
  }
  // The triangles that a stream shows in the end; "" for any other end.
  std::string stream(const Server& server) {
    Line line(server.port);
    line.say(head(server, "/api/volume/0/stream") +
             "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
             "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
             "Sec-WebSocket-Protocol: isobrick.1, token." +
             server.key + "\r\n\r\n");
    std::string triangles;
    if (line.until("\r\n\r\n").rfind("HTTP/1.1 101", 0) != 0) return "";
    for (;;) {
      const std::string begin = line.bytes(2);
      if (begin.empty()) break;
      std::size_t length = static_cast<unsigned char>(begin[1]) & 127;
      if (length >= 126) {
        const std::string longer = line.bytes(length == 126 ? 2 : 8);
        length = 0;
        for (const char byte : longer) length = length << 8 | static_cast<unsigned char>(byte);
      }
      const std::string message = length > 0 ? line.bytes(length) : "";
      if ((begin[0] & 15) != 1) continue;
      const Json said = Json::parse(message, nullptr, false);
      const std::string type = said.is_object() ? said.value("type", "") : "";
      if (type == "volume") line.say(frame(R"({"type":"wish","wish":1,"surfaces":[{"iso":500}]})"));
      if (type == "show") {
        triangles = std::to_string(said["triangles"].get<std::uint64_t>());
        line.say(frame(R"({"type":"shown","seconds":0.001,"pass":)" +
                       std::to_string(said["pass"].get<std::uint64_t>()) + "}"));
      }
      if (type == "fine") return triangles;
      if (type == "error") break;
    }
    hangs_ = hangs_ || line.hangs();
    return "";
  }
  static std::string frame(const std::string& text) {
    std::string frame = "\x81";
    frame += static_cast<char>(128 | text.size());  // fewer than 126; masked with zeros
    return frame + std::string(4, '\0') + text;
  }

  // All that is asked for, as one text.
  std::string answers(const Server& server) {
    const auto sum = [](const std::string& body) {
      return std::to_string(body.size()) + ":" +
             std::to_string(checksum64(body.data(), body.size())) + " ";
    };
    return sum(get(server, "/api/volume/0")) +
           sum(get(server, "/api/volume/0/surface.ply?iso=500")) +
           sum(get(server, "/api/volume/0/slice.png?size=64")) + stream(server);
  }

  bool answersInTwoTries(const Server& server) {
    return answers(server) == expected_ || answers(server) == expected_;
  }

  // The numbers of calls of one kind that fail, each in a server of its own.
  struct Row {
    const char* kind;
    bool for_good;
    std::uint64_t calls;
    std::vector<std::uint64_t> numbers;
    int errors = 0, wrong = 0;
  };
  void tryEach(Row& row) {
    for (const std::uint64_t number : row.numbers) {
      Server server = serve(row.kind + (":" + std::to_string(number)) + (row.for_good ? "+" : ""));
      hangs_ = false;
      const bool is_whole = !server.key.empty() && answersInTwoTries(server);
      if (is_whole || server.key.empty() || row.for_good)
        judge(server, is_whole, row);
      else
        late_.emplace_back(std::move(server), &row);
      constexpr std::size_t kMostLate = 24;
      if (late_.size() == kMostLate) tryLateOnes();
    }
  }
  // A volume that could not be opened is tried again after 10 s: they wait for that together.
  void tryLateOnes() {
    if (late_.empty()) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(10100));
    for (auto& [server, row] : late_) {
      hangs_ = false;
      judge(server, answersInTwoTries(server), *row);
    }
    late_.clear();
  }
  // `is_whole`: in the end it answered as without the fault.
  void judge(Server& server, bool is_whole, Row& row) {
    row.errors += is_whole ? 0 : 1;
    const std::string what = wrongWith(server, is_whole, row.for_good);
    if (what.empty()) return;
    ++row.wrong;
    ADD_FAILURE() << server.fault << ": " << what << "\n" << readBytes(log_.file("err"));
  }
  std::string wrongWith(Server& server, bool is_whole, bool for_good) {
    const bool was_alive = !hasEnded(server), ended = end(server);
    if (server.key.empty()) {
      const std::string err = readBytes(log_.file("err"));
      if (!ended || WEXITSTATUS(server.status) != 1) return "does not begin, nor end with 1";
      if (err.rfind("isobrick: ", 0) != 0 || std::count(err.begin(), err.end(), '\n') != 1)
        return "does not say in one line why it does not begin";
    } else {
      if (!ended) return "dies, or does not end: " + std::to_string(server.status);
      if (hangs_) return "lets a client wait for ever";
      if (!was_alive && !for_good) return "ends";
      if (!is_whole && !for_good) return "never answers as without the fault";
    }
    // To remove a folder takes memory.
    const bool can_remove = !(for_good && server.fault.starts_with("alloc"));
    return can_remove && !fs::is_empty(server.temporary) ? "leaves temporary files" : "";
  }

  std::string expected_;  // the answers without a fault
  std::vector<std::pair<Server, Row*>> late_;
  int servers_ = 0;
  bool hangs_ = false;
};

TEST_F(ServeFaults, SaysSoAndGoesOn) {
  Server counted = serve("count:" + log_.file("counts"));
  ASSERT_FALSE(counted.key.empty()) << readBytes(log_.file("err"));
  expected_ = answers(counted);
  ASSERT_EQ(answers(counted), expected_);
  ASSERT_FALSE(expected_.ends_with(" ")) << "no stream";
  ASSERT_TRUE(end(counted));
  std::map<std::string, std::uint64_t> counts;
  std::ifstream in(log_.file("counts"));
  for (std::string kind; in >> kind;) in >> counts[kind];
  std::deque<Row> rows;  // which stay where they are
  for (const FaultKind kind : kFaultKinds)
    for (const bool for_good : {false, true}) {
      const bool at_night = environmentSays("ISOBRICK_ALL_FAULTS");
      const std::uint64_t most = at_night ? 200 : for_good ? 2 : 4;
      Row row{nameOf(kind), for_good, counts[nameOf(kind)], {}};
      for (std::uint64_t i = 1; i <= std::min(row.calls, most); ++i)
        row.numbers.push_back(row.calls <= most ? i : 1 + (i - 1) * (row.calls - 1) / (most - 1));
      tryEach(rows.emplace_back(std::move(row)));
    }
  tryLateOnes();
  for (const Row& row : rows)
    std::printf("serve: %s%s: %llu calls, %zu tried, %d errors, %d wrong\n", row.kind,
                row.for_good ? " for good" : "", static_cast<unsigned long long>(row.calls),
                row.numbers.size(), row.errors, row.wrong);
}

}  // namespace
}  // namespace isobrick::test
