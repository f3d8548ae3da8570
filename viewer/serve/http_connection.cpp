// A connection of HTTP: every request is checked here before anything is done for it.
#include <tbb/task_arena.h>

#include <array>
#include <boost/asio/post.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/viewer/serve/http_state.h"
#include "isobrick/viewer/serve/page_files.h"
#include "isobrick/viewer/serve/url_query.h"
#include "isobrick/viewer/serve/volume_answers.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {
namespace {

namespace beast = boost::beast;
namespace http = boost::beast::http;
using AnswerJson = nlohmann::ordered_json;
using HttpError = boost::system::error_code;

constexpr std::size_t kMostHeaderBytes = 8 << 10;
// A client that takes nothing of an answer for so long is gone.
constexpr auto kStalledAfter = std::chrono::seconds(kIdleSeconds);
constexpr std::string_view kJsonType = "application/json", kTextType = "text/plain; charset=utf-8";

std::string_view textOf(beast::string_view text) { return {text.data(), text.size()}; }

std::string_view typeOf(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, std::string_view>, 10> kTypes{{
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".wasm", "application/wasm"},
      {".glb", "model/gltf-binary"},
      {".stl", "model/stl"},
      {".ply", "application/octet-stream"},
      {".ico", "image/x-icon"},
  }};
  const std::size_t dot = name.rfind('.');
  if (dot == std::string_view::npos) return kTextType;
  for (const auto& [ending, type] : kTypes)
    if (name.substr(dot) == ending) return type;
  return kTextType;
}

const PageFile* pageFile(std::string_view name) {
  for (const PageFile& file : pageFiles())
    if (file.name == name) return &file;
  return nullptr;
}

std::string localHost(const beast::tcp_stream& stream) {
  HttpError error;
  const auto local = stream.socket().local_endpoint(error);
  return error ? std::string() : hostText(local);
}

// The key among "isobrick.1, token.KEY"; empty: not this protocol.
std::string keyOfProtocols(beast::string_view protocols) {
  constexpr std::string_view kPrefix = "token.";
  std::string key;
  bool is_known = false;
  for (const beast::string_view word : http::token_list{protocols}) {
    if (textOf(word) == "isobrick.1") is_known = true;
    if (textOf(word).substr(0, kPrefix.size()) == kPrefix)
      key = textOf(word).substr(kPrefix.size());
  }
  return is_known ? key : std::string();
}

