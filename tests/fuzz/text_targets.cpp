// Texts: views, scripts, options and addresses of users; answers of servers; messages of clients.
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <glm/common.hpp>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote/http_answer.h"
#include "isobrick/storage/remote/http_transfers.h"
#include "isobrick/storage/remote/s3_object.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/serve/access.h"
#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/serve/client_message.h"
#include "isobrick/viewer/serve/served_volumes.h"
#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/stream/plane_sampler.h"
#include "tests/fuzz/fuzz_target.h"
#include "tools/parse_text.h"

namespace isobrick::test {
namespace {

std::string textOf(FuzzBytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// ---- views and scripts

void runView(FuzzBytes bytes) {
  const FuzzFolder folder({{"", textOf(bytes)}}, "a.json");
  const SavedView view = readView(folder.files().front());
  const std::string text = viewStateToJson(view.state);
  demand(viewStateToJson(viewStateFromJson(text)) == text, "a view that was read can be saved");
  bounded(view.state, ViewVolume());
}

void runScript(FuzzBytes bytes) {
  ScriptPlayer player(viewScriptFromJson(textOf(bytes)));
  ViewState state;
  for (int frame = 0; frame < 100; ++frame) {
    const ScriptFrame next = player.next(frame, {true, true}, state);
    if (next.finished) break;
    if (next.state) state = *next.state;
  }
}

// ---- options

template <typename... Parse>
void tryEach(const std::string& text, Parse... parse) {
  const auto attempt = [&](auto one) {
    try {
      one(text);
    } catch (const std::invalid_argument&) {
    }
  };
  (attempt(parse), ...);
}

void runOption(FuzzBytes bytes) {
  tryEach(
      textOf(bytes), parseNumber, parseSingle, parsePoint, parseIndex3, parseNumbers, parseByteSize,
      parseLabel, parseLabels, parseShare, parseCorners, parsePixelSize,
      [](const std::string& text) { parsePrintSize(text).pixels(300); }, parseColor,
      [](std::string text) { takeLengthUnit(text); },
      [](const std::string& text) { parseInteger(text, -5, 1000); });
}

// An address, and the text of a file with keys.
void runAddress(FuzzBytes bytes) {
  const std::vector<FuzzFile> files = filesOf(bytes);
  const std::string& url = files.front().bytes;
  const std::string shown = withoutSecrets(url);
  if (isRemotePath(url) && !isBucketPath(url))
    demand(shown.find('?') == std::string::npos, "messages show no query");
  S3Surroundings surroundings{[](const std::string&) { return std::string(); },
                              [&](const std::string&) { return files.back().bytes; }};
  HttpRequest request;
  S3Object(url, findS3Account(surroundings)).address(request);
}

// ---- a hostile server

// Answers each connection with the next of some texts, whatever is asked, and closes it.
class HostileServer {
 public:
  HostileServer() : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof address;
    const auto generic = reinterpret_cast<sockaddr*>(&address);
    if (::bind(socket_, generic, length) != 0 || ::listen(socket_, 16) != 0 ||
        ::getsockname(socket_, generic, &length) != 0)
      throw std::runtime_error("no server");
    // As a proxy it gets all requests, those that a redirect sends elsewhere too.
    const std::string url = "http://127.0.0.1:" + std::to_string(ntohs(address.sin_port));
    for (const char* const name : {"http_proxy", "https_proxy", "all_proxy"})
      ::setenv(name, url.c_str(), 1);
    ::unsetenv("no_proxy");
    thread_ = std::thread([this] { serve(); });
  }
  ~HostileServer() {
    ::shutdown(socket_, SHUT_RDWR);
    thread_.join();
    ::close(socket_);
  }

  void answerBy(std::vector<FuzzFile> answers) {
    const std::lock_guard lock(mutex_);
    answers_ = std::move(answers);
    next_ = 0;
  }

 private:
  void serve() {
    for (int client; (client = ::accept(socket_, nullptr, nullptr)) >= 0; ::close(client)) {
      const timeval second{1, 0};
      ::setsockopt(client, SOL_SOCKET, SO_RCVTIMEO, &second, sizeof second);
      std::string request;
      char some[4096];
      for (ssize_t got; request.find("\r\n\r\n") == std::string::npos &&
                        (got = ::recv(client, some, sizeof some, 0)) > 0;)
        request.append(some, static_cast<std::size_t>(got));
      const std::lock_guard lock(mutex_);
      const std::string& answer = answers_[std::min(next_++, answers_.size() - 1)].bytes;
      ::send(client, answer.data(), answer.size(), MSG_NOSIGNAL);
    }
  }

  const int socket_;
  std::mutex mutex_;  // guards the two below
  std::vector<FuzzFile> answers_{{"", ""}};
  std::size_t next_ = 0;
  std::thread thread_;
};

// One request for 64 bytes, judged as a file's first and as a later one.
class HostileAnswer : public HttpClient {
 public:
  static constexpr std::uint64_t kBytes = 64;

