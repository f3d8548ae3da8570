// What the connections of a server share. Private to viewer/serve/http_*.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/serve/access.h"
#include "isobrick/viewer/serve/serve.h"
#include "isobrick/viewer/serve/served_volumes.h"

namespace isobrick {

class StreamConnection;

inline constexpr std::size_t kMostConnections = 400, kMostClients = 200, kMostWaiting = 64;
// Until a request has come.
inline constexpr int kRequestSeconds = 10;
// Without a sign of life of a client, or without its taking any of an answer.
inline constexpr int kIdleSeconds = 60;

// A thread for work that the network does not wait for, in the order in which it comes. Its
// destructor waits for the job under way, and forgets those behind it.
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

  std::size_t connections = 0;
  std::size_t waiting = 0;  // of them, for a volume that is being opened
  std::set<StreamConnection*> clients;
  boost::asio::io_context io{1};  // holds connections, which use the above in their end
  const ServeOptions options;
  Access access;
  ServedVolumes volumes;
  ServeSummary counted;
  std::string folder;  // for surfaces on their way; empty: none was needed yet
  std::uint64_t last_file = 0;
  CancelFlag stop;  // of jobs
  // Last: their threads use the above. The last one ends sessions, which may wait for extractions.
  JobQueue surfaces{8}, slices{64};
  boost::asio::thread_pool ends{1};
};

using HttpRequest = boost::beast::http::request<boost::beast::http::empty_body>;

// "127.0.0.1:8080", "[::1]:8080"
std::string hostText(const boost::asio::ip::tcp::endpoint& endpoint);
// Reads requests and answers them.
void startHttpConnection(boost::asio::ip::tcp::socket socket, ServerState& state);
// Goes on with a request that was checked, as a stream of that volume. Counts as a connection.
void startStreamConnection(boost::beast::tcp_stream stream, const HttpRequest& request,
                           std::size_t volume, ServerState& state);
// For the end of the server: tells the clients; and leaves them.
void closeStreams(ServerState& state);
void endStreams(ServerState& state);

}  // namespace isobrick
