#include "tests/support/range_server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>

#include "tests/support/test_paths.h"

namespace isobrick::test {

RangeServer::RangeServer(const std::string& folder, const std::vector<std::string>& options) {
  std::vector<std::string> words = {"/usr/bin/python3", rangeServerScript(), folder};
  words.insert(words.end(), options.begin(), options.end());
  if (std::find(options.begin(), options.end(), "--certificate") != options.end())
    scheme_ = "https";
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  int input[2], output[2];
  if (pipe2(input, O_CLOEXEC) != 0 || pipe2(output, O_CLOEXEC) != 0)
    throw std::runtime_error("no pipes for the server");
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, input[0], 0);
  posix_spawn_file_actions_adddup2(&actions, output[1], 1);
  const int failure = posix_spawn(&child_, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(input[0]);
  close(output[1]);
  input_ = input[1];
  output_ = output[0];
  std::string said;
  char byte = 0;
  while (failure == 0 && read(output_, &byte, 1) == 1 && byte != '\n') said += byte;
  port_ = std::atoi(said.c_str());
  if (port_ == 0) throw std::runtime_error("the server did not start: /usr/bin/python3");
}

// The server ends with its stdin.
RangeServer::~RangeServer() {
  close(input_);
  close(output_);
  if (child_ > 0) waitpid(child_, nullptr, 0);
}

std::string RangeServer::url(const std::string& path) const {
  return scheme_ + "://127.0.0.1:" + std::to_string(port_) + "/" + path;
}

nlohmann::json RangeServer::stats() const {
  const int connection = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port_));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    throw std::runtime_error("the server cannot be reached");
  const std::string request = "GET /stats HTTP/1.1\r\n\r\n";
  if (write(connection, request.data(), request.size()) < 0)
    throw std::runtime_error("the server does not listen");
  std::string text;
  char buffer[65536];
  ssize_t count = 0;
  while ((count = read(connection, buffer, sizeof buffer)) > 0)
    text.append(buffer, static_cast<std::size_t>(count));
  close(connection);
  return nlohmann::json::parse(text.substr(text.find("\r\n\r\n")));
}

}  // namespace isobrick::test
