// The WebSocket of a client: docs/SERVE.md, "The stream".
#include <algorithm>
#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/field.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <deque>
#include <exception>
#include <limits>
#include <utility>
#include <variant>
#include <vector>

#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/serve/http_state.h"
#include "isobrick/viewer/serve/surface_session.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = boost::beast::websocket;
using StreamError = boost::system::error_code;

// On its way to a client; what waits beyond it can still be replaced.
constexpr std::size_t kMostOnTheWay = 16 << 10;
// Of messages of all kinds: who takes none of so many is gone.
constexpr std::size_t kMostMessages = 4096;
constexpr auto kBetweenMessages = std::chrono::milliseconds(4);
constexpr double kBetweenLooks = 0.05;  // at an opening, seconds
constexpr int kMostLeaving = 4;

// The surfaces of one volume of the client's scene.
struct VolumeStream {
  std::size_t volume = 0;
  bool is_first = false;  // the connection is for it, and ends with it
  double looked_at = 0.0;
  std::optional<Asked> early = {};  // the last wish before the volume was open
  std::shared_ptr<SurfaceSession> session = {};
};

}  // namespace

class StreamConnection : public ClientLine, public std::enable_shared_from_this<StreamConnection> {
 public:
  StreamConnection(beast::tcp_stream stream, std::size_t volume, ServerState& state)
      : state_(state),
        volume_(volume),
        socket_(std::move(stream)),
        timer_(state.io),
        pause_(state.io) {
    state_.clients.insert(this);
    ++state_.connections;
  }
  ~StreamConnection() override {
    end();
    --state_.connections;
  }

  // Nothing more is done for the client. The session's end may take a while.
  void end() {
    if (ended_) return;
    ended_ = closing_ = true;
    timer_.cancel();
    pause_.cancel();
    beast::get_lowest_layer(socket_).close();
    state_.clients.erase(this);
    for (VolumeStream& stream : streams_) leave(std::move(stream.session));
  }

