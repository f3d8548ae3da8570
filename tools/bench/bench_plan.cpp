#include "tools/bench/bench_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

std::vector<std::string> joined(std::vector<std::string> a, const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

// The distances of the rows of simplification in `only`.
std::vector<std::string> simplifyDistances(const std::vector<std::string>& only) {
  std::vector<std::string> distances;
  for (const std::string& name : only)
    if (name.rfind(kSimplifyRows, 0) == 0)
      distances.push_back(name.substr(std::string_view(kSimplifyRows).size()));
  return distances;
}

// One of each name; cache and pages are set later.
std::vector<BenchRow> namedRows(const BenchSettings& settings, const std::vector<PeerRow>& peers) {
  std::vector<BenchRow> rows;
  const auto add = [&](const std::string& name, bool approximates,
                       std::vector<std::string> call_words) {
    BenchRow row;
    row.name = name;
    row.approximates = approximates;
    row.call_words = std::move(call_words);
    rows.push_back(std::move(row));
  };
  const auto own = joined({settings.own_executable, "bench-row"}, settings.own_words);
  add(kFinestRow, false, own);
  for (const std::string& distance : simplifyDistances(settings.only))
    add(kSimplifyRows + distance, true, joined(own, {"--simplify", distance}));
  if (!settings.query_words.empty()) add(kAdaptiveRow, true, joined(own, settings.query_words));
  for (const PeerRow& peer : peers)
    add(peer.name, peer.approximates,
        {*settings.peers_executable, settings.path, "--iso", fmt::format("{}", settings.isovalue),
         "--threads", std::to_string(settings.threads)});
  return rows;
}

std::vector<BenchRow> chosenRows(const std::vector<BenchRow>& all,
                                 const std::vector<std::string>& only) {
  std::vector<BenchRow> chosen;
  for (const std::string& name : only)
    if (std::none_of(all.begin(), all.end(), [&](const BenchRow& r) { return r.name == name; })) {
      std::string names;
      for (const BenchRow& row : all) names += (names.empty() ? "" : ", ") + row.name;
      throw Error(fmt::format("there is no row '{}'; there are {}", name, names));
    }
  for (const BenchRow& row : all)
    if (only.empty() || std::find(only.begin(), only.end(), row.name) != only.end())
      chosen.push_back(row);
  return chosen;
}

}  // namespace

std::vector<BenchRow> planRows(const BenchSettings& settings, const std::vector<PeerRow>& peers) {
  const std::vector<BenchRow> chosen = chosenRows(namedRows(settings, peers), settings.only);
  std::vector<BenchRow> rows;
  for (const bool cold : settings.cold)
    for (const bool huge_pages : settings.huge_pages)
      for (BenchRow row : chosen) {
        row.cold = cold;
        row.huge_pages = huge_pages;
        rows.push_back(std::move(row));
      }
  return rows;
}

}  // namespace isobrick
