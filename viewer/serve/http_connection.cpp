// A connection of HTTP: every request is checked here before anything is done for it.
#include <sys/socket.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <functional>
#include <initializer_list>
#include <memory>
#include <new>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/serve/http_state.h"
#include "isobrick/viewer/serve/page_files.h"
#include "isobrick/viewer/serve/volume_answers.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {
namespace {

namespace beast = boost::beast;
namespace http = boost::beast::http;
using AnswerJson = nlohmann::ordered_json;
using HttpError = boost::system::error_code;
using Field = http::field;
using Status = http::status;

// Beside those of all answers.
using Fields = std::initializer_list<std::pair<Field, std::string_view>>;

constexpr std::size_t kMostHeaderBytes = 8 << 10;
// A request waits so long for its volume to be opened; who asks again may wait longer.
constexpr auto kLongestWait = std::chrono::seconds(20);
constexpr auto kBetweenLooks = std::chrono::milliseconds(50);
constexpr std::string_view kTextType = "text/plain; charset=utf-8";
constexpr char kNoSuchName[] = "there is nothing of this name";

// A request that gets a line of text in place of what it asks for.
struct Refusal {
  Status status;
  std::string why;
};

void require(bool is_so, Status status, const char* why) {
  if (!is_so) throw Refusal{status, why};
}

std::string_view textOf(beast::string_view text) { return {text.data(), text.size()}; }
beast::string_view beastText(std::string_view text) { return {text.data(), text.size()}; }

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

class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(boost::asio::ip::tcp::socket socket, ServerState& state)
      : state_(state), stream_(std::move(socket)), timer_(state.io) {
    ++state_.connections;
  }
  ~HttpConnection() { --state_.connections; }

  void read() {
    is_foreign_ = false;
    parser_.emplace();
    parser_->header_limit(kMostHeaderBytes);
    parser_->body_limit(0);
    stream_.expires_after(std::chrono::seconds(kRequestSeconds));
    http::async_read(
        stream_, buffer_, *parser_,
        [self = shared_from_this()](HttpError error, std::size_t) { self->onRead(error); });
  }

 private:
  using Then = std::function<void(HttpConnection&)>;
  using Opened = std::shared_ptr<const OpenedVolume>;
  using WithVolume = std::function<void(HttpConnection&, const Opened&)>;

  void onRead(HttpError error) {
    if (!error) {
      request_ = parser_->release();
      ++state_.counted.requests;
      return doOrRefuse(Status::bad_request, &HttpConnection::answer);
    }
    if (error == http::error::end_of_stream || error == beast::error::timeout ||
        error.category() != http::make_error_code(http::error::header_limit).category())
      return;
    request_ = {};
    request_.keep_alive(false);
    refuse(error == http::error::header_limit ? Status::request_header_fields_too_large
           : error == http::error::body_limit || error == http::error::unexpected_body
               ? Status::payload_too_large
               : Status::bad_request,
           "the request is not understood");
  }

  void doOrRefuse(Status otherwise, const Then& what) try {
    what(*this);
  } catch (const Refusal& refusal) {
    refuse(refusal.status, refusal.why);
  } catch (const std::exception& failure) {
    refuse(otherwise, failureWords(failure));
  }

  std::string_view header(Field name) const { return textOf(request_[name]); }
  bool isHead() const { return request_.method() == http::verb::head; }

  void answer() {
    const std::string_view origin = header(Field::origin), host = header(Field::host);
    HttpError error;
    const auto local = stream_.socket().local_endpoint(error);
    require(!error && state_.access.isOwnHost(host, hostText(local)), Status::forbidden,
            "the server has another name; open the address that it printed, or start it with "
            "--origin");
    is_foreign_ = state_.access.isForeign(origin);
    require(state_.access.isAllowedOrigin(origin, host), Status::forbidden,
            "a page from there may not ask this server");
    std::string_view path = textOf(request_.target());
    require(path.starts_with(state_.options.base_path), Status::not_found, kNoSuchName);
    path.remove_prefix(state_.options.base_path.size());
    const std::size_t end = std::min(path.size(), path.find('?'));
    const std::string_view words = path.substr(std::min(path.size(), end + 1));
    path = path.substr(0, end);
    if (request_.method() == http::verb::options && is_foreign_)
      return reply(Status::no_content, kTextType, "",
                   {{Field::access_control_allow_methods, "GET"},
                    {Field::access_control_allow_headers, "Authorization, If-None-Match"},
                    {Field::access_control_max_age, "600"}});
    require(request_.method() == http::verb::get || isHead(), Status::method_not_allowed,
            "this server answers GET and HEAD alone");
    if (path == "/healthz") return reply(Status::ok, kTextType, "ok\n");
    if (path != "/metrics" && !path.starts_with("/api/")) return sendPageFile(path);
    const auto of_volume = volumePathOf(path);
    const bool is_stream = of_volume && of_volume->rest == "/stream";
    require(is_stream ? state_.access.isKey(keyOfProtocols(request_[Field::sec_websocket_protocol]))
                      : state_.access.isAuthorized(header(Field::authorization)),
            Status::unauthorized,
            "the key is missing or wrong; open the address that the server printed");
    if (path == "/metrics") return reply(Status::ok, kTextType, metrics());
    if (path == "/api/volumes") return sendList();
    require(of_volume && of_volume->volume < state_.volumes.count(), Status::not_found,
            kNoSuchName);
    if (is_stream) return beginStream(of_volume->volume);
    answerVolume(*of_volume, words);
  }

