// A server of volumes for browsers: docs/SERVE.md.
#pragma once

#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/serve/served_volumes.h"
#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

struct ServeOptions {
  std::vector<ServedVolume> volumes;
  bool are_steps = false;  // of one volume in time
  VolumeBuilder build;
  RemoteOptions remote;
  std::uint64_t memory_bytes = Pyramid::kDefaultBudgetBytes;
  int threads = 1;                    // of an extraction
  std::string address = "127.0.0.1";  // to listen on, as a number
  std::uint16_t port = 0;             // 0: a free one
  std::set<std::string> origins;      // by checkedOrigin(): from elsewhere
  std::string base_path;              // "/isobrick", in front of all paths; or empty
  const CancelFlag* cancel = nullptr;
  // Called once, when requests are taken, with the address to open.
  std::function<void(const std::string& url)> on_ready;
};

struct ServeSummary {
  std::uint64_t requests = 0, refused = 0;            // of HTTP
  std::uint64_t clients = 0, wishes = 0, chunks = 0;  // of streams
  std::uint64_t bytes = 0;                            // sent, without headers of the network
  double seconds = 0.0;
};

// Serves until `cancel`, and ends cleanly then. Throws Error if it cannot listen there.
ServeSummary runServer(ServeOptions options);

// False: this build has no page, and serves requests and streams alone.
bool hasPage();

}  // namespace isobrick
