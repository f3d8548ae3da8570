// The server in this process, and clients that ask, drag and leave at once. What one answer holds
// is tested by python/tests/test_serve.py; this is about threads: tests/house/tsan.sh.
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "isobrick/viewer/serve/serve.h"
#include "tests/support/two_balls.h"

namespace isobrick {
namespace {

// A connection to a port of this machine, which throws if nothing comes for a minute.
class PlainConnection {
 public:
  explicit PlainConnection(std::uint16_t port) : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval minute{60, 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &minute, sizeof minute);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      throw std::runtime_error("no connection");
  }
  ~PlainConnection() { close(socket_); }
  PlainConnection(const PlainConnection&) = delete;
  PlainConnection& operator=(const PlainConnection&) = delete;

  void send(const std::string& bytes) {
    if (::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL) != std::ssize(bytes))
      throw std::runtime_error("not sent");
  }
  // Fewer at the end of the connection.
  std::string read(std::size_t bytes) {
    std::string all(bytes, '\0');
    std::size_t count = 0;
    while (count < bytes) {
      const ssize_t more = recv(socket_, all.data() + count, bytes - count, 0);
      if (more < 0) throw std::runtime_error("nothing came");
      if (more == 0) break;
      count += static_cast<std::size_t>(more);
    }
    all.resize(count);
    return all;
  }

 private:
  const int socket_;
};

class ServerTest : public ::testing::Test {
 protected:
  ServerTest() {
    test::openTwoBalls(folder_);
    ServeOptions options;
    options.volumes = {{"one", folder_.file("field.isb")}, {"same", folder_.file("field.isb")}};
    options.threads = 2;
    options.cancel = &cancel_;
    std::promise<std::string> ready;
    options.on_ready = [&ready](const std::string& url) { ready.set_value(url); };
    server_ = std::async(std::launch::async, runServer, std::move(options));
    const std::string url = ready.get_future().get();  // "http://127.0.0.1:PORT/#token=KEY"
    host_ = url.substr(7, url.find("/#") - 7);
    port_ = static_cast<std::uint16_t>(std::stoi(host_.substr(host_.find(':') + 1)));
    key_ = url.substr(url.find('=') + 1);
  }
  ~ServerTest() override { cancel_.request(); }
  ServeSummary end() {
    cancel_.request();
    return server_.get();
  }

  std::string begin(const std::string& path) const {
    return "GET " + path + " HTTP/1.1\r\nHost: " + host_ + "\r\nAuthorization: Bearer " + key_ +
           "\r\n";
  }
  // Its status: 200.
  int get(const std::string& path) const {
    PlainConnection connection(port_);
    connection.send(begin(path) + "Connection: close\r\n\r\n");
    const int status = std::stoi(connection.read(12).substr(9));
    while (!connection.read(1 << 16).empty()) {
    }
    return status;
  }

  test::TemporaryFolder folder_;
  CancelFlag cancel_;
  std::future<ServeSummary> server_;
  std::string host_, key_;
  std::uint16_t port_ = 0;
};

// A client of the stream of a volume.
class StreamClient {
 public:
  StreamClient(std::uint16_t port, const std::string& request, const std::string& key)
      : connection_(port) {
    connection_.send(request +
                     "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                     "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
                     "Sec-WebSocket-Protocol: isobrick.1, token." +
                     key + "\r\n\r\n");
    std::string answer;
    for (std::string next = "."; !next.empty() && !answer.ends_with("\r\n\r\n"); answer += next)
      next = connection_.read(1);
    if (answer.find(" 101 ") == std::string::npos) throw std::runtime_error(answer);
  }
  // `more`: further members.
  void wish(int number, double isovalue, const std::string& more = "") {
    say(R"({"type":"wish","wish":)" + std::to_string(number) + more + R"(,"surfaces":[{"iso":)" +
        std::to_string(isovalue) + "}]}");
  }
  void say(const std::string& text) {
    if (text.size() > 125) throw std::logic_error("a longer length has another form");
    connection_.send(std::string{'\x81', static_cast<char>(0x80 | text.size())} +
                     std::string(4, '\0') + text);
  }
  // Leaves chunks and words of other types aside.
  nlohmann::json until(const std::string& type) {
    while (true) {
      const auto [is_text, bytes] = message();
      if (!is_text) continue;
      const nlohmann::json word = nlohmann::json::parse(bytes);
      if (word["type"] == "error") throw std::runtime_error(bytes);
      if (word["type"] == type) return word;
    }
  }

