#include "tools/bench/row_measurement.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <sstream>

#include "isobrick/storage/error.h"
#include "tools/bench/process_memory.h"
#include "tools/json_output.h"
#include "tools/progress_bar.h"

namespace isobrick {
namespace {

double processorSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

template <typename Work>
double secondsOf(Work work) {
  const Stopwatch watch;
  work();
  return watch.seconds();
}

template <typename Measurement, typename F>
void forEachField(Measurement& m, F&& f) {
  f("triangles", m.size.triangles);
  f("vertices", m.size.vertices);
  f("output_bytes", m.size.bytes);
  f("load_seconds", m.load_seconds);
  f("prepare_seconds", m.prepare_seconds);
  f("first_seconds", m.first_seconds);
  f("seconds", m.seconds);
  f("processor_seconds", m.processor_seconds);
  f("loaded_rss_bytes", m.loaded_rss_bytes);
  f("peak_rss_bytes", m.peak_rss_bytes);
  f("huge_page_bytes", m.huge_page_bytes);
  f("note", m.note);
}

}  // namespace

RowMeasurement measureRow(const RowTask& task, SurfaceEngine& engine) {
  if (!task.huge_pages) refuseHugePages();
  RowMeasurement result;
  const double begin = processorSeconds();
  result.load_seconds = secondsOf([&] { engine.load(); });
  result.prepare_seconds = secondsOf([&] { engine.prepare(); });
  result.loaded_rss_bytes = peakOfProcess();
  forgetPeak();
  result.first_seconds = secondsOf([&] { engine.extract(); });

  result.processor_seconds = processorSeconds() - begin;
  if (task.cold) {
    result.seconds = {result.load_seconds + result.prepare_seconds + result.first_seconds};
  } else {
    const double before = processorSeconds();
    for (int i = 0; i < task.repeats; ++i)
      result.seconds.push_back(secondsOf([&] { engine.extract(); }));
    result.processor_seconds = (processorSeconds() - before) / task.repeats;
  }

  result.size = engine.size();
  result.peak_rss_bytes = peakOfProcess();
  result.huge_page_bytes = hugePageBytes();
  result.note = engine.note();
  if (!task.mesh_path.empty()) writePlainMesh(engine.mesh(), task.mesh_path);
  return result;
}

std::string textOf(const RowMeasurement& measurement) {
  Json json = Json::object();
  forEachField(measurement, [&](const char* name, const auto& value) { json[name] = value; });
  return json.dump() + "\n";
}

RowMeasurement rowMeasurementOf(const std::string& text) {
  try {
    const Json json = Json::parse(text);
    RowMeasurement m;
    forEachField(m, [&](const char* name, auto& value) { json.at(name).get_to(value); });
    if (!m.seconds.empty()) return m;
  } catch (const Json::exception&) {
    // reported below
  }
  throw Error(
      fmt::format("'{}' is not what a row's process reports; build isobrick and "
                  "bench_peers from the same sources",
                  text.substr(0, 80)));
}

void addRowTaskOptions(CLI::App& app, RowTask& task) {
  app.add_option("--row", task.row, "Which row to measure")->type_name("NAME")->required();
  app.add_option("--repeat", task.repeats, "Measured extractions, after one that is not")
      ->type_name("N")
      ->check(CLI::Range(1, 1000000));
  app.add_flag("--cold", task.cold, "Measure the first extraction, with reading the volume");
  app.add_flag("!--no-huge-pages", task.huge_pages, "Refuse huge pages");
  app.add_option("--mesh", task.mesh_path, "Where to write the mesh, for distances")
      ->type_name("PATH");
}

std::vector<std::string> rowTaskWords(const RowTask& task) {
  std::vector<std::string> words = {"--row", task.row, "--repeat", std::to_string(task.repeats)};
  if (task.cold) words.emplace_back("--cold");
  if (!task.huge_pages) words.emplace_back("--no-huge-pages");
  if (!task.mesh_path.empty()) words.insert(words.end(), {"--mesh", task.mesh_path});
  return words;
}

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
