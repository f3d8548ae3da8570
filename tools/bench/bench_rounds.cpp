#include "tools/bench/bench_rounds.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>

#include "isobrick/storage/file_system.h"
#include "tools/bench/process_memory.h"
#include "tools/program_run.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// A temporary folder.
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
  fs::path path_;
};

RowMeasurement runRow(const BenchRow& row, const RowTask& task, const CancelFlag* cancel) {
  ProgramCall call;
  call.words = row.call_words;
  const std::vector<std::string> task_words = rowTaskWords(task);
  call.words.insert(call.words.end(), task_words.begin(), task_words.end());
  if (task.huge_pages) call.environment.emplace_back(kAllocateHugePages);
  return rowMeasurementOf(runProgram(call, cancel));
}

void measureOnce(const BenchSettings& settings, BenchRow& row, const CancelFlag* cancel) {
  RowTask task;
  task.row = row.name;
  task.repeats = settings.repeats;
  task.cold = row.cold;
  task.huge_pages = row.huge_pages;
  if (row.cold) {
    dropFromPageCache(settings.path);
    row.cached_shares.push_back(cachedShare(settings.path));
  }
  row.measurements.push_back(runRow(row, task, cancel));
}

PlainMesh meshOf(const BenchRow& row, const ScratchFolder& folder, const CancelFlag* cancel) {
  RowTask task;
  task.row = row.name;
  task.repeats = 1;
  task.mesh_path = folder.file("mesh");
  runRow(row, task, cancel);
  PlainMesh mesh = readPlainMesh(task.mesh_path);
  removeName(task.mesh_path);
  return mesh;
}

}  // namespace

std::vector<PeerRow> askPeers(const BenchSettings& settings, const CancelFlag* cancel) {
  if (!settings.peers_executable) return {};
  std::vector<std::string> words = {*settings.peers_executable, "--list"};
  words.insert(words.end(), settings.only.begin(), settings.only.end());
  return peerRowsOf(runProgram({words, {}}, cancel));
}

void measureRows(const BenchSettings& settings, std::vector<BenchRow>& rows,
                 const CancelFlag* cancel, const BenchProgress& progress) {
  const std::size_t all = rows.size() * static_cast<std::size_t>(settings.rounds);
  std::size_t done = 0;
  for (int round = 0; round < settings.rounds; ++round)
    for (BenchRow& row : rows) {
      progress("measure", done++, all);
      if (!row.failure.empty()) continue;
      try {
        measureOnce(settings, row, cancel);
      } catch (const Cancelled&) {
        throw;
      } catch (const Error& failure) {
        row.failure = failure.what();
      }
    }
}

void measureErrors(const BenchSettings& settings, const Index3& voxels, std::vector<BenchRow>& rows,
                   const CancelFlag* cancel, const BenchProgress& progress) {
  std::map<std::string, BenchRow*> approximating;
  for (BenchRow& row : rows)
    if (row.approximates && row.failure.empty()) approximating.emplace(row.name, &row);
  if (approximating.empty()) return;

  BenchSettings finest_only = settings;
  finest_only.only = {kFinestRow};
  const ScratchFolder folder;
  const PlainMesh finest = meshOf(planRows(finest_only, {}).front(), folder, cancel);
  DistanceOptions options;
  options.voxels = voxels;
  std::size_t done = 0;
  for (const auto& [name, first] : approximating) {
    progress("distances", done++, approximating.size());
    const PlainMesh mesh = meshOf(*first, folder, cancel);
    const SurfaceError error{distanceFrom(mesh, finest, options),
                             distanceFrom(finest, mesh, options)};
    for (BenchRow& row : rows)
      if (row.name == name) row.error = error;
  }
}

}  // namespace isobrick
