// A connection of HTTP: every request is checked here before anything is done for it.
#include <sys/socket.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <cerrno>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/serve/http_state.h"
#include "isobrick/viewer/serve/page_files.h"
#include "isobrick/viewer/serve/volume_answers.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using AnswerJson = nlohmann::ordered_json;
using HttpError = boost::system::error_code;
using Field = http::field;
using Opened = ServedVolumes::Opened;

constexpr std::size_t kMostHeaderBytes = 8 << 10;
// A request waits so long for its volume to be opened; who asks again may wait longer.
constexpr auto kLongestWait = std::chrono::seconds(20);
constexpr std::string_view kTextType = "text/plain; charset=utf-8";
constexpr char kNoSuchName[] = "there is nothing of this name";

struct Answer {
  unsigned status = 200;
  std::string_view type = kTextType;
  std::string text = {};
  std::vector<std::pair<Field, std::string>> fields = {};  // beside those of all answers
  std::optional<http::file_body::value_type> file = {};    // in place of the text
};

std::string_view textOf(beast::string_view text) { return {text.data(), text.size()}; }

// By the ending of a name.
std::string_view typeOf(std::string_view name) {
  constexpr std::pair<std::string_view, std::string_view> kTypes[] = {
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".json", "application/json"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".glb", "model/gltf-binary"},
      {".stl", "model/stl"},
      {".ply", "application/octet-stream"},
  };
  for (const auto& [ending, type] : kTypes)
    if (name.ends_with(ending)) return type;
  return kTextType;
}

const PageFile* pageFile(std::string_view name) {
  for (const PageFile& file : pageFiles())
    if (file.name == name) return &file;
  return nullptr;
}

// The key among "isobrick.1, token.KEY"; empty: not this protocol.
std::string keyOfProtocols(beast::string_view protocols) {
  constexpr std::string_view kPrefix = "token.";
  std::string key;
  bool is_known = false;
  for (const beast::string_view word : http::token_list{protocols}) {
    is_known = is_known || textOf(word) == "isobrick.1";
    if (textOf(word).starts_with(kPrefix)) key = textOf(word).substr(kPrefix.size());
  }
  return is_known ? key : std::string();
}

class HttpConnection : public ServedConnection {
 public:
  HttpConnection(asio::ip::tcp::socket socket, ServerState& state)
      : ServedConnection(state), stream_(std::move(socket)) {}
  void end() override { stream_.close(); }

  Task serve() {
    Answer answer;
    do {
      try {
        if (!co_await read()) co_return;
        answer = co_await answerOf();
      } catch (const Refusal& refusal) {
        answer = refused(refusal.status, refusal.what());
      } catch (const std::exception& failure) {
        answer = refused(500, failureWords(failure));
      }
      if (streamed_)
        co_return startStream(std::move(stream_), std::move(request_), *streamed_, state_);
      if (answer.file)
        co_await send<http::file_body>(answer, std::move(*answer.file));
      else
        co_await send<http::string_body>(answer, std::move(answer.text));
    } while (goes_on_);
    HttpError ignored;
    stream_.socket().shutdown(asio::ip::tcp::socket::shutdown_send, ignored);
  }

 private:
  // False: the client is gone.
  asio::awaitable<bool> read() {
    request_ = {};
    is_foreign_ = false;
    http::request_parser<http::empty_body> parser;
    parser.header_limit(kMostHeaderBytes);
    parser.body_limit(0);
    stream_.expires_after(kRequestTime);
    HttpError error;
    co_await http::async_read(stream_, buffer_, parser,
                              asio::redirect_error(asio::use_awaitable, error));
    if (error) {
      const bool is_of_http =
          error.category() == http::make_error_code(http::error::header_limit).category();
      if (!is_of_http || error == http::error::end_of_stream) co_return false;
      request_.keep_alive(false);
      throw Refusal(error == http::error::header_limit ? 431
                    : error == http::error::body_limit || error == http::error::unexpected_body
                        ? 413
                        : 400,
                    "the request is not understood");
    }
    request_ = parser.release();
    ++state_.counted.requests;
    co_return true;
  }

  std::string_view header(Field name) const { return textOf(request_[name]); }
  bool isHead() const { return request_.method() == http::verb::head; }

