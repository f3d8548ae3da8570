// A server of ranges that a test starts, in a process of its own: tests/support/range_server.py.
#pragma once

#include <sys/types.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace isobrick::test {

// Serves a folder from the constructor's end until the destructor. Throws if it does not start.
class RangeServer {
 public:
  explicit RangeServer(const std::string& folder, const std::vector<std::string>& options = {});
  ~RangeServer();
  RangeServer(const RangeServer&) = delete;
  RangeServer& operator=(const RangeServer&) = delete;

  int port() const { return port_; }
  // "http://127.0.0.1:PORT/good/scan.isb" for "good/scan.isb".
  std::string url(const std::string& path) const;

  // The requests so far; for a server without a certificate.
  nlohmann::json stats() const;
  std::size_t requests() const { return stats()["requests"].size(); }
  // The round trips one after the other, of a server with --waves.
  std::size_t waves() const { return stats()["waves"].size(); }

 private:
  std::string scheme_ = "http";
  pid_t child_ = -1;
  int input_ = -1, output_ = -1;
  int port_ = 0;
};

}  // namespace isobrick::test