  void answerVolume(const VolumePath& path, std::string_view words) {
    if (path.rest.empty()) return sendFacts(path.volume);
    if (path.rest == "/slice.png") return sendSlice(path.volume, Asked::ofAddress(words));
    for (const char* const extension : {".glb", ".ply", ".stl"})
      if (path.rest == std::string("/surface") + extension)
        return sendSurface(path.volume, Asked::ofAddress(words), extension);
    throw Refusal{Status::not_found, kNoSuchName};
  }

  void sendPageFile(std::string_view path) {
    const std::string name(path.size() <= 1 ? "index.html" : path.substr(1));
    const PageFile* const plain = pageFile(name);
    require(plain != nullptr, Status::not_found,
            hasPage() ? kNoSuchName
                      : "this build has no page, but serves streams: docs/SERVE.md says how to "
                        "build it");
    const PageFile* const packed = pageFile(name + ".gz");
    const bool takes_packed =
        packed != nullptr && header(Field::accept_encoding).find("gzip") != std::string_view::npos;
    const std::pair kept{Field::cache_control, std::string_view("no-cache")};
    const std::pair varies{Field::vary, std::string_view("Accept-Encoding")};
    if (!takes_packed) return reply(Status::ok, typeOf(name), plain->bytes, {kept, varies});
    reply(Status::ok, typeOf(name), packed->bytes,
          {kept, varies, {Field::content_encoding, "gzip"}});
  }

  void sendList() {
    AnswerJson volumes = AnswerJson::array();
    for (std::size_t volume = 0; volume < state_.volumes.count(); ++volume)
      volumes.push_back(state_.volumes.entryOf(volume));
    replyJson(Status::ok, {{"protocol", 1},
                           {"version", ISOBRICK_VERSION},
                           {"steps", state_.options.are_steps},
                           {"volumes", std::move(volumes)}});
  }

  // The volume, or null: it begins to be opened.
  Opened openedVolume(std::size_t volume) {
    std::string error;
    const auto opened = state_.volumes.open(volume, error);
    require(error.empty(),
            state_.volumes.isFailed(volume) ? Status::internal_server_error
                                            : Status::service_unavailable,
            error.c_str());
    return opened;
  }

  // `what` with the volume, once it is open.
  void whenOpen(std::size_t volume, const WithVolume& what) {
    whenOpenBy(std::chrono::steady_clock::now() + kLongestWait, volume, what);
  }
  void whenOpenBy(std::chrono::steady_clock::time_point end, std::size_t volume,
                  const WithVolume& what) {
    if (!state_.volumes.isOpening(volume))
      if (const auto opened = openedVolume(volume)) return what(*this, opened);
    require(std::chrono::steady_clock::now() < end, Status::service_unavailable,
            "the volume is still being opened or built; ask again");
    require(state_.waiting < kMostWaiting, Status::service_unavailable,
            "too many requests wait for volumes that are being opened; try again later");
    stream_.expires_never();
    timer_.expires_after(kBetweenLooks);
    timer_.async_wait([self = shared_from_this(), end, volume, what](HttpError stopped) {
      --self->state_.waiting;
      if (stopped || self->hasLeft()) return;
      self->doOrRefuse(Status::bad_request, [&](HttpConnection& connection) {
        connection.whenOpenBy(end, volume, what);
      });
    });
    ++state_.waiting;
  }

