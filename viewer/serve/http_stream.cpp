// The WebSocket of a client: docs/SERVE.md, "The stream".
#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/field.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <exception>
#include <new>
#include <variant>

#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/serve/http_state.h"
#include "isobrick/viewer/serve/surface_session.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = boost::beast::websocket;
using Clock = std::chrono::steady_clock;
using SocketError = boost::system::error_code;

// On its way to a client; what waits beyond it can still be replaced.
constexpr std::size_t kMostOnTheWay = 16 << 10;
// Of messages of all kinds: who takes none of so many is gone.
constexpr std::size_t kMostMessages = 4096;
constexpr auto kBetweenMessages = std::chrono::milliseconds(4);

// It is there as long as one of its parts goes on.
class StreamConnection : public ServedConnection,
                         public ClientLine,
                         public std::enable_shared_from_this<StreamConnection> {
 public:
  StreamConnection(beast::tcp_stream stream, std::size_t volume, ServerState& state)
      : ServedConnection(state),
        counted_(counted(state.clients)),
        volume_(volume),
        socket_(std::move(stream)),
        news_(state.io) {}
  ~StreamConnection() override { end(); }

  void leave() override try {
    close(websocket::close_code::going_away, "the server ends");
  } catch (const std::bad_alloc&) {
    end();
  }

  // The session's end may take a while.
  void end() override {
    closing_ = true;
    news_.cancel();
    beast::get_lowest_layer(socket_).close();
    if (session_ == nullptr) return;
    try {
      asio::post(state_.ends, [session = std::move(session_)]() mutable { session.reset(); });
    } catch (const std::bad_alloc&) {  // it ended at once, and all waited for that
    }
  }

  void start(HttpRequest request) {
    spawn([this, request = std::move(request)] { return read(request); });
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

 private:
  struct Message {
    bool is_binary = false;
    std::vector<std::byte> bytes;
  };

  // A part goes on beside the others. It ends the connection by a failure.
  template <typename Part>
  void spawn(Part part) {
    asio::co_spawn(state_.io, std::move(part), [self = shared_from_this()](std::exception_ptr why) {
      if (why) self->end();
    });
  }

  Task read(const HttpRequest& request) {
    beast::get_lowest_layer(socket_).expires_never();
    socket_.set_option(websocket::stream_base::timeout{kRequestTime, kIdleTime, true});
    socket_.set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
      response.set(beast::http::field::sec_websocket_protocol, "isobrick.1");
    }));
    socket_.read_message_max(kMostMessageBytes);
    socket_.auto_fragment(false);
    co_await socket_.async_accept(request, asio::use_awaitable);
    ++state_.counted.clients;
    spawn([this] { return show(); });
    Clock::time_point last_message;
    while (true) {
      co_await socket_.async_read(buffer_, asio::use_awaitable);
      std::string text = beast::buffers_to_string(buffer_.data());
      buffer_.clear();
      if (session_ == nullptr)
        early_ = std::move(text);
      else
        take(text);
      const bool is_soon = Clock::now() - last_message < kBetweenMessages;
      last_message = Clock::now();
      if (is_soon) co_await pause(kBetweenMessages);
    }
  }

  // The surfaces of the client's wishes, once the volume is open.
  Task show() {
    try {
      while (!closing_ && session_ == nullptr) {
        begin(state_.volumes.open(volume_));
        if (session_ == nullptr) co_await pause(kBetweenLooks);
      }
      while (!closing_) {
        constexpr double kTillWoken = 3600.0;
        const double again = session_->update().value_or(kTillWoken);
        news_.expires_after(std::chrono::microseconds(static_cast<std::int64_t>(1e6 * again)));
        SocketError woken;
        co_await news_.async_wait(asio::redirect_error(asio::use_awaitable, woken));
      }
    } catch (const std::exception& failure) {
      const std::string error = failureWords(failure);
      sendTyped("error", {{"error", error}});
      close(websocket::close_code::internal_error, error);
    }
  }

  void begin(std::shared_ptr<const OpenedVolume> opened) {
    if (opened == nullptr) {
      if (messages_.empty()) sendTyped("opening", state_.volumes.entryOf(volume_));
      return;
    }
    // Threads of an extraction have news; one word of it is on its way at a time.
    const auto is_told = std::make_shared<std::atomic<bool>>(false);
    const auto on_news = [self = weak_from_this(), is_told, &io = state_.io] {
      if (is_told->exchange(true)) return;
      try {
        asio::post(io, [self, is_told] {
          is_told->store(false);
          if (const auto connection = self.lock()) connection->news_.cancel();
        });
      } catch (const std::bad_alloc&) {
        is_told->store(false);  // the next word is to go
        throw;
      }
    };
    session_ =
        std::make_shared<SurfaceSession>(std::move(opened), state_.options.threads, *this, on_news);
    sendTyped("volume", state_.volumes.factsOf(volume_));
    if (!early_.empty()) take(early_);
  }

  void take(const std::string& text) try {
    if (closing_) return;
    const ClientMessage message = parseClientMessage(text, session_->volume());
    if (std::holds_alternative<ClientWish>(message)) ++state_.counted.wishes;
    session_->take(message);
    news_.cancel();
  } catch (const Refusal& refusal) {
    close(websocket::close_code::policy_error, refusal.what());
  }

  void close(websocket::close_code code, const std::string& why) {
    if (std::exchange(closing_, true)) return;
    news_.cancel();
    // At most so many bytes go into a control frame.
    const websocket::close_reason reason(code, why.substr(0, 120));
    socket_.async_close(reason, [self = shared_from_this()](SocketError) { self->end(); });
  }

  void sendTyped(const char* type, nlohmann::ordered_json json) {
    json["type"] = type;
    sendWord(json);
  }

  void send(Message message) {
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
                        [self = shared_from_this()](SocketError error, std::size_t bytes) {
                          self->onWritten(error, bytes);
                        });
  } catch (const std::bad_alloc&) {  // beast takes no other message after that
    breakOff();
  }

  void onWritten(SocketError error, std::size_t bytes) {
    state_.counted.bytes += bytes;
    if (error) return end();
    on_the_way_ -= messages_.front().bytes.size();
    messages_.pop_front();
    if (!messages_.empty()) write();
    news_.cancel();
  }

  const std::shared_ptr<const void> counted_;
  const std::size_t volume_;
  websocket::stream<beast::tcp_stream> socket_;
  asio::steady_timer news_;
  beast::flat_buffer buffer_{kMostMessageBytes};
  std::string early_;             // the last message before the volume was open
  std::deque<Message> messages_;  // the first one is being written
  std::size_t on_the_way_ = 0;    // bytes of them
  std::shared_ptr<SurfaceSession> session_;
  bool closing_ = false;
};

}  // namespace

void startStream(beast::tcp_stream stream, HttpRequest request, std::size_t volume,
                 ServerState& state) {
  std::make_shared<StreamConnection>(std::move(stream), volume, state)->start(std::move(request));
}

}  // namespace isobrick