  void start(const HttpRequest& request) {
    beast::get_lowest_layer(socket_).expires_never();
    websocket::stream_base::timeout limits{std::chrono::seconds(kRequestSeconds),
                                           std::chrono::seconds(kIdleSeconds), true};
    socket_.set_option(limits);
    socket_.set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
      response.set(beast::http::field::sec_websocket_protocol, "isobrick.1");
    }));
    socket_.read_message_max(kMostMessageBytes);
    socket_.auto_fragment(false);
    socket_.async_accept(request, [self = shared_from_this()](StreamError error) {
      if (error) return self->end();
      ++self->state_.counted.clients;
      self->orEnd([&] {
        self->streams_.push_back({self->volume_, true});
        self->read();
        self->update();
      });
    });
  }

  void sendWord(const nlohmann::ordered_json& word) override {
    const std::string text = jsonText(word);
    const auto* const bytes = reinterpret_cast<const std::byte*>(text.data());
    send({false, {bytes, bytes + text.size()}});
  }
  void sendChunk(std::vector<std::byte> packet) override {
    ++state_.counted.chunks;
    send({true, std::move(packet)});
  }
  bool hasRoom() const override { return on_the_way_ < kMostOnTheWay; }

  void close(websocket::close_code code, const std::string& why) {
    if (closing_) return;
    closing_ = true;
    orEnd([&] {
      // At most so many bytes go into a control frame.
      const websocket::close_reason reason(code, why.substr(0, 120));
      socket_.async_close(reason, [self = shared_from_this()](StreamError) { self->end(); });
    });
  }

 private:
  struct Message {
    bool is_binary = false;
    std::vector<std::byte> bytes;
  };

  // The session's end may wait for an extraction.
  void leave(std::shared_ptr<SurfaceSession> session) try {
    ++*leaving_;
    const auto counted =
        std::shared_ptr<void>(nullptr, [leaving = leaving_](void*) { --*leaving; });
    asio::post(state_.ends, [counted, session = std::move(session)]() mutable { session.reset(); });
  } catch (const std::exception&) {  // it ended at once, and all waited for that
  }

  // False: it is not open yet. Throws Error if it cannot be opened.
  bool open(VolumeStream& stream) {
    if (clockSeconds() - stream.looked_at < kBetweenLooks || *leaving_ > kMostLeaving) return false;
    stream.looked_at = clockSeconds();
    std::string error;
    const auto opened = state_.volumes.open(stream.volume, error);
    if (!error.empty()) throw Error(error);
    if (opened == nullptr && messages_.empty())
      sendTyped("opening", state_.volumes.entryOf(stream.volume));
    if (opened == nullptr) return false;
    // Threads of an extraction have news; one word of it is on its way at a time.
    const auto is_told = std::make_shared<std::atomic<bool>>(false);
    const auto on_news = [self = weak_from_this(), is_told, &io = state_.io] {
      if (is_told->exchange(true)) return;
      try {
        asio::post(io, [self, is_told] {
          is_told->store(false);
          if (const auto connection = self.lock()) connection->update();
        });
      } catch (const std::exception&) {
        is_told->store(false);  // the next word is to go
        throw;
      }
    };
    stream.session = std::make_shared<SurfaceSession>(
        opened, static_cast<std::uint32_t>(stream.volume), state_.options.threads, *this, on_news);
    sendTyped("volume", state_.volumes.factsOf(stream.volume));
    if (const auto early = std::exchange(stream.early, std::nullopt)) take(*early, stream);
    return true;
  }

  void fail(VolumeStream& stream, const std::string& error) {
    orEnd([&] {
      sendTyped("error", {{"volume", stream.volume}, {"error", error}, {"ended", true}});
      if (stream.is_first) close(websocket::close_code::internal_error, error);
    });
    leave(std::move(stream.session));
  }

  // A client that something cannot be done for would wait for ever.
  template <typename What>
  void orEnd(const What& what) try {
    what();
  } catch (const std::exception&) {
    end();
  }

  void read() {
    socket_.async_read(buffer_, [self = shared_from_this()](StreamError error, std::size_t) {
      self->orEnd([&] { self->onRead(error); });
    });
  }

  void onRead(StreamError error) {
    if (error || ended_) return end();
    const std::string text = beast::buffers_to_string(buffer_.data());
    buffer_.clear();
    take(text);
    if (ended_) return;
    const auto now = std::chrono::steady_clock::now();
    const bool is_soon = now - last_message_ < kBetweenMessages;
    last_message_ = now;
    if (!is_soon) return read();
    pause_.expires_after(kBetweenMessages);
    pause_.async_wait([self = shared_from_this()](StreamError stopped) {
      if (!stopped) self->read();
    });
  }

  void take(const std::string& text) try {
    if (closing_) return;
    const Asked asked = Asked::ofMessage(text);
    const std::string type = asked.text("type");
    const auto named = asked.integer("volume", 0, static_cast<int>(state_.volumes.count()) - 1);
    const std::size_t volume = named ? static_cast<std::size_t>(*named) : volume_;
    auto stream = std::ranges::find(streams_, volume, &VolumeStream::volume);
    if (type == "end") {
      if (stream == streams_.end()) return;
      leave(std::move(stream->session));
      streams_.erase(stream);
      return sendTyped("ended", {{"volume", volume}});
    }
    if (stream == streams_.end()) {
      if (type != "open" && type != "wish") return;
      stream = streams_.insert(stream, {volume});
    }
    if (stream->session != nullptr)
      take(asked, *stream);
    else if (type == "wish")
      stream->early = asked;
    update();
  } catch (const Error& failure) {
    close(websocket::close_code::policy_error, failure.what());
  }

  void take(const Asked& asked, VolumeStream& stream) try {
    const ClientMessage message = parseClientMessage(asked, stream.session->volume());
    if (std::holds_alternative<ClientWish>(message)) ++state_.counted.wishes;
    stream.session->take(message);
  } catch (const Error& failure) {
    close(websocket::close_code::policy_error, failure.what());
  }

  // Each volume in its turn is the first to get room on the line.
  void update() {
    orEnd([&] {
      std::optional<double> again;
      if (!streams_.empty()) std::rotate(streams_.begin(), streams_.begin() + 1, streams_.end());
      for (std::size_t i = 0; i < streams_.size() && !closing_;)
        if (goesOn(streams_[i], again))
          ++i;
        else
          streams_.erase(streams_.begin() + static_cast<std::ptrdiff_t>(i));
      if (again && !closing_) return after(*again, [](StreamConnection& self) { self.update(); });
      timer_.cancel();
    });
  }

  // False: it is over. `again`: the seconds after which one wants to go on.
  bool goesOn(VolumeStream& stream, std::optional<double>& again) try {
    const bool is_open = stream.session != nullptr || open(stream);
    if (closing_) return true;
    const auto soon = is_open ? stream.session->update() : std::optional(kBetweenLooks);
    if (soon) again = std::min(again.value_or(*soon), *soon);
    return true;
  } catch (const std::exception& failure) {
    fail(stream, failureWords(failure));
    return false;
  }

  // `what` takes the place of what the timer was to do.
  template <typename What>
  void after(double seconds, What what) {
    timer_.expires_after(std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 * seconds)));
    timer_.async_wait([self = shared_from_this(), what](StreamError stopped) {
      if (!stopped) self->orEnd([&] { what(*self); });
    });
  }

  void sendTyped(const char* type, nlohmann::ordered_json json) {
    json["type"] = type;
    sendWord(json);
  }

  void send(Message message) {
    if (ended_) return;
    if (messages_.size() >= kMostMessages) return breakOff();
    on_the_way_ += message.bytes.size();
    messages_.push_back(std::move(message));
    if (messages_.size() == 1) write();
  }

  // The read under way says so.
  void breakOff() {
    closing_ = true;
    beast::get_lowest_layer(socket_).close();
  }

  void write() try {
    const Message& message = messages_.front();
    socket_.binary(message.is_binary);
    socket_.async_write(asio::buffer(message.bytes.data(), message.bytes.size()),
                        [self = shared_from_this()](StreamError error, std::size_t bytes) {
                          self->orEnd([&] { self->onWritten(error, bytes); });
                        });
  } catch (const std::exception&) {  // beast takes no other message after that
    breakOff();
  }

  void onWritten(StreamError error, std::size_t bytes) {
    state_.counted.bytes += bytes;
    if (error) return end();
    on_the_way_ -= messages_.front().bytes.size();
    messages_.pop_front();
    if (!messages_.empty()) write();
    update();
  }

  ServerState& state_;
  const std::size_t volume_;
  websocket::stream<beast::tcp_stream> socket_;
  asio::steady_timer timer_, pause_;
  beast::flat_buffer buffer_{kMostMessageBytes};
  std::chrono::steady_clock::time_point last_message_;
  std::deque<Message> messages_;  // the first one is being written
  std::size_t on_the_way_ = 0;    // bytes of them
  std::vector<VolumeStream> streams_;
  // Sessions that have not ended yet: a client that opens and ends in turn gets no more than these.
  const std::shared_ptr<std::atomic<int>> leaving_ = std::make_shared<std::atomic<int>>(0);
  bool closing_ = false, ended_ = false;
};

void startStreamConnection(beast::tcp_stream stream, const HttpRequest& request, std::size_t volume,
                           ServerState& state) {
  std::make_shared<StreamConnection>(std::move(stream), volume, state)->start(request);
}

void closeStreams(ServerState& state) {
  for (auto client = state.clients.begin(); client != state.clients.end();)
    (*client++)->close(websocket::close_code::going_away, "the server ends");  // or it goes at once
}

void endStreams(ServerState& state) {
  while (!state.clients.empty()) (*state.clients.begin())->end();
}

}  // namespace isobrick
