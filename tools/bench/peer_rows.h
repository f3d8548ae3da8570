// The rows that bench_peers can measure, as it tells `isobrick bench`.
#pragma once

#include <string>
#include <vector>

namespace isobrick {

struct PeerRow {
  std::string name;           // without blanks
  bool approximates = false;  // its vertices do not lie where those of the finest surface do
};

// A line each, and back. Throws Error where the text is not what the other wrote.
std::string textOf(const std::vector<PeerRow>& rows);
std::vector<PeerRow> peerRowsOf(const std::string& text);

}  // namespace isobrick