  asio::awaitable<Answer> answerOf() {
    const std::string_view origin = header(Field::origin), host = header(Field::host);
    require(state_.access.isOwnHost(host, hostText(stream_.socket().local_endpoint())), 403,
            "the server has another name; open the address that it printed, or start it with "
            "--origin");
    is_foreign_ = state_.access.isForeign(origin);
    require(state_.access.isAllowedOrigin(origin, host), 403,
            "a page from there may not ask this server");
    std::string_view path = textOf(request_.target());
    require(path.starts_with(state_.options.base_path), 404, kNoSuchName);
    path.remove_prefix(state_.options.base_path.size());
    const std::size_t end = std::min(path.size(), path.find('?'));
    const std::string_view words = path.substr(std::min(path.size(), end + 1));
    path = path.substr(0, end);
    if (request_.method() == http::verb::options && is_foreign_) {
      Answer allowed{204};
      allowed.fields = {{Field::access_control_allow_methods, "GET"},
                        {Field::access_control_allow_headers, "Authorization, If-None-Match"},
                        {Field::access_control_max_age, "600"}};
      co_return allowed;
    }
    require(request_.method() == http::verb::get || isHead(), 405,
            "this server answers GET and HEAD alone");
    if (path == "/healthz") co_return Answer{200, kTextType, "ok\n"};
    if (path != "/metrics" && !path.starts_with("/api/")) co_return pageFileAnswer(path);
    const auto of_volume = volumePathOf(path);
    const bool is_stream = of_volume && of_volume->rest == "/stream";
    require(is_stream ? state_.access.isKey(keyOfProtocols(request_[Field::sec_websocket_protocol]))
                      : state_.access.isAuthorized(header(Field::authorization)),
            401, "the key is missing or wrong; open the address that the server printed");
    if (path == "/metrics") co_return Answer{200, kTextType, metrics()};
    if (path == "/api/volumes") co_return list();
    require(of_volume && of_volume->volume < state_.volumes.count(), 404, kNoSuchName);
    const std::size_t volume = of_volume->volume;
    if (is_stream) {
      require(beast::websocket::is_upgrade(request_), 426, "this is a WebSocket");
      require(state_.clients < kMostClients, 429, "too many clients; try again later");
      streamed_ = volume;
      co_return Answer();
    }
    if (of_volume->rest.empty()) {
      if (state_.volumes.open(volume) != nullptr)
        co_return jsonAnswer(200, state_.volumes.factsOf(volume));
      co_return jsonAnswer(202, state_.volumes.entryOf(volume));
    }
    if (of_volume->rest == "/slice.png") co_return co_await slice(volume, Asked::ofAddress(words));
    for (const char* const extension : {".glb", ".ply", ".stl"})
      if (of_volume->rest == std::string("/surface") + extension)
        co_return co_await surface(volume, Asked::ofAddress(words), extension);
    throw Refusal(404, kNoSuchName);
  }

  Answer pageFileAnswer(std::string_view path) const {
    const std::string name(path.size() <= 1 ? "index.html" : path.substr(1));
    const PageFile* const plain = pageFile(name);
    require(plain != nullptr, 404,
            hasPage() ? kNoSuchName
                      : "this build has no page, but serves streams: docs/SERVE.md says how to "
                        "build it");
    const PageFile* const packed = pageFile(name + ".gz");
    const bool takes_packed =
        packed != nullptr && header(Field::accept_encoding).find("gzip") != std::string_view::npos;
    Answer answer{200, typeOf(name), std::string((takes_packed ? packed : plain)->bytes)};
    answer.fields = {{Field::cache_control, "no-cache"}, {Field::vary, "Accept-Encoding"}};
    if (takes_packed) answer.fields.emplace_back(Field::content_encoding, "gzip");
    return answer;
  }

  Answer list() const {
    AnswerJson volumes = AnswerJson::array();
    for (std::size_t volume = 0; volume < state_.volumes.count(); ++volume)
      volumes.push_back(state_.volumes.entryOf(volume));
    return jsonAnswer(200, {{"protocol", 1}, {"version", ISOBRICK_VERSION}, {"volumes", volumes}});
  }

  // The volume, once it is open.
  asio::awaitable<Opened> opened(std::size_t volume) {
    Opened result = state_.volumes.open(volume);
    if (result != nullptr) co_return result;
    require(state_.waiting < kMostWaiting, 503,
            "too many requests wait for volumes that are being opened; try again later");
    const auto waits = counted(state_.waiting);
    const auto end = std::chrono::steady_clock::now() + kLongestWait;
    while (result == nullptr) {
      require(std::chrono::steady_clock::now() < end, 503,
              "the volume is still being opened or built; ask again");
      co_await pause(kBetweenLooks);
      require(!hasLeft() && !state_.stop.requested(), 503, "nobody waits for it any longer");
      result = state_.volumes.open(volume);
    }
    co_return result;
  }