 private:
  std::pair<bool, std::string> message() {
    const std::string head = connection_.read(2);
    if (head.size() < 2) throw std::runtime_error("the server left");
    std::uint64_t size = static_cast<unsigned char>(head[1]);
    if (size > 125) {
      const std::string digits = connection_.read(size == 126 ? 2 : 8);
      size = 0;
      for (const char digit : digits) size = size << 8 | static_cast<unsigned char>(digit);
    }
    return {head[0] == '\x81', connection_.read(size)};
  }

  PlainConnection connection_;
};

TEST_F(ServerTest, ClientsAtOnceGetWhatTheyAskFor) {
  constexpr int kClients = 4, kWishes = 12;
  std::vector<std::future<void>> clients;
  for (int client = 0; client < kClients; ++client) {
    const std::string volume = "/api/volume/" + std::to_string(client % 2);
    clients.push_back(std::async(std::launch::async, [this, volume, client] {
      StreamClient stream(port_, begin(volume + "/stream"), key_);
      stream.until("volume");
      for (int number = 0; number < kWishes; ++number) {
        stream.wish(number, 0.1 * number);
        if (number % 3 == client % 3) stream.until("show");
      }
      // Half of them leave with a surface on its way.
      if (client < kClients / 2) {
        EXPECT_EQ(stream.until("fine")["wish"], kWishes - 1);
      }
    }));
    clients.push_back(std::async(std::launch::async, [this, volume] {
      for (const char* const path : {"/surface.ply?iso=0", "/slice.png", "", "/surface.glb?iso=3"})
        EXPECT_EQ(get(volume + path), 200) << path;
      for (const char* const path : {"/healthz", "/metrics", "/api/volumes"})
        EXPECT_EQ(get(path), 200) << path;
    }));
  }
  for (std::future<void>& client : clients) client.get();
  const ServeSummary summary = end();
  EXPECT_EQ(summary.clients, std::uint64_t{kClients});
  EXPECT_EQ(summary.refused, 0u);
  EXPECT_GT(summary.chunks, 0u);
}

TEST_F(ServerTest, VolumesComeIntoASceneAndLeaveIt) {
  constexpr int kTimes = 12;
  std::vector<std::future<void>> clients;
  for (int client = 0; client < 3; ++client)
    clients.push_back(std::async(std::launch::async, [this, client] {
      StreamClient stream(port_, begin("/api/volume/0/stream"), key_);
      for (int number = 0; number < kTimes; ++number) {
        stream.wish(2 * number, 0.1 * number);
        stream.wish(2 * number + 1, 0.2 * number, R"(,"volume":1)");
        if (number % 3 == client) stream.until("show");
        stream.say(R"({"type":"end","volume":1})");
        EXPECT_EQ(stream.until("ended")["volume"], 1);
      }
      stream.wish(2 * kTimes, 0.0, R"(,"volume":1)");
      stream.wish(2 * kTimes + 1, 0.0);
      std::set<int> fine;
      while (fine != std::set{2 * kTimes, 2 * kTimes + 1})
        fine.insert(stream.until("fine")["wish"].get<int>());
    }));
  for (std::future<void>& client : clients) client.get();
  EXPECT_EQ(end().refused, 0u);
}

TEST_F(ServerTest, EndsWithClientsThatAreStillServed) {
  std::vector<std::unique_ptr<StreamClient>> clients;
  for (int client = 0; client < 3; ++client) {
    clients.push_back(std::make_unique<StreamClient>(port_, begin("/api/volume/0/stream"), key_));
    clients.back()->until("volume");
    clients.back()->wish(1, 0.0);
  }
  EXPECT_EQ(end().clients, 3u);
}

}  // namespace
}  // namespace isobrick