class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(boost::asio::ip::tcp::socket socket, ServerState& state)
      : state_(state), stream_(std::move(socket)) {
    ++state_.connections;
  }
  ~HttpConnection() { --state_.connections; }

  void read() {
    parser_.emplace();
    parser_->header_limit(kMostHeaderBytes);
    parser_->body_limit(0);
    stream_.expires_after(std::chrono::seconds(kRequestSeconds));
    http::async_read(
        stream_, buffer_, *parser_,
        [self = shared_from_this()](HttpError error, std::size_t) { self->onRead(error); });
  }

 private:
  void onRead(HttpError error) {
    if (!error) {
      request_ = parser_->release();
      ++state_.counted.requests;
      try {
        return answer();
      } catch (const std::exception& failure) {
        return refuse(http::status::bad_request, failureWords(failure));
      }
    }
    if (error == http::error::end_of_stream || error == beast::error::timeout ||
        error.category() != http::make_error_code(http::error::header_limit).category())
      return;
    request_ = {};
    request_.keep_alive(false);
    refuse(error == http::error::header_limit ? http::status::request_header_fields_too_large
           : error == http::error::body_limit || error == http::error::unexpected_body
               ? http::status::payload_too_large
               : http::status::bad_request,
           "the request is not understood");
  }

  std::string_view header(http::field field) const { return textOf(request_[field]); }

  // Throws Error for a wrong parameter.
  void answer() {
    const std::string_view host = header(http::field::host), origin = header(http::field::origin);
    if (!state_.access.isOwnHost(host, localHost(stream_)))
      return refuse(http::status::forbidden,
                    "the server has another name; open the address that "
                    "it printed, or start it with --origin");
    is_foreign_ = state_.access.isForeign(origin);
    if (!state_.access.isAllowedOrigin(origin, host))
      return refuse(http::status::forbidden, "a page from there may not ask this server");

    std::string_view path = textOf(request_.target());
    const std::string& base = state_.options.base_path;
    if (path.substr(0, base.size()) != base)
      return refuse(http::status::not_found, "there is nothing of this name");
    path.remove_prefix(base.size());
    const std::string_view whole = path;
    path = path.substr(0, path.find('?'));
    const UrlQuery words(whole.substr(std::min(whole.size(), path.size() + 1)));

    if (request_.method() == http::verb::options && is_foreign_) return allowForeign();
    if (request_.method() != http::verb::get)
      return refuse(http::status::method_not_allowed, "this server answers GET alone");
    if (path == "/healthz") return reply(http::status::ok, kTextType, "ok\n");
    const bool is_private = path == "/metrics" || path.substr(0, 5) == "/api/";
    if (!is_private) return sendPageFile(path);
    const auto of_volume = volumePathOf(path);
    const bool is_stream = of_volume && of_volume->rest == "/stream";
    const bool has_key =
        is_stream
            ? state_.access.isKey(keyOfProtocols(request_[http::field::sec_websocket_protocol]))
            : state_.access.isAuthorized(header(http::field::authorization));
    if (!has_key)
      return refuse(http::status::unauthorized,
                    "the key is missing or wrong; open the address "
                    "that the server printed");
    if (path == "/metrics") return reply(http::status::ok, kTextType, metrics());
    if (path == "/api/volumes") return sendList();
    if (!of_volume || of_volume->volume >= state_.volumes.count())
      return refuse(http::status::not_found, "there is nothing of this name");
    if (is_stream) return beginStream(of_volume->volume);
    answerVolume(*of_volume, words);
  }

  void answerVolume(const VolumePath& path, const UrlQuery& words) {
    constexpr std::string_view kSurface = "/surface";
    std::string error;
    const auto opened = path.rest.empty() ? state_.volumes.open(path.volume, error)
                                          : state_.volumes.find(path.volume);
    const AnswerJson entry = state_.volumes.entryOf(path.volume);
    if (!error.empty()) return refuse(http::status::internal_server_error, error);
    if (path.rest.empty())
      return opened != nullptr
                 ? replyJson(http::status::ok, factsOf(path.volume, entry["name"], *opened))
                 : replyJson(http::status::accepted, entry);
    const std::string extension(path.rest.substr(std::min(path.rest.size(), kSurface.size())));
    const bool is_surface = path.rest.substr(0, kSurface.size()) == kSurface &&
                            (extension == ".glb" || extension == ".ply" || extension == ".stl");
    if (!is_surface && path.rest != "/slice.png")
      return refuse(http::status::not_found, "there is nothing of this name");
    if (!is_surface) return sendSlice(path.volume, opened, words);
    if (opened == nullptr) return refuseClosed();
    sendSurface(opened, words, extension);
  }

  void sendPageFile(std::string_view path) {
    if (!path.empty()) path.remove_prefix(1);
    const std::string name(path.empty() ? "index.html" : path);
    const PageFile* const plain = pageFile(name);
    if (plain == nullptr)
      return refuse(http::status::not_found,
                    hasPage() ? "there is nothing of this name"
                              : "this build has no page, but serves streams: docs/SERVE.md says "
                                "how to build it");
    const PageFile* const packed = pageFile(name + ".gz");
    const bool takes_packed =
        packed != nullptr &&
        header(http::field::accept_encoding).find("gzip") != std::string_view::npos;
    auto response = begin<http::string_body>(http::status::ok, typeOf(name));
    response.body() = takes_packed ? packed->bytes : plain->bytes;
    if (takes_packed) response.set(http::field::content_encoding, "gzip");
    response.set(http::field::vary, "Accept-Encoding");
    response.set(http::field::cache_control, "no-cache");
    send(std::move(response));
  }

  void sendList() {
    AnswerJson volumes = AnswerJson::array();
    for (std::size_t volume = 0; volume < state_.volumes.count(); ++volume)
      volumes.push_back(state_.volumes.entryOf(volume));
    replyJson(http::status::ok,
              {{"protocol", 1}, {"version", ISOBRICK_VERSION}, {"volumes", std::move(volumes)}});
  }

  void beginStream(std::size_t volume) {
    if (!beast::websocket::is_upgrade(request_))
      return refuse(http::status::upgrade_required, "this is a WebSocket");
    if (state_.clients.size() >= kMostClients)
      return refuse(http::status::too_many_requests, "too many clients; try again later");
    startStreamConnection(std::move(stream_), request_, volume, state_);
  }

  void refuseClosed() {
    refuse(http::status::conflict, "the volume is not open yet; ask for it first");
  }

  // Of a pyramid that is not open too, as a list of volumes shows it: opened for that alone.
  void sendSlice(std::size_t volume, const std::shared_ptr<const OpenedVolume>& opened,
                 const UrlQuery& words) {
    constexpr std::uint64_t kMemory = std::uint64_t{64} << 20;
    const std::string path = state_.volumes.pathOf(volume);
    if (opened == nullptr && !isPyramidFile(path)) return refuseClosed();
    std::optional<SlicePictureOrder> order;
    if (opened != nullptr) order = slicePictureOrder(words, *opened->file);
    run(
        state_.slices,
        [opened, order, path, words, &state = state_] {
          if (order) return slicePicture(*opened->file, *order, state.stop);
          const OpenedVolume closed = openPyramid(path, kMemory, state.options.remote, &state.stop);
          return slicePicture(*closed.file, slicePictureOrder(words, *closed.file), state.stop);
        },
        [](HttpConnection& self, std::string picture) {
          self.reply(http::status::ok, typeOf(".png"), std::move(picture));
        });
  }

  void sendSurface(const std::shared_ptr<const OpenedVolume>& opened, const UrlQuery& words,
                   const std::string& extension) {
    const SurfaceFileOrder order = surfaceFileOrder(words, extension);
    const std::string tag = surfaceTag(*opened, words, extension);
    if (header(http::field::if_none_match) == tag) {
      auto response = begin<http::empty_body>(http::status::not_modified, typeOf(extension));
      response.set(http::field::etag, tag);
      return send(std::move(response));
    }
    const std::string path = newFile() + extension;
    run(
        state_.surfaces,
        [opened, order, path, &state = state_] {
          tbb::task_arena arena(state.options.threads);
          arena.execute([&] { writeSurfaceFile(*opened->file, order, path, state.stop); });
          return path;
        },
        [tag, extension](HttpConnection& self, const std::string& made) {
          self.sendFile(made, typeOf(extension), tag);
        });
  }

  void sendFile(const std::string& path, std::string_view type, const std::string& tag) {
    auto response = begin<http::file_body>(http::status::ok, type);
    HttpError error;
    response.body().open(path.c_str(), beast::file_mode::scan, error);
    removeName(path);
    if (error) return refuse(http::status::internal_server_error, error.message());
    response.set(http::field::etag, tag);
    response.set(http::field::cache_control, "private, no-cache");
    send(std::move(response));
  }

  std::string newFile() {
    if (state_.folder.empty()) {
      std::string name = (temporaryFolder() / "isobrick-serve-XXXXXX").string();
      if (mkdtemp(name.data()) == nullptr) throw Error("cannot make a folder for the surface");
      state_.folder = name;
    }
    return state_.folder + "/" + std::to_string(++state_.last_file);
  }

  // `work` on a thread of the queue, then `take` its result here.
  template <typename Work, typename Take>
  void run(JobQueue& queue, Work work, Take take) {
    stream_.expires_never();
    auto job = [self = shared_from_this(), &io = state_.io, work = std::move(work),
                take = std::move(take)]() mutable {
      using Result = decltype(work());
      std::optional<Result> result;
      std::string error;
      try {
        result = work();
      } catch (const std::exception& failure) {
        error = failureWords(failure);
      }
      boost::asio::post(io, [self = std::move(self), take = std::move(take),
                             result = std::move(result), error = std::move(error)]() mutable {
        if (result)
          take(*self, std::move(*result));
        else
          self->refuse(http::status::internal_server_error, error);
      });
    };
    if (queue.add(std::move(job))) return;
    refuse(http::status::service_unavailable, "too much is asked for already; try again later");
  }

  void allowForeign() {
    auto response = begin<http::empty_body>(http::status::no_content, kTextType);
    response.set(http::field::access_control_allow_methods, "GET");
    response.set(http::field::access_control_allow_headers, "Authorization, If-None-Match");
    response.set(http::field::access_control_max_age, "600");
    send(std::move(response));
  }

  std::string metrics() const {
    const auto& counted = state_.counted;
    const std::array<std::pair<const char*, std::uint64_t>, 9> rows{{
        {"isobrick_requests_total", counted.requests},
        {"isobrick_requests_refused_total", counted.refused},
        {"isobrick_clients_total", counted.clients},
        {"isobrick_wishes_total", counted.wishes},
        {"isobrick_chunks_sent_total", counted.chunks},
        {"isobrick_bytes_sent_total", counted.bytes},
        {"isobrick_clients", state_.clients.size()},
        {"isobrick_connections", state_.connections},
        {"isobrick_open_volumes", state_.volumes.openCount()},
    }};
    std::string text;
    for (const auto& [name, value] : rows) {
      const bool is_total = std::string_view(name).find("_total") != std::string_view::npos;
      text += std::string("# TYPE ") + name + (is_total ? " counter\n" : " gauge\n") + name + " " +
              std::to_string(value) + "\n";
    }
    return text;
  }

  template <typename Body>
  http::response<Body> begin(http::status status, std::string_view type) const {
    http::response<Body> response(status, request_.version());
    response.keep_alive(request_.keep_alive());
    response.set(http::field::content_type, beast::string_view(type.data(), type.size()));
    response.set("X-Content-Type-Options", "nosniff");
    response.set("Referrer-Policy", "no-referrer");
    response.set("Cross-Origin-Resource-Policy", "same-origin");
    response.set("Content-Security-Policy", state_.access.contentPolicy());
    response.set(http::field::cache_control, "no-store");
    if (is_foreign_) {
      response.set(http::field::access_control_allow_origin, request_[http::field::origin]);
      response.set(http::field::access_control_expose_headers, "ETag");
      response.set(http::field::vary, "Origin");
    }
    return response;
  }

  void reply(http::status status, std::string_view type, std::string text) {
    auto response = begin<http::string_body>(status, type);
    response.body() = std::move(text);
    if (status == http::status::service_unavailable) response.set(http::field::retry_after, "1");
    if (status == http::status::unauthorized) response.set(http::field::www_authenticate, "Bearer");
    send(std::move(response));
  }
  void replyJson(http::status status, const AnswerJson& json) {
    reply(status, kJsonType, json.dump(-1, ' ', false, AnswerJson::error_handler_t::replace));
  }
  void refuse(http::status status, const std::string& error) {
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
  void send(http::response<Body> response) {
    response.prepare_payload();
    sendSome(std::make_shared<Sending<Body>>(std::move(response)));
  }
  template <typename Body>
  void sendSome(const std::shared_ptr<Sending<Body>>& sending) {
    stream_.expires_after(kStalledAfter);
    http::async_write_some(
        stream_, sending->serializer,
        [self = shared_from_this(), sending](HttpError error, std::size_t bytes) {
          self->state_.counted.bytes += bytes;
          if (error) return;
          if (!sending->serializer.is_done()) return self->sendSome(sending);
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
  bool is_foreign_ = false;
};

}  // namespace

void startHttpConnection(boost::asio::ip::tcp::socket socket, ServerState& state) {
  std::make_shared<HttpConnection>(std::move(socket), state)->read();
}

}  // namespace isobrick