  std::optional<HttpRequest> nextRequest(std::chrono::milliseconds*) override {
    if (is_asked_) return std::nullopt;
    is_asked_ = true;
    HttpRequest request;
    request.url = "http://isobrick.test/a.isb";
    request.last = kBytes - 1;
    return request;
  }
  bool onHead(std::uint64_t, const HttpHead& head) override {
    RemoteFile file;
    judgeFirstAnswerOfEnd(head, kBytes, file);
    const HttpVerdict verdict = judgeFirstAnswer(head, 0, kBytes - 1, file);
    if (verdict.kind != HttpVerdict::Kind::kGood) {
      demand(!verdict.text.empty() && verdict.wait_seconds <= 30, "a refusal says why");
      return false;
    }
    demand(file.bytes > 0, "an answer is of a file");
    wanted_ = std::min(file.bytes, kBytes);
    if (wanted_ == kBytes)
      demand(judgeAnswer(head, 0, kBytes - 1, file).kind == HttpVerdict::Kind::kGood,
             "the same answer is of the same file");
    sameFileHeaders(file);
    return true;
  }
  bool onBytes(std::uint64_t, std::span<const std::byte> bytes) override {
    demand(wanted_ > 0, "bytes come behind a head");
    wanted_ -= std::min<std::uint64_t>(wanted_, bytes.size());
    return wanted_ > 0;
  }
  void onEnd(std::uint64_t, const HttpEnd& end) override {
    demand(end.is_whole || end.was_refused || !end.text.empty(), "a failure says why");
    const std::lock_guard lock(mutex_);
    has_ended_ = true;
    changed_.notify_all();
  }
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return has_ended_; });
  }

 private:
  bool is_asked_ = false;
  std::uint64_t wanted_ = 0;
  std::mutex mutex_;  // guards the next one
  bool has_ended_ = false;
  std::condition_variable changed_;
};

void runHttp(FuzzBytes bytes) {
  static HostileServer server;
  static HttpTransfers transfers(1);
  server.answerBy(filesOf(bytes));
  HostileAnswer client;
  transfers.enter(client);
  transfers.wake();
  client.wait();
  transfers.leave(client);
}

// ---- serve

void runMessage(FuzzBytes bytes) {
  ViewVolume volume;
  volume.voxels = {100, 50, 20};
  const ClientMessage message = parseClientMessage(Asked::ofMessage(textOf(bytes)), volume);
  const auto* const wish = std::get_if<ClientWish>(&message);
  if (wish == nullptr) return;
  demand(wish->surfaces.surfaces.size() <= kMostWishedSurfaces, "surfaces are bounded");
  demand(wish->surfaces.radius >= 1 && wish->surfaces.radius <= volume.diagonal(),
         "the radius is bounded");
  for (const auto& surface : wish->surfaces.surfaces)
    demand(surface.isovalue >= volume.least_value && surface.isovalue <= volume.greatest_value,
           "isovalues are those of the volume");
}

// The target of a request, and its headers Host, Origin and Authorization, a line each.
void runRequest(FuzzBytes bytes) {
  std::vector<std::string> lines(1);
  for (const std::uint8_t byte : bytes)
    if (byte == '\n' && lines.size() < 4)
      lines.emplace_back();
    else
      lines.back() += static_cast<char>(byte);
  lines.resize(4);
  static const std::string kKey = "0123456789abcdef0123456789abcdef";
  static const Access access(kKey, {"https://scans.example.org"});
  demand(!access.isAuthorized(lines[3]) || lines[3] == "Bearer " + kKey, "the key alone opens");
  access.isOwnHost(lines[1], "127.0.0.1:8080");
  demand(!access.isAllowedOrigin(lines[2], lines[1]) || lines[2].empty() ||
             lines[2] == "https://scans.example.org" || lines[2].starts_with("http://"),
         "no other origin is allowed");
  const std::string& target = lines[0];
  const std::size_t end = std::min(target.size(), target.find('?'));
  const auto path = volumePathOf(std::string_view(target).substr(0, end));
  demand(!path || path->rest.empty() || path->rest.front() == '/', "a path ends at a '/'");
  const Asked asked =
      Asked::ofAddress(std::string_view(target).substr(std::min(target.size(), end + 1)));
  asked.normalized();
  asked.integer("size", 16, 2048);
  asked.text("axis");
  asked.flag("visible");
  asked.pair("window");
  const auto corner = asked.point("corner"), across = asked.point("across");
  const auto along = asked.point("along");
  if (!corner || !across || !along) return;
  constexpr double kFar = 1 << 30;  // as the server bounds it
  for (const glm::dvec3& part : {*corner, *across, *along})
    if (glm::any(glm::greaterThan(glm::abs(part), glm::dvec3(kFar)))) return;
  static const Pyramid pyramid(ISOBRICK_FUZZ_CORPUS "/isb/u8-zstd");
  const IndexPlane plane{*corner, *across, *along};
  const PlaneSampling sampling = samplingOf(pyramid.lattice(), plane, 64);
  const SliceImage values = samplePlane(pyramid, plane, sampling, CancelFlag());
  drawSlice(values, asked.pair("window").value_or(std::array{0.0, 1.0}), {}, 1.5);
}

constexpr FuzzTarget kTable[] = {
    {"json", "view", "viewer/state/(view_file|view_state)", runView},
    {"json", "script", "viewer/session/view_script", runScript},
    {"json", "option", "tools/parse_text", runOption},
    {"json", "address", "storage/(remote_options|remote/s3_object)", runAddress},
    {"json", "http", "storage/remote/(http_transfers|http_answer)", runHttp},
    {"serve", "message", "viewer/serve/(client_message|asked)", runMessage},
    {"serve", "request", "viewer/serve/(access|asked)|viewer/stream/plane_sampler", runRequest},
};

}  // namespace

constinit const std::span<const FuzzTarget> kTextTargets = kTable;

}  // namespace isobrick::test
