#include <netinet/tcp.h>

#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <memory>
#include <new>
#include <utility>

#include "isobrick/storage/file_system.h"
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

class Server {
 public:
  explicit Server(ServeOptions options)
      : state_(std::move(options)), acceptor_(state_.io), tick_(state_.io), pause_(state_.io) {
    listen();
  }
  ~Server() {
    try {
      endStreams(state_);
      if (!state_.folder.empty()) removeTree(state_.folder);
    } catch (const std::bad_alloc&) {  // it may be why the server ends
    }
  }

  ServeSummary run() {
    const double begin = clockSeconds();
    if (state_.options.on_ready) state_.options.on_ready(url());
    accept();
    tick();
    while (!isOver()) {
    }
    state_.counted.seconds = clockSeconds() - begin;
    return state_.counted;
  }

 private:
  void listen() try {
    const tcp::endpoint endpoint(asio::ip::make_address(state_.options.address),
                                 state_.options.port);
    acceptor_.open(endpoint.protocol());
    acceptor_.set_option(asio::socket_base::reuse_address(true));
    acceptor_.bind(endpoint);
    acceptor_.listen();
    const std::string port = ":" + std::to_string(acceptor_.local_endpoint().port());
    if (endpoint.address().is_loopback()) state_.access.addHost("localhost" + port);
    own_host_ = endpoint.address().is_unspecified() ? asio::ip::host_name() + port
                                                    : hostText(acceptor_.local_endpoint());
    state_.access.addHost(own_host_);
  } catch (const boost::system::system_error& failure) {
    throw Error("cannot listen on " + state_.options.address + " port " +
                std::to_string(state_.options.port) + ": " + failure.code().message() +
                "; choose another --listen or --port");
  }

  std::string url() const {
    const auto& origins = state_.options.origins;
    const bool is_loopback = acceptor_.local_endpoint().address().is_loopback();
    const std::string begin =
        origins.empty() || is_loopback ? "http://" + own_host_ : *origins.begin();
    return begin + state_.options.base_path + "/#token=" + state_.access.key();
  }

  // False if a request failed: its connection is gone, and all others go on, unless that fails too.
  bool isOver() try {
    state_.io.run();
    return true;
  } catch (const std::exception&) {
    if (state_.stop.requested()) return true;
    if (!accepts_) accept();
    if (!ticks_) tick();
    return false;
  }

  void accept() {
    acceptor_.async_accept([this](boost::system::error_code error, tcp::socket socket) {
      accepts_ = false;
      if (error == asio::error::operation_aborted) return;
      if (error) {  // no descriptor is left, perhaps
        pause_.expires_after(std::chrono::milliseconds(100));
        pause_.async_wait([this](boost::system::error_code stopped) {
          accepts_ = false;
          if (!stopped) accept();
        });
        accepts_ = true;
        return;
      }
      if (state_.connections < kMostConnections) {
        setSocketOptions(socket);
        startHttpConnection(std::move(socket), state_);
      }
      accept();
    });
    accepts_ = true;
  }

  void tick() {
    ticks_ = false;
    state_.volumes.update();
    if (state_.options.cancel != nullptr && state_.options.cancel->requested()) return close();
    tick_.expires_after(std::chrono::milliseconds(50));
    tick_.async_wait([this](boost::system::error_code error) {
      if (!error) tick();
    });
    ticks_ = true;
  }

  // Clients get word; who does not answer soon is left.
  void close() {
    state_.stop.request();
    boost::system::error_code ignored;
    acceptor_.close(ignored);
    pause_.cancel();
    tick_.expires_after(std::chrono::milliseconds(300));
    tick_.async_wait([this](boost::system::error_code) { state_.io.stop(); });
    closeStreams(state_);
  }

  ServerState state_;
  tcp::acceptor acceptor_;
  std::string own_host_;
  asio::steady_timer tick_, pause_;
  bool accepts_ = false, ticks_ = false;  // it waits for a connection, for the next tick
};

}  // namespace

std::string hostText(const tcp::endpoint& endpoint) {
  const std::string address = endpoint.address().to_string();
  return (endpoint.address().is_v6() ? "[" + address + "]" : address) + ":" +
         std::to_string(endpoint.port());
}

ServeSummary runServer(ServeOptions options) { return Server(std::move(options)).run(); }

bool hasPage() { return !pageFiles().empty(); }

}  // namespace isobrick