  // The client ended the connection, and has not asked for more before.
  bool hasLeft() {
    char next = 0;
    const auto bytes = ::recv(stream_.socket().native_handle(), &next, 1, MSG_PEEK | MSG_DONTWAIT);
    return bytes == 0 || (bytes < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
  }

  // `work` on the queue's thread.
  Task onThread(JobQueue& queue, std::function<void()> work) {
    require(queue.jobs < queue.most_jobs, 503, "too much is asked for already; try again later");
    const auto job = counted(queue.jobs);
    const auto task = [&]() -> Task {
      state_.stop.check();
      work();
      co_return;
    };
    co_await asio::co_spawn(queue.thread, task, asio::use_awaitable);
  }

  // A pyramid that is not open is opened for the slice alone, since a list of volumes shows slices.
  asio::awaitable<Answer> slice(std::size_t volume, Asked words) {
    const SlicePicture picture = slicePictureOf(words);
    const bool builds = words.integer("build", 0, 1) != 0;
    const std::string& path = state_.volumes.pathOf(volume);
    Opened shown = state_.volumes.find(volume);
    if (shown == nullptr && !isPyramidFile(path)) {
      require(builds, 409, "the volume is not open yet");
      shown = co_await opened(volume);
    }
    Answer answer{200, typeOf(".png")};
    const auto draw = [&] {
      constexpr std::uint64_t kMemory = std::uint64_t{64} << 20;
      const auto file = shown != nullptr
                            ? shown->file
                            : openPyramid(path, kMemory, state_.options.remote, &state_.stop).file;
      answer.text = picture(*file, state_.stop);
    };
    co_await onThread(state_.slices, draw);
    co_return answer;
  }

  asio::awaitable<Answer> surface(std::size_t volume, Asked words, std::string extension) {
    const SurfaceFile write = surfaceFileOf(words, extension);
    const Opened shown = co_await opened(volume);
    Answer answer{200, typeOf(extension)};
    const std::string tag = surfaceTag(*shown, words, extension);
    answer.fields.emplace_back(Field::etag, tag);
    if (header(Field::if_none_match) == tag) {
      answer.status = 304;
      co_return answer;
    }
    answer.fields.emplace_back(Field::cache_control, "private, no-cache");
    std::string folder = (temporaryFolder() / "isobrick-serve-XXXXXX").string();
    if (mkdtemp(folder.data()) == nullptr) throw Error("cannot make a folder for the surface");
    // A path, not a text: to remove it takes no memory.
    const std::shared_ptr<void> end(
        nullptr, [path = std::filesystem::path(folder)](void*) { removeTree(path); });
    const std::string path = folder + "/surface" + extension;
    const auto work = [&] {
      tbb::task_arena arena(state_.options.threads);
      arena.execute([&] { write(*shown->file, path, state_.stop); });
    };
    co_await onThread(state_.surfaces, work);
    HttpError error;
    answer.file.emplace().open(path.c_str(), beast::file_mode::scan, error);
    require(!error, 500, "the surface was lost before it was sent");
    co_return answer;
  }

  std::string metrics() const {
    const auto& counted = state_.counted;
    const std::pair<std::string, std::uint64_t> rows[] = {
        {"requests_total", counted.requests},
        {"requests_refused_total", counted.refused},
        {"clients_total", counted.clients},
        {"wishes_total", counted.wishes},
        {"chunks_sent_total", counted.chunks},
        {"bytes_sent_total", counted.bytes},
        {"clients", state_.clients},
        {"connections", state_.connections.size()},
        {"open_volumes", state_.volumes.openCount()},
    };
    std::string text;
    for (const auto& [name, value] : rows)
      text += "# TYPE isobrick_" + name + (name.ends_with("_total") ? " counter" : " gauge") +
              "\nisobrick_" + name + " " + std::to_string(value) + "\n";
    return text;
  }

  static Answer jsonAnswer(unsigned status, const AnswerJson& json) {
    return {status, typeOf(".json"), jsonText(json)};
  }
  Answer refused(unsigned status, const std::string& error) {
    ++state_.counted.refused;
    return jsonAnswer(status, {{"error", error}});
  }

  // A piece at a time, so that a slow client has time and one that takes nothing has not.
  template <typename Body>
  Task send(const Answer& answer, typename Body::value_type body) {
    http::response<Body> response(http::int_to_status(answer.status), request_.version(),
                                  std::move(body));
    response.keep_alive(request_.keep_alive());
    response.set(Field::content_type, std::string(answer.type));
    response.set("X-Content-Type-Options", "nosniff");
    response.set("Referrer-Policy", "no-referrer");
    response.set("Cross-Origin-Resource-Policy", "same-origin");
    response.set("Content-Security-Policy", state_.access.contentPolicy());
    response.set(Field::cache_control, "no-store");
    if (is_foreign_) {
      response.set(Field::access_control_allow_origin, request_[Field::origin]);
      response.set(Field::access_control_expose_headers, "ETag");
      response.set(Field::vary, "Origin");
    }
    if (answer.status == 202 || answer.status == 503) response.set(Field::retry_after, "1");
    if (answer.status == 401) response.set(Field::www_authenticate, "Bearer");
    if (answer.status == 405) response.set(Field::allow, "GET, HEAD");
    for (const auto& [name, value] : answer.fields) response.set(name, value);
    response.prepare_payload();
    goes_on_ = !response.need_eof();
    http::response_serializer<Body> serializer{response};
    serializer.split(isHead());
    while (!(isHead() ? serializer.is_header_done() : serializer.is_done())) {
      stream_.expires_after(kIdleTime);
      const std::size_t bytes =
          co_await http::async_write_some(stream_, serializer, asio::use_awaitable);
      state_.counted.bytes += bytes;
    }
  }

  beast::tcp_stream stream_;
  beast::flat_buffer buffer_{2 * kMostHeaderBytes};
  HttpRequest request_;
  bool is_foreign_ = false, goes_on_ = true;
  std::optional<std::size_t> streamed_;  // the volume of a stream that this becomes
};

}  // namespace

Task serveConnection(asio::ip::tcp::socket socket, ServerState& state) {
  HttpConnection connection(std::move(socket), state);
  co_await connection.serve();
}

}  // namespace isobrick
