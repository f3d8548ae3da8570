#include "tools/bench/peer_rows.h"

#include <fmt/format.h>

#include <sstream>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

constexpr char kExact[] = "exact";
constexpr char kApproximate[] = "approximate";

}  // namespace

std::string textOf(const std::vector<PeerRow>& rows) {
  std::string text;
  for (const PeerRow& row : rows)
    text += fmt::format("{} {}\n", row.name, row.approximates ? kApproximate : kExact);
  return text;
}

std::vector<PeerRow> peerRowsOf(const std::string& text) {
  std::vector<PeerRow> rows;
  std::istringstream words(text);
  for (std::string name, kind; words >> name;) {
    if (!(words >> kind) || (kind != kExact && kind != kApproximate))
      throw Error(
          fmt::format("what the peers say of the row '{}' cannot be read; build isobrick "
                      "and bench_peers from the same sources",
                      name));
    rows.push_back({name, kind == kApproximate});
  }
  return rows;
}

}  // namespace isobrick
