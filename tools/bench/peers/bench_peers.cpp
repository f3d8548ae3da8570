// bench_peers: one row of `isobrick bench` by another library, in a process of its own.
//
//   bench_peers --list [NAME ...]                                the rows there are, and of these
//                                                                those with a number behind them
//   bench_peers FILE.isb --iso V --threads N --row NAME ...      measures one, prints JSON
#include <fmt/format.h>
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <exception>
#include <optional>
#include <span>
#include <string_view>

#include "isobrick/storage/error.h"
#include "tools/bench/peers/peer_engines.h"
#include "tools/bench/row_measurement.h"
#include "tools/line_words.h"

namespace isobrick {
namespace {

#ifdef ISOBRICK_WITH_OPENVDB
constexpr bool kHasOpenVdb = true;
#else
constexpr bool kHasOpenVdb = false;
#endif
#ifdef ISOBRICK_WITH_VTK
constexpr bool kHasVtk = true;
#else
constexpr bool kHasVtk = false;
#endif

// These are listed without being named.
constexpr std::array<const char*, 3> kVtkRows = {"vtkFlyingEdges3D", "vtkSynchronizedTemplates3D",
                                                 "vtkMarchingCubes"};
constexpr std::array<const char*, 3> kOpenVdbRows = {"openvdb-0", "openvdb-0.1", "openvdb-0.5"};

// Rows with a number, 0 .. 1, behind their name: an adaptivity, or the part of the triangles that
// is removed.
struct NumberedRow {
  std::string_view name;
  double number = 0;
};

std::optional<NumberedRow> numberedRow(std::string_view row) {
  for (const std::string_view name : {"openvdb", "vtkQuadricDecimation", "vtkDecimatePro"}) {
    if (!(name == "openvdb" ? kHasOpenVdb : kHasVtk)) continue;
    if (row.substr(0, name.size()) != name || row.substr(name.size(), 1) != "-") continue;
    const char* const end = row.data() + row.size();
    double number = 0;
    const auto [rest, failure] = std::from_chars(row.data() + name.size() + 1, end, number);
    if (failure == std::errc() && rest == end && number >= 0 && number <= 1)
      return NumberedRow{name, number};
  }
  return std::nullopt;
}

std::vector<PeerRow> peerRows(std::span<char* const> further) {
  std::vector<PeerRow> rows;
  // VTK's vertices lie on the same edges as ours; those of OpenVDB inside of cells.
  if (kHasVtk)
    for (const char* name : kVtkRows) rows.push_back({name, false});
  if (kHasOpenVdb)
    for (const char* name : kOpenVdbRows) rows.push_back({name, true});
  for (const std::string name : further) {
    const bool is_known =
        std::any_of(rows.begin(), rows.end(), [&](const PeerRow& row) { return row.name == name; });
    if (!is_known && numberedRow(name)) rows.push_back({name, true});
  }
  return rows;
}

struct PeerArguments {
  std::string path;
  double isovalue = 0;
  int threads = 1;
  bool list = false;
  RowTask task;
};

std::unique_ptr<SurfaceEngine> makeEngine(const PeerArguments& arguments) {
  const std::optional<NumberedRow> numbered = numberedRow(arguments.task.row);
#ifdef ISOBRICK_WITH_OPENVDB
  if (numbered && numbered->name == "openvdb")
    return makeOpenVdbEngine(arguments.path, arguments.isovalue, numbered->number);
#endif
#ifdef ISOBRICK_WITH_VTK
  if (numbered)
    return makeVtkDecimation(std::string(numbered->name), arguments.path, arguments.isovalue,
                             numbered->number, arguments.threads);
  if (auto engine =
          makeVtkEngine(arguments.task.row, arguments.path, arguments.isovalue, arguments.threads))
    return engine;
#endif
  throw Error(fmt::format("there is no row '{}'; --list names them", arguments.task.row));
}

int run(int argc, char** argv) {
  if (argc >= 2 && std::string_view(argv[1]) == "--list") {
    fmt::print("{}", textOf(peerRows({argv + 2, argv + argc})));
    return 0;
  }
  PeerArguments arguments;
  CLI::App app("Isosurfaces by VTK and OpenVDB, for 'isobrick bench'. --list names the rows.");
  app.add_option("FILE", arguments.path, "Pyramid (.isb) whose voxels are taken")->required();
  app.add_option("--iso", arguments.isovalue, "Isovalue")->required();
  app.add_option("--threads", arguments.threads, "Threads to use")->check(CLI::Range(1, 1024));
  addRowTaskOptions(app, arguments.task);
  CLI11_PARSE(app, argc, argv);

  // Both libraries run on TBB.
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(arguments.threads));
  const auto engine = makeEngine(arguments);
  fmt::print("{}", textOf(measureRow(arguments.task, *engine)));
  return 0;
}

}  // namespace
}  // namespace isobrick

int main(int argc, char** argv) {
  try {
    return isobrick::run(argc, argv);
  } catch (const std::exception& failure) {
    fmt::print(stderr, "bench_peers: {}\n", isobrick::oneLine(failure.what()));
    return 1;
  }
}
