#include "tools/bench/bench_rows.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <sstream>
#include <string_view>

#include "isobrick/storage/file_system.h"
#include "tools/bench/page_cache.h"
#include "tools/program_run.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

using BenchWords = std::vector<std::string>;

// The C library requests huge pages in every large allocation; glibc 2.35 and later.
constexpr char kAllocateHugePages[] = "GLIBC_TUNABLES=glibc.malloc.hugetlb=1";

class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (temporaryFolder() / "isobrick_bench_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr)
      throw Error(fmt::format("cannot make a folder '{}': {}", name, std::strerror(errno)));
    path_ = name;
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  ~ScratchFolder() { removeTree(path_); }
  std::string file(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

BenchWords joined(BenchWords a, const BenchWords& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Json measurementOf(const std::string& text) {
  Json json = Json::parse(text, nullptr, false);
  bool is_whole = json.is_object() && json["note"].is_string() && json["seconds"].is_array() &&
                  !json["seconds"].empty();
  for (const char* key :
       {"triangles", "vertices", "output_bytes", "load_seconds", "prepare_seconds", "first_seconds",
        "processor_seconds", "loaded_rss_bytes", "peak_rss_bytes"})
    is_whole = is_whole && json[key].is_number();
  for (const Json& value : is_whole ? json["seconds"] : Json())
    is_whole = is_whole && value.is_number();
  if (!is_whole)
    throw Error(fmt::format(
        "'{}' is not what a row's process reports; take isobrick and its peers from one version",
        text.substr(0, 80)));
  return json;
}

class Bench {
 public:
  Bench(const BenchSettings& settings, const CancelFlag* cancel)
      : settings_(settings), cancel_(cancel) {}

  std::vector<BenchRow> planRows() const {
    std::vector<BenchRow> all = ownRows();
    const std::vector<BenchRow> peers = peerRows();
    all.insert(all.end(), peers.begin(), peers.end());
    BenchWords names;
    for (const BenchRow& row : all) names.push_back(row.name);
    const auto has = [](const BenchWords& words, const std::string& word) {
      return std::find(words.begin(), words.end(), word) != words.end();
    };
    for (const std::string& name : settings_.only)
      if (!has(names, name))
        throw Error(
            fmt::format("there is no row '{}'; there are {}", name, fmt::join(names, ", ")));
    std::erase_if(all, [&](const BenchRow& row) {
      return !settings_.only.empty() && !has(settings_.only, row.name);
    });
    return all;
  }

  // The words of peers are those of the file that is written here for them.
  void exportVoxels(std::vector<BenchRow>& rows) const {
    const auto is_peer = [](const BenchRow& row) { return row.call_words.size() == 1; };
    if (std::none_of(rows.begin(), rows.end(), is_peer)) return;
    const std::string file = folder_.file("voxels.raw");
    const Json said =
        Json::parse(run({settings_.own_executable, "convert", settings_.path, "-o", file,
                         "--threads", std::to_string(settings_.threads), "--json"}));
    const auto numbers = [&](const char* key) {
      return fmt::format("{}", fmt::join(said.at(key).get<std::vector<double>>(), ","));
    };
    for (BenchRow& row : rows) {
      if (!is_peer(row)) continue;
      row.file = file;
      row.call_words =
          joined(row.call_words,
                 {file, "--dims", numbers("dimensions"), "--type", said.at("voxel_type"),
                  "--spacing", numbers("spacing"), fmt::format("--iso={}", settings_.isovalue),
                  "--threads", std::to_string(settings_.threads)});
    }
  }

  void measure(std::vector<BenchRow>& rows, const BenchProgress& progress) const {
    const std::size_t all = rows.size() * static_cast<std::size_t>(settings_.rounds);
    std::size_t done = 0;
    for (int round = 0; round < settings_.rounds; ++round)
      for (BenchRow& row : rows) {
        progress("measure", done++, all);
        if (row.failure.empty()) measureOnce(row);
      }
  }

  // Once for each name.
  void measureDistances(std::vector<BenchRow>& rows, const Index3& voxels,
                        const BenchProgress& progress) const {
    std::vector<BenchRow*> approximating;
    for (BenchRow& row : rows)
      if (row.approximates && row.failure.empty()) approximating.push_back(&row);
    if (approximating.empty()) return;
    const PlainMesh finest = meshOf(ownRows().front());
    DistanceOptions options;
    options.voxels = voxels;
    std::size_t done = 0;
    for (BenchRow* const row : approximating) {
      progress("distances", done++, approximating.size());
      const PlainMesh mesh = meshOf(*row);
      row->to_finest = distanceFrom(mesh, finest, options);
      row->from_finest = distanceFrom(finest, mesh, options);
    }
  }

 private:
  std::string run(const BenchWords& words) const {
    return runProgram({words, {kAllocateHugePages}}, cancel_);
  }

  std::vector<BenchRow> ownRows() const {
    std::vector<BenchRow> rows;
    const BenchWords own = joined({settings_.own_executable, "bench-row"}, settings_.own_words);
    const auto add = [&](const std::string& name, bool approximates, const BenchWords& words) {
      BenchRow& row = rows.emplace_back();
      row.name = name;
      row.approximates = approximates;
      row.call_words = joined(own, words);
      row.file = settings_.path;
    };
    add(kFinestRow, false, {});
    for (const std::string& name : settings_.only)
      if (name.starts_with(kSimplifyRows))
        add(name, true, {"--simplify", name.substr(std::string_view(kSimplifyRows).size())});
    if (!settings_.query_words.empty()) add(kAdaptiveRow, true, settings_.query_words);
    return rows;
  }

  std::vector<BenchRow> peerRows() const {
    std::vector<BenchRow> rows;
    if (!settings_.peers_executable) return rows;
    std::istringstream words(run(joined({*settings_.peers_executable, "--list"}, settings_.only)));
    for (std::string name, kind; words >> name;) {
      words >> kind;
      if (kind != "exact" && kind != "approximate")
        throw Error(fmt::format(
            "what the peers say of the row '{}' cannot be read; take isobrick and its peers from "
            "one version",
            name));
      BenchRow& row = rows.emplace_back();
      row.name = name;
      row.approximates = kind == "approximate";
      row.call_words = {*settings_.peers_executable};
      kind.clear();
    }
    return rows;
  }

  Json runRow(const BenchRow& row, const BenchWords& task) const {
    return measurementOf(run(joined(joined(row.call_words, {"--row", row.name}), task)));
  }

  void measureOnce(BenchRow& row) const {
    BenchWords task = {"--repeat", std::to_string(settings_.repeats)};
    try {
      if (settings_.cold) {
        dropFromPageCache(row.file);
        row.cached_shares.push_back(cachedShare(row.file));
        task.emplace_back("--cold");
      }
      row.measurements.push_back(runRow(row, task));
    } catch (const Cancelled&) {
      throw;
    } catch (const Error& failure) {
      row.failure = failure.what();
    }
  }

  PlainMesh meshOf(const BenchRow& row) const {
    const std::string path = folder_.file("mesh");
    runRow(row, {"--repeat", "1", "--mesh", path});
    PlainMesh mesh = readPlainMesh(path);
    removeName(path);
    return mesh;
  }

  const BenchSettings& settings_;
  const CancelFlag* cancel_;
  ScratchFolder folder_;
};

}  // namespace

std::vector<BenchRow> measureRows(const BenchSettings& settings, const Index3& voxels,
                                  const CancelFlag* cancel, const BenchProgress& progress) {
  const Bench bench(settings, cancel);
  std::vector<BenchRow> rows = bench.planRows();
  bench.exportVoxels(rows);
  bench.measure(rows, progress);
  if (settings.with_distances)
    runWithThreads(settings.threads, [&] { bench.measureDistances(rows, voxels, progress); });
  return rows;
}

}  // namespace isobrick