  // The client ended the connection, and has not asked for more before.
  bool hasLeft() {
    char next = 0;
    const auto bytes = ::recv(stream_.socket().native_handle(), &next, 1, MSG_PEEK | MSG_DONTWAIT);
    return bytes == 0 || (bytes < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
  }

  void sendFacts(std::size_t volume) {
    if (openedVolume(volume) != nullptr)
      return replyJson(Status::ok, state_.volumes.factsOf(volume));
    replyJson(Status::accepted, state_.volumes.entryOf(volume));
  }

  void beginStream(std::size_t volume) {
    require(beast::websocket::is_upgrade(request_), Status::upgrade_required,
            "this is a WebSocket");
    require(state_.clients.size() < kMostClients, Status::too_many_requests,
            "too many clients; try again later");
    startStreamConnection(std::move(stream_), request_, volume, state_);
  }

  // A pyramid that is not open is opened for the slice alone, since a list of volumes shows slices.
  void sendSlice(std::size_t volume, const Asked& words) {
    const SlicePictureOrder order = slicePictureOrder(words);
    const bool builds = words.integer("build", 0, 1) != 0;
    const Opened opened = state_.volumes.find(volume);
    if (opened != nullptr || isPyramidFile(state_.volumes.pathOf(volume)))
      return drawSlice(volume, order, opened);
    require(builds, Status::conflict, "the volume is not open yet");
    whenOpen(volume, [volume, order](HttpConnection& self, const Opened& now_open) {
      self.drawSlice(volume, order, now_open);
    });
  }

  void drawSlice(std::size_t volume, const SlicePictureOrder& order, Opened opened) {
    constexpr std::uint64_t kMemory = std::uint64_t{64} << 20;
    if (opened != nullptr) planeOf(order, *opened->file);  // refused before it waits
    const std::string path = state_.volumes.pathOf(volume);
    run(state_.slices, [opened, path, order, &state = state_]() mutable -> Then {
      if (opened == nullptr)
        opened = std::make_shared<const OpenedVolume>(
            openPyramid(path, kMemory, state.options.remote, &state.stop));
      try {
        planeOf(order, *opened->file);
      } catch (const Error& failure) {
        throw Refusal{Status::bad_request, failure.what()};
      }
      return [picture = slicePicture(*opened->file, order, state.stop)](HttpConnection& self) {
        self.reply(Status::ok, typeOf(".png"), picture);
      };
    });
  }

  void sendSurface(std::size_t volume, const Asked& words, const std::string& extension) {
    const SurfaceFileOrder order = surfaceFileOrder(words, extension);
    whenOpen(volume, [order, words, extension](HttpConnection& self, const Opened& opened) {
      self.writeSurface(order, words, extension, opened);
    });
  }

  void writeSurface(const SurfaceFileOrder& order, const Asked& words, const std::string& extension,
                    const Opened& opened) {
    const std::string tag = surfaceTag(*opened, words, extension);
    if (header(Field::if_none_match) == tag)
      return reply(Status::not_modified, typeOf(extension), "", {{Field::etag, tag}});
    const std::string path = newFile() + extension;
    run(state_.surfaces, [opened, order, path, tag, &state = state_]() -> Then {
      tbb::task_arena arena(state.options.threads);
      arena.execute([&] { writeSurfaceFile(*opened->file, order, path, state.stop); });
      return [path, tag](HttpConnection& self) { self.sendFile(path, tag); };
    });
  }

  void sendFile(const std::string& path, const std::string& tag) {
    http::file_body::value_type file;
    HttpError error;
    file.open(path.c_str(), beast::file_mode::scan, error);
    removeName(path);
    require(!error, Status::internal_server_error, "the surface was lost before it was sent");
    send<http::file_body>(Status::ok, typeOf(path), std::move(file),
                          {{Field::etag, tag}, {Field::cache_control, "private, no-cache"}});
  }

  std::string newFile() {
    if (state_.folder.empty()) {
      std::string name = (temporaryFolder() / "isobrick-serve-XXXXXX").string();
      if (mkdtemp(name.data()) == nullptr) throw Error("cannot make a folder for the surface");
      state_.folder = name;
    }
    return state_.folder + "/" + std::to_string(++state_.last_file);
  }

  // What a job leaves. It is made before the job, which then needs no memory to hand it over.
  struct Done {
    std::shared_ptr<HttpConnection> connection;
    Then then;
    std::exception_ptr failure;
  };

  // `work` on the queue's thread, then what it returns here.
  template <typename Work>
  void run(JobQueue& queue, Work work) {
    require(queue.jobs < queue.most_jobs, Status::service_unavailable,
            "too much is asked for already; try again later");
    stream_.expires_never();
    const auto done = std::make_shared<Done>(Done{shared_from_this(), nullptr, nullptr});
    boost::asio::post(queue.thread,
                      [done, work = std::move(work), &queue, &state = state_]() mutable {
                        try {
                          done->then = work();
                        } catch (...) {
                          done->failure = std::current_exception();
                        }
                        handBack(done, queue, state);
                      });
    ++queue.jobs;
  }

  // On the queue's thread, which waits if there is no memory for that.
  static void handBack(const std::shared_ptr<Done>& done, JobQueue& queue, ServerState& state) {
    do try {
        return boost::asio::post(state.io, [done, &queue] {
          --queue.jobs;
          const auto connection = std::move(done->connection);  // it ends on this thread
          connection->doOrRefuse(Status::internal_server_error, [&](HttpConnection& self) {
            if (done->failure) std::rethrow_exception(done->failure);
            done->then(self);
          });
        });
      } catch (const std::bad_alloc&) {
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    while (!state.stop.requested());
  }

  std::string metrics() const {
    const auto& counted = state_.counted;
    const std::pair<std::string, std::uint64_t> rows[] = {
        {"requests_total", counted.requests},         {"requests_refused_total", counted.refused},
        {"clients_total", counted.clients},           {"wishes_total", counted.wishes},
        {"chunks_sent_total", counted.chunks},        {"bytes_sent_total", counted.bytes},
        {"clients", state_.clients.size()},           {"connections", state_.connections},
        {"open_volumes", state_.volumes.openCount()},
    };
    std::string text;
    for (const auto& [name, value] : rows)
      text += "# TYPE isobrick_" + name + (name.ends_with("_total") ? " counter" : " gauge") +
              "\nisobrick_" + name + " " + std::to_string(value) + "\n";
    return text;
  }

  void reply(Status status, std::string_view type, std::string_view text, Fields fields = {}) {
    send<http::string_body>(status, type, std::string(text), fields);
  }
  void replyJson(Status status, const AnswerJson& json) {
    reply(status, typeOf(".json"), jsonText(json));
  }
  void refuse(Status status, const std::string& error) {
    ++state_.counted.refused;
    replyJson(status, {{"error", error}});
  }

  // A piece at a time, so that a slow client has time and one that takes nothing has not.
  template <typename Body>
  struct Sending {
    explicit Sending(http::response<Body> given) : response(std::move(given)) {}
    http::response<Body> response;
    http::response_serializer<Body> serializer{response};
  };
  template <typename Body>
  void send(Status status, std::string_view type, typename Body::value_type body, Fields fields) {
    http::response<Body> response(status, request_.version(), std::move(body));
    response.keep_alive(request_.keep_alive());
    response.set(Field::content_type, beastText(type));
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
    if (status == Status::accepted || status == Status::service_unavailable)
      response.set(Field::retry_after, "1");
    if (status == Status::unauthorized) response.set(Field::www_authenticate, "Bearer");
    if (status == Status::method_not_allowed) response.set(Field::allow, "GET, HEAD");
    for (const auto& [name, value] : fields) response.set(name, beastText(value));
    response.prepare_payload();
    const auto sending = std::make_shared<Sending<Body>>(std::move(response));
    sending->serializer.split(isHead());
    sendSome(sending);
  }
  template <typename Body>
  void sendSome(const std::shared_ptr<Sending<Body>>& sending) {
    stream_.expires_after(std::chrono::seconds(kIdleSeconds));
    http::async_write_some(
        stream_, sending->serializer,
        [self = shared_from_this(), sending](HttpError error, std::size_t bytes) {
          self->state_.counted.bytes += bytes;
          if (error) return;
          auto& serializer = sending->serializer;
          if (!(self->isHead() ? serializer.is_header_done() : serializer.is_done()))
            return self->sendSome(sending);
          if (!sending->response.need_eof()) return self->read();
          HttpError ignored;
          self->stream_.socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
        });
  }

  ServerState& state_;
  beast::tcp_stream stream_;
  beast::flat_buffer buffer_{2 * kMostHeaderBytes};
  std::optional<http::request_parser<http::empty_body>> parser_;
  HttpRequest request_;
  boost::asio::steady_timer timer_;
  bool is_foreign_ = false;
};

}  // namespace

void startHttpConnection(boost::asio::ip::tcp::socket socket, ServerState& state) {
  std::make_shared<HttpConnection>(std::move(socket), state)->read();
}

}  // namespace isobrick
