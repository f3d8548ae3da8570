#include "tools/bench/bench_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <numeric>
#include <thread>

#include "tools/text_table.h"

namespace isobrick {
namespace {

constexpr double kMebi = 1024 * 1024;

std::string processorName() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  return "unknown";
}

// The figures of one row over all rounds.
struct RowSummary {
  Spread seconds, load_seconds, prepare_seconds, first_seconds, processor_seconds;
  std::vector<double> all_seconds;
  double busy_cores = 0;  // processor time by wall time
  std::uint64_t loaded_rss_bytes = 0, peak_rss_bytes = 0, huge_page_bytes = 0;  // the greatest
  SurfaceSize size;
  std::string note;
};

RowSummary summaryOf(const BenchRow& row) {
  RowSummary sum;
  std::vector<double> load, prepare, first, processor, busy;
  for (const RowMeasurement& m : row.measurements) {
    sum.all_seconds.insert(sum.all_seconds.end(), m.seconds.begin(), m.seconds.end());
    load.push_back(m.load_seconds);
    prepare.push_back(m.prepare_seconds);
    first.push_back(m.first_seconds);
    processor.push_back(m.processor_seconds);
    const double wall = std::accumulate(m.seconds.begin(), m.seconds.end(), 0.0);
    busy.push_back(m.processor_seconds * static_cast<double>(m.seconds.size()) / wall);
    sum.loaded_rss_bytes = std::max(sum.loaded_rss_bytes, m.loaded_rss_bytes);
    sum.peak_rss_bytes = std::max(sum.peak_rss_bytes, m.peak_rss_bytes);
    sum.huge_page_bytes = std::max(sum.huge_page_bytes, m.huge_page_bytes);
  }
  sum.seconds = spreadOf(sum.all_seconds);
  sum.load_seconds = spreadOf(load);
  sum.prepare_seconds = spreadOf(prepare);
  sum.first_seconds = spreadOf(first);
  sum.processor_seconds = spreadOf(processor);
  sum.busy_cores = spreadOf(busy).median;
  sum.size = row.measurements.back().size;
  sum.note = row.measurements.back().note;
  return sum;
}

bool isMeasured(const BenchRow& row) { return row.failure.empty() && !row.measurements.empty(); }

// The row that the others of its setting are compared with: the fastest peer that is exact, or our
// own; nullptr if neither was measured.
const BenchRow* referenceFor(const BenchRow& row, const std::vector<BenchRow>& rows) {
  for (const char* name : {"vtkFlyingEdges3D", kFinestRow})
    for (const BenchRow& other : rows)
      if (other.name == name && other.cold == row.cold && other.huge_pages == row.huge_pages &&
          isMeasured(other))
        return &other;
  return nullptr;
}

double volumeOf(const BenchScene& scene) { return static_cast<double>(elementCount(scene.voxels)); }

Json jsonOf(const Spread& spread) {
  return {{"median", spread.median}, {"min", spread.min}, {"max", spread.max}};
}

Json jsonOf(const OneWayDistance& d) {
  return {{"mean", d.mean}, {"p99", d.p99}, {"max", d.max}, {"points", d.points}};
}

Json jsonOfRow(const BenchRow& row, const BenchSettings& settings, const BenchScene& scene,
               const std::vector<BenchRow>& rows) {
  Json json = {{"name", row.name},
               {"threads", settings.threads},
               {"cache", row.cold ? "cold" : "warm"},
               {"huge_pages", row.huge_pages}};
  if (!isMeasured(row)) {
    json["failure"] = row.failure;
    return json;
  }
  const RowSummary sum = summaryOf(row);
  const double median = sum.seconds.median;
  json["triangles"] = sum.size.triangles;
  json["vertices"] = sum.size.vertices;
  json["seconds"] = jsonOf(sum.seconds);
  json["seconds"]["all"] = sum.all_seconds;
  json["first_seconds"] = jsonOf(sum.first_seconds);
  json["load_seconds"] = jsonOf(sum.load_seconds);
  json["prepare_seconds"] = jsonOf(sum.prepare_seconds);
  json["processor_seconds"] = jsonOf(sum.processor_seconds);
  json["mtri_s"] = 1e-6 * static_cast<double>(sum.size.triangles) / median;
  json["mvoxel_s"] = 1e-6 * volumeOf(scene) / median;
  json["busy_cores"] = sum.busy_cores;
  json["peak_rss_bytes"] = sum.peak_rss_bytes;
  json["loaded_rss_bytes"] = sum.loaded_rss_bytes;
  json["output_bytes"] = sum.size.bytes;
  json["huge_page_bytes"] = sum.huge_page_bytes;
  if (const BenchRow* const reference = referenceFor(row, rows)) {
    json["ratio"] = summaryOf(*reference).seconds.median / median;
    json["ratio_to"] = reference->name;
  }
  if (row.cold)
    json["cached_share_before"] =
        *std::max_element(row.cached_shares.begin(), row.cached_shares.end());
  if (row.error)
    json["distance"] = {{"to_finest", jsonOf(row.error->to_finest)},
                        {"from_finest", jsonOf(row.error->from_finest)}};
  if (!sum.note.empty()) json["note"] = sum.note;
  return json;
}

std::string mebibytes(std::uint64_t bytes) {
  return fmt::format("{:.0f}", static_cast<double>(bytes) / kMebi);
}

std::string milliseconds(double seconds) { return fmt::format("{:.1f}", 1e3 * seconds); }

// The rows of one setting.
std::string textOfSetting(const std::vector<const BenchRow*>& group, const BenchScene& scene,
                          const std::vector<BenchRow>& rows) {
  const BenchRow* const reference = referenceFor(*group.front(), rows);
  TextTable table("LRRRRRRRRRRRRR");
  table.add({"", "triangles", "median ms", "min", "max", "CPU ms", "first", "prepare", "Mtri/s",
             "Mvoxel/s", "cores", "peak MiB", "mesh MiB", reference != nullptr ? "ratio" : ""});
  std::string failures;
  for (const BenchRow* const row : group) {
    if (!isMeasured(*row)) {
      failures += fmt::format("{}: {}\n", row->name, row->failure);
      continue;
    }
    const RowSummary sum = summaryOf(*row);
    const double median = sum.seconds.median;
    table.add({row->name, fmt::format("{}", sum.size.triangles), milliseconds(median),
               milliseconds(sum.seconds.min), milliseconds(sum.seconds.max),
               milliseconds(sum.processor_seconds.median), milliseconds(sum.first_seconds.median),
               milliseconds(sum.prepare_seconds.median),
               fmt::format("{:.1f}", 1e-6 * static_cast<double>(sum.size.triangles) / median),
               fmt::format("{:.0f}", 1e-6 * volumeOf(scene) / median),
               fmt::format("{:.2f}", sum.busy_cores), mebibytes(sum.peak_rss_bytes),
               mebibytes(sum.size.bytes),
               reference == nullptr
                   ? ""
                   : fmt::format("{:.2f}", summaryOf(*reference).seconds.median / median)});
  }
  return table.text() +
         (reference != nullptr
              ? fmt::format("ratio: how many times as fast as {}\n", reference->name)
              : "") +
         failures;
}

std::string textOfErrors(const std::vector<BenchRow>& rows) {
  TextTable table("LRRRRRRR");
  table.add({"", "triangles", "mean", "99 %", "max", "back: mean", "99 %", "max"});
  std::vector<std::string> told;
  for (const BenchRow& row : rows) {
    if (!row.error || std::find(told.begin(), told.end(), row.name) != told.end()) continue;
    told.push_back(row.name);
    std::vector<std::string> cells = {row.name,
                                      fmt::format("{}", row.measurements.back().size.triangles)};
    for (const OneWayDistance& d : {row.error->to_finest, row.error->from_finest})
      for (const double voxels : {d.mean, d.p99, d.max})
        cells.push_back(fmt::format("{:.4f}", voxels));
    table.add(std::move(cells));
  }
  if (told.empty()) return {};
  return "\nvoxels from it to the finest surface, and back\n" + table.text();
}

}  // namespace

