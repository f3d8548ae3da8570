#include <netinet/tcp.h>

#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/host_name.hpp>
#include <exception>
#include <new>

#include "isobrick/viewer/serve/http_state.h"
#include "isobrick/viewer/serve/page_files.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

// What is sent waits here, where a newer wish can still take its place, rather than in the system.
void setSocketOptions(tcp::socket& socket) {
  boost::system::error_code ignored;
  socket.set_option(tcp::no_delay(true), ignored);
  const int most_unsent = 16 << 10;
  setsockopt(socket.native_handle(), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &most_unsent,
             sizeof most_unsent);
}

// Returns the name by which the server is asked.
std::string listen(tcp::acceptor& acceptor, ServerState& state) try {
  const tcp::endpoint endpoint(asio::ip::make_address(state.options.address), state.options.port);
  acceptor.open(endpoint.protocol());
  acceptor.set_option(asio::socket_base::reuse_address(true));
  acceptor.bind(endpoint);
  acceptor.listen();
  const std::string port = ":" + std::to_string(acceptor.local_endpoint().port());
  if (endpoint.address().is_loopback()) state.access.addHost("localhost" + port);
  const std::string host = endpoint.address().is_unspecified()
                               ? asio::ip::host_name() + port
                               : hostText(acceptor.local_endpoint());
  state.access.addHost(host);
  const auto& origins = state.options.origins;
  return origins.empty() || endpoint.address().is_loopback() ? "http://" + host : *origins.begin();
} catch (const boost::system::system_error& failure) {
  throw Error("cannot listen on " + state.options.address + " port " +
              std::to_string(state.options.port) + ": " + failure.code().message() +
              "; choose another --listen or --port");
}

Task acceptOne(tcp::acceptor& acceptor, ServerState& state) {
  boost::system::error_code error;
  tcp::socket socket =
      co_await acceptor.async_accept(asio::redirect_error(asio::use_awaitable, error));
  if (error) {  // no descriptor is left, perhaps
    co_await pause(std::chrono::milliseconds(100));
  } else if (state.connections.size() < kMostConnections) {
    setSocketOptions(socket);
    // The end of one, whatever the reason is, concerns no other.
    asio::co_spawn(state.io, serveConnection(std::move(socket), state),
                   [](const std::exception_ptr&) {});
  }
}

Task look(ServerState& state) {
  state.volumes.update();
  co_await pause(kBetweenLooks);
}

// Until `isOver`. What finds no memory is done again, once.
template <typename IsOver, typename Step>
Task repeat(IsOver isOver, Step step) {
  bool has_failed = false;
  while (!isOver()) {
    try {
      co_await step();
      has_failed = false;
    } catch (const std::bad_alloc&) {
      if (std::exchange(has_failed, true)) throw;
    }
  }
}

// Until the server shall end. Clients get word; who does not answer soon is left.
Task watch(tcp::acceptor& acceptor, ServerState& state) {
  const auto isOver = [&] {
    return state.options.cancel != nullptr && state.options.cancel->requested();
  };
  co_await repeat(isOver, [&] { return look(state); });
  state.stop.request();
  acceptor.close();
  for (ServedConnection* const connection : state.connections) connection->leave();
  co_await pause(std::chrono::milliseconds(300));
  for (ServedConnection* const connection : state.connections) connection->end();
}

}  // namespace

std::string hostText(const tcp::endpoint& endpoint) {
  const std::string address = endpoint.address().to_string();
  return (endpoint.address().is_v6() ? "[" + address + "]" : address) + ":" +
         std::to_string(endpoint.port());
}

ServeSummary runServer(ServeOptions options) {
  ServerState state(std::move(options));
  tcp::acceptor acceptor(state.io);
  const std::string address = listen(acceptor, state);
  const double begin = clockSeconds();
  if (state.options.on_ready)
    state.options.on_ready(address + state.options.base_path + "/#token=" + state.access.key());
  std::exception_ptr failure;
  const auto fail = [&](const std::exception_ptr& why) {
    if (!why) return;
    failure = why;
    state.io.stop();
  };
  const auto isOver = [&] { return state.stop.requested(); };
  asio::co_spawn(state.io, repeat(isOver, [&] { return acceptOne(acceptor, state); }), fail);
  asio::co_spawn(state.io, watch(acceptor, state), fail);
  while (!state.io.stopped()) {
    try {
      state.io.run();
    } catch (const std::bad_alloc&) {  // of what a connection did; it has ended
    }
  }
  if (failure) std::rethrow_exception(failure);
  state.counted.seconds = clockSeconds() - begin;
  return state.counted;
}

bool hasPage() { return !pageFiles().empty(); }

}  // namespace isobrick
