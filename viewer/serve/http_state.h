// What the connections of a server share. Private to viewer/serve/http_*.
#pragma once

// clang-format off
#include <utility>  // awaitable.hpp of Boost 1.74 needs it
// clang-format on
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/this_coro.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <chrono>
#include <cstddef>
#include <memory>
#include <set>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/serve/access.h"
#include "isobrick/viewer/serve/serve.h"
#include "isobrick/viewer/serve/served_volumes.h"

namespace isobrick {

inline constexpr std::size_t kMostConnections = 400, kMostClients = 200, kMostWaiting = 64;
// Until a request has come.
inline constexpr auto kRequestTime = std::chrono::seconds(10);
// Without a sign of life of a client, or without its taking any of an answer.
inline constexpr auto kIdleTime = std::chrono::seconds(60);
// At a volume that is being opened.
inline constexpr auto kBetweenLooks = std::chrono::milliseconds(50);

class ServedConnection;

// A thread for work that the network does not wait for, in the order in which it comes.
struct JobQueue {
  const std::size_t most_jobs;
  std::size_t jobs = 0;
  boost::asio::thread_pool thread{1};
};

// All of it but jobs belongs to the thread of `io`.
struct ServerState {
  explicit ServerState(ServeOptions given)
      : options(std::move(given)),
        access(newKey(), options.origins),
        volumes(options.volumes, options.build, options.memory_bytes, options.remote) {}

  std::set<ServedConnection*> connections;
  std::size_t clients = 0;  // of streams
  std::size_t waiting = 0;  // for a volume that is being opened
  boost::asio::io_context io{1};
  const ServeOptions options;
  Access access;
  ServedVolumes volumes;
  ServeSummary counted;
  CancelFlag stop;  // of jobs
  // Last: their threads use the above. The last one ends sessions, which may wait for extractions.
  JobQueue surfaces{8}, slices{64};
  boost::asio::thread_pool ends{1};
};

// One that the server knows while it is there, and ends with itself.
class ServedConnection {
 public:
  explicit ServedConnection(ServerState& state) : state_(state) { state_.connections.insert(this); }
  virtual ~ServedConnection() { state_.connections.erase(this); }
  ServedConnection(const ServedConnection&) = delete;
  ServedConnection& operator=(const ServedConnection&) = delete;

  // Tells the client that the server ends.
  virtual void leave() {}
  // Nothing more is done for the client.
  virtual void end() = 0;

 protected:
  ServerState& state_;
};

// One more, as long as the result is there.
inline std::shared_ptr<const void> counted(std::size_t& count) {
  return {&++count, [&count](const void*) { --count; }};
}

using HttpRequest = boost::beast::http::request<boost::beast::http::empty_body>;
// A part of the work of the network's thread.
using Task = boost::asio::awaitable<void>;

inline Task pause(std::chrono::milliseconds time) {
  boost::asio::steady_timer timer(co_await boost::asio::this_coro::executor, time);
  co_await timer.async_wait(boost::asio::use_awaitable);
}

// "127.0.0.1:8080", "[::1]:8080"
std::string hostText(const boost::asio::ip::tcp::endpoint& endpoint);
// Reads requests and answers them.
Task serveConnection(boost::asio::ip::tcp::socket socket, ServerState& state);
// Goes on with a request that was checked, as a stream of that volume.
void startStream(boost::beast::tcp_stream stream, HttpRequest request, std::size_t volume,
                 ServerState& state);

}  // namespace isobrick
