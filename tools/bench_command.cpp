// isobrick bench: the speed of extraction, beside other libraries' if they are there.
#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/surface_mesh.h"
#include "tools/bench/bench_report.h"
#include "tools/bench/bench_rows.h"
#include "tools/bench/surface_distance.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/own_folder.h"
#include "tools/parse_text.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

struct BenchArguments {
  std::vector<const CLI::Option*> query_options;  // the options that extract has too
  QueryOptions query;
  BenchSettings settings;
  std::string cache = "warm", peers;
  bool json = false;
};

// The words of the query again, as the user wrote them, for the processes of our own rows: the
// words for every row, and those that make a query adaptive.
void splitQueryWords(BenchArguments& arguments) {
  BenchSettings& settings = arguments.settings;
  settings.own_words = {settings.path, "--iso", fmt::format("{}", settings.isovalue)};
  for (const CLI::Option* const option : arguments.query_options) {
    const std::string name = option->get_name();
    if (option->count() == 0) continue;
    if (name == "--box" || name == "--cap")
      throw UsageError("bench compares whole surfaces as they are; leave out " + name);
    if (name == "--iso") continue;  // chosen by now
    const bool of_every_row = name == "--memory" || name == "--no-map";
    std::vector<std::string>& words = of_every_row ? settings.own_words : settings.query_words;
    if (option->get_expected_max() == 0) words.push_back(name);
    if (option->get_expected_max() > 0)
      for (const std::string& value : option->results()) words.insert(words.end(), {name, value});
  }
  settings.own_words.insert(settings.own_words.end(),
                            {"--threads", std::to_string(arguments.query.threads)});
}

// Empty if there is none.
std::string firstFailure(const std::vector<BenchRow>& rows) {
  for (const BenchRow& row : rows)
    if (!row.failure.empty()) return fmt::format("row '{}': {}", row.name, row.failure);
  return {};
}

int runBench(BenchArguments& arguments) {
  BenchSettings& settings = arguments.settings;
  findPyramid(arguments.query);
  settings.path = arguments.query.input.pyramid;
  settings.threads = arguments.query.threads;
  settings.cold = arguments.cache == "cold";
  if (isRemotePath(settings.path) && settings.cold)
    throw UsageError("a pyramid behind a URL has no page cache; leave out --page-cache");
  settings.own_executable = ownExecutable().string();
  settings.peers_executable = arguments.peers.empty() ? findOwn("bench_peers") : arguments.peers;

  BenchScene scene;
  {
    // Opened only for its facts: each row's own process opens the file again.
    const auto file = openPyramidFile(settings.path, Pyramid::kDefaultBudgetBytes, FileAccess::kMap,
                                      remoteOptions(arguments.query.input));
    const Pyramid& pyramid = *file;
    chooseIsovalues(arguments.query, pyramid);
    warnOfEmptySurface(arguments.query, pyramid);
    scene = {pyramid.lattice().voxels(), std::string(voxelTypeName(pyramid.spec().voxel_type)),
             machineLoad()};
  }
  settings.isovalue = arguments.query.isovalue;
  splitQueryWords(arguments);
  const std::vector<BenchRow> rows = [&] {
    ProgressBar bar(0, "rows");
    return measureRows(settings, scene.voxels, &interruptFlag(),
                       [&](const char* what, std::size_t done, std::size_t all) {
                         const auto rows_done = static_cast<double>(done);
                         bar.show(what, rows_done / static_cast<double>(all), rows_done);
                       });
  }();
  const std::string failure = firstFailure(rows);
  if (std::none_of(rows.begin(), rows.end(), [](const BenchRow& row) { return row.isMeasured(); }))
    throw Error(failure);
  const Json json = jsonOfBench(settings, scene, rows);
  if (arguments.json)
    printJson(json);
  else
    fmt::print("{}", textOfBench(json));
  if (failure.empty()) return 0;
  fmt::print(stderr, "isobrick: {}\n", oneLine(failure));
  return 1;
}

struct OwnRowTask {
  std::string path;
  std::uint64_t budget_bytes = 0;  // these two as in Pyramid
  FileAccess access = FileAccess::kMap;
  int repeats = 3;  // measured extractions, after one that is not
  // The first extraction of the process is the measured one, and opening the file is part of it.
  bool cold = false;
  std::string mesh_path;  // file for the mesh afterwards; empty: none
};

// Of this process until now.
struct ProcessUse {
  double processor_seconds;
  std::uint64_t peak_bytes;
};

ProcessUse processUse() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {seconds(usage.ru_utime) + seconds(usage.ru_stime),
          1024 * static_cast<std::uint64_t>(usage.ru_maxrss)};
}

PlainMesh plainMeshOf(const SurfaceMesh& mesh) {
  PlainMesh plain;
  for (const SurfaceMesh::Part& part : mesh.parts()) {
    const glm::vec3 origin(part.origin);
    for (const glm::vec3& local : mesh.positions().subspan(part.first_vertex, part.vertices)) {
      const glm::vec3 index = origin + local;
      plain.positions.push_back({index.x, index.y, index.z});
    }
  }
  const auto triangles = mesh.triangles();
  for (std::size_t i = 0; i + 2 < triangles.size(); i += 3)
    plain.triangles.push_back({triangles[i], triangles[i + 1], triangles[i + 2]});
  return plain;
}