double machineLoad() {
  std::array<double, 1> load{0};
  return getloadavg(load.data(), 1) == 1 ? load[0] : 0;
}

BenchScene makeBenchScene(const Index3& voxels, const std::string& voxel_type) {
  BenchScene scene;
  scene.voxels = voxels;
  scene.voxel_type = voxel_type;
  scene.processor = processorName();
  scene.cores = static_cast<int>(std::thread::hardware_concurrency());
  scene.load_before = machineLoad();
  return scene;
}

Json jsonOfBench(const BenchSettings& settings, const BenchScene& scene,
                 const std::vector<BenchRow>& rows) {
  Json json = {{"file", settings.path},
               {"dimensions", isobrick::jsonOf(scene.voxels)},
               {"voxel_type", scene.voxel_type},
               {"isovalue", settings.isovalue},
               {"query", settings.query_words},
               {"threads", settings.threads},
               {"rounds", settings.rounds},
               {"repeats", settings.repeats},
               {"processor", scene.processor},
               {"cores", scene.cores},
               {"load", {{"before", scene.load_before}, {"after", scene.load_after}}}};
  json["rows"] = Json::array();
  for (const BenchRow& row : rows) json["rows"].push_back(jsonOfRow(row, settings, scene, rows));
  return json;
}

std::string textOfBench(const BenchSettings& settings, const BenchScene& scene,
                        const std::vector<BenchRow>& rows) {
  std::string text = fmt::format(
      "{}: {} x {} x {} {}, isovalue {}, {} threads, {} rounds\n{}, {} cores, load {:.2f} before "
      "and {:.2f} after\n",
      settings.path, scene.voxels.x, scene.voxels.y, scene.voxels.z, scene.voxel_type,
      settings.isovalue, settings.threads, settings.rounds, scene.processor, scene.cores,
      scene.load_before, scene.load_after);
  for (const bool cold : settings.cold)
    for (const bool huge_pages : settings.huge_pages) {
      std::vector<const BenchRow*> group;
      for (const BenchRow& row : rows)
        if (row.cold == cold && row.huge_pages == huge_pages) group.push_back(&row);
      if (group.empty()) continue;
      text += fmt::format("\n{}, {} huge pages\n",
                          cold ? "cold: from the file on the disk to the mesh" : "warm",
                          huge_pages ? "with" : "without");
      text += textOfSetting(group, scene, rows);
    }
  return text + textOfErrors(rows);
}

}  // namespace isobrick