// What bench_rows.h expects of a row's process. Call it when the threads are already set up.
Json measureOwnRow(const OwnRowTask& task, const Query& query) {
  ProcessUse before = processUse();
  const Stopwatch whole;
  const Pyramid pyramid(task.path, task.budget_bytes, task.access);
  Extractor extractor(pyramid);
  SurfaceMesh mesh;
  const double load_seconds = whole.seconds();
  const std::uint64_t loaded_rss_bytes = processUse().peak_bytes;
  const auto extractOnce = [&] {
    const Stopwatch watch;
    extractor.extract(query, mesh);
    return watch.seconds();
  };
  const double first_seconds = extractOnce();
  std::vector<double> seconds = {load_seconds + first_seconds};
  if (!task.cold) {
    before = processUse();
    seconds.clear();
    for (int i = 0; i < task.repeats; ++i) seconds.push_back(extractOnce());
  }
  const ProcessUse after = processUse();
  const double processor_seconds =
      (after.processor_seconds - before.processor_seconds) / static_cast<double>(seconds.size());
  const std::size_t bytes = mesh.positions().size_bytes() + mesh.normals().size_bytes() +
                            mesh.triangles().size_bytes() +
                            mesh.parts().size() * sizeof(SurfaceMesh::Part);
  Json row = {{"triangles", mesh.triangles().size() / 3},
              {"vertices", mesh.positions().size()},
              {"output_bytes", bytes},
              {"load_seconds", load_seconds},
              {"prepare_seconds", 0},
              {"first_seconds", first_seconds},
              {"seconds", seconds},
              {"processor_seconds", processor_seconds},
              {"loaded_rss_bytes", loaded_rss_bytes},
              {"peak_rss_bytes", after.peak_bytes},
              {"note", "one session, into the memory of the surface before"}};
  if (!task.mesh_path.empty()) writePlainMesh(plainMeshOf(mesh), task.mesh_path);
  return row;
}

struct BenchRowArguments {
  QueryOptions query;
  OwnRowTask task;
  std::string row;
};

int runBenchRow(BenchRowArguments& arguments) {
  OwnRowTask& task = arguments.task;
  task.path = arguments.query.input.path;
  task.budget_bytes = arguments.query.memory_bytes;
  task.access = fileAccess(arguments.query.no_map);
  const Query query = makeQuery(arguments.query, Pyramid(task.path));
  const Json row =
      runWithThreads(arguments.query.threads, [&] { return measureOwnRow(task, query); });
  fmt::print("{}\n", row.dump());
  return 0;
}

}  // namespace

Command addBenchCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand(
      "bench",
      "Measure extraction into memory, beside VTK, OpenVDB and scikit-image if they are there");
  const auto arguments = std::make_shared<BenchArguments>();
  addQueryOptions(*sub, arguments->query);
  arguments->query_options = optionsBeside(std::as_const(*sub), {"FILE", "--threads"});
  BenchSettings& settings = arguments->settings;
  beginGroup(*sub, kMeasuringGroup);
  addParsedOption(*sub, "--rounds", settings.rounds, integerWithin(1, 1000000), "N",
                  "Rounds; in each, every row runs once in a process of its own; default: 5");
  addParsedOption(
      *sub, "--repeat", settings.repeats, integerWithin(1, 1000000), "N",
      "Extract N times; in each process, after a time that is not measured; default: 3");
  sub->add_option(
         "--page-cache", arguments->cache,
         "warm (default): the volume is in memory. cold: the file is dropped from the page "
         "cache, and the time is that from opening it to the mesh")
      ->type_name("KIND")
      ->check(CLI::IsMember({"warm", "cold"}));
  sub->add_option(
         "--rows", settings.only,
         "Only these rows, such as isobrick,vtkFlyingEdges3D,skimage; openvdb-A for any adaptivity "
         "A, vtkQuadricDecimation-R and vtkDecimatePro-R for any reduction R, "
         "simplify-D for any distance D of 'isobrick extract --simplify'")
      ->type_name("NAMES")
      ->delimiter(',');
  sub->add_option("--peers", arguments->peers,
                  "Executable with the rows of other libraries, such as "
                  "tools/bench/peers/bench_peers.py; default: the bench_peers beside this one, if "
                  "there is one")
      ->type_name("PATH");
  sub->add_flag("!--no-distances", settings.with_distances,
                "Leave out how far adaptive surfaces lie from the finest one");
  beginGroup(*sub, kOutputGroup);
  addJsonFlag(*sub, arguments->json);
  sub->footer(
      "\nA query with a focus, a level or a curvature gets a row of its own beside the finest "
      "surface.\n\nExample:\n  isobrick bench head.isb --iso 1324 --level 1 --rows isobrick");
  return {sub, [arguments] { return runBench(*arguments); }};
}

Command addBenchRowCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand("bench-row", "One row of bench, in this process");
  sub->group("");  // not for people
  const auto arguments = std::make_shared<BenchRowArguments>();
  addQueryOptions(*sub, arguments->query);
  addSimplifyOption(*sub, arguments->query);
  sub->add_option("--row", arguments->row)->required();
  sub->add_option("--repeat", arguments->task.repeats)->check(CLI::Range(1, 1000000));
  sub->add_flag("--cold", arguments->task.cold);
  sub->add_option("--mesh", arguments->task.mesh_path);
  return {sub, [arguments] { return runBenchRow(*arguments); }};
}

}  // namespace isobrick
