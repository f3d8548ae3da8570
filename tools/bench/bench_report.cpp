#include "tools/bench/bench_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <numeric>
#include <thread>

#include "tools/plain_text.h"

namespace isobrick {
namespace {

std::string processorName() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  return "unknown";
}

// `values` has one value at least. Between two in the middle the median is their mean.
Json spreadOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  const double median =
      values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
  return {{"median", median}, {"min", values.front()}, {"max", values.back()}};
}

Json jsonOf(const OneWayDistance& d) {
  return {{"mean", d.mean}, {"p99", d.p99}, {"max", d.max}, {"points", d.points}};
}

// The figures of one row over all rounds, but for its ratio.
Json jsonOfRow(const BenchRow& row, const BenchSettings& settings, const BenchScene& scene) {
  Json json = {{"name", row.name},
               {"threads", settings.threads},
               {"cache", settings.cold ? "cold" : "warm"}};
  if (!row.isMeasured()) {
    json["failure"] = row.failure;
    return json;
  }
  const auto values = [&](const char* key) {
    std::vector<double> all;
    for (const Json& m : row.measurements) all.push_back(m[key]);
    return all;
  };
  const auto greatest = [&](const char* key) {
    std::uint64_t most = 0;
    for (const Json& m : row.measurements) most = std::max(most, m[key].get<std::uint64_t>());
    return most;
  };
  std::vector<double> all_seconds, busy_cores;
  for (const Json& m : row.measurements) {
    const auto seconds = m["seconds"].get<std::vector<double>>();
    all_seconds.insert(all_seconds.end(), seconds.begin(), seconds.end());
    busy_cores.push_back(m["processor_seconds"].get<double>() *
                         static_cast<double>(seconds.size()) /
                         std::accumulate(seconds.begin(), seconds.end(), 0.0));
  }
  const Json& last = row.measurements.back();
  json["triangles"] = last["triangles"];
  json["vertices"] = last["vertices"];
  json["seconds"] = spreadOf(all_seconds);
  json["seconds"]["all"] = all_seconds;
  for (const char* key : {"first_seconds", "load_seconds", "prepare_seconds", "processor_seconds"})
    json[key] = spreadOf(values(key));
  const double median = json["seconds"]["median"];
  json["mtri_s"] = 1e-6 * last["triangles"].get<double>() / median;
  json["mvoxel_s"] = 1e-6 * static_cast<double>(elementCount(scene.voxels)) / median;
  json["busy_cores"] = spreadOf(busy_cores)["median"];
  for (const char* key : {"peak_rss_bytes", "loaded_rss_bytes", "output_bytes"})
    json[key] = greatest(key);
  if (!row.cached_shares.empty())
    json["cached_share_before"] =
        *std::max_element(row.cached_shares.begin(), row.cached_shares.end());
  if (row.to_finest)
    json["distance"] = {{"to_finest", jsonOf(*row.to_finest)},
                        {"from_finest", jsonOf(*row.from_finest)}};
  if (const std::string note = last["note"]; !note.empty()) json["note"] = note;
  return json;
}

// The others are compared with the fastest peer that is exact, or else with our own row.
void addRatios(Json& rows) {
  for (const std::string reference : {"vtkFlyingEdges3D", kFinestRow}) {
    const auto found = std::find_if(rows.begin(), rows.end(), [&](const Json& row) {
      return row["name"] == reference && row.contains("seconds");
    });
    if (found == rows.end()) continue;
    const double seconds = (*found)["seconds"]["median"];
    for (Json& row : rows)
      if (row.contains("seconds")) {
        row["ratio"] = seconds / row["seconds"]["median"].get<double>();
        row["ratio_to"] = reference;
      }
    return;
  }
}

std::string milliseconds(const Json& seconds) {
  return fmt::format("{:.1f}", 1e3 * seconds.get<double>());
}

std::string mebibytes(const Json& bytes) {
  return fmt::format("{:.0f}", bytes.get<double>() / (1024 * 1024));
}

std::string textOfTimes(const Json& rows) {
  TextTable table("LRRRRRRRRRRRRR");
  table.add({"", "triangles", "median ms", "min", "max", "CPU ms", "first", "prepare", "Mtri/s",
             "Mvoxel/s", "cores", "peak MiB", "mesh MiB", "ratio"});
  std::string failures, reference;
  for (const Json& row : rows) {
    if (!row.contains("seconds")) {
      failures += fmt::format("{}: {}\n", row["name"].get<std::string>(),
                              row["failure"].get<std::string>());
      continue;
    }
    const auto number = [&](const char* key, int digits) {
      return row.contains(key) ? fmt::format("{:.{}f}", row[key].get<double>(), digits) : "";
    };
    const auto median = [&](const char* key) { return milliseconds(row[key]["median"]); };
    reference = row.value("ratio_to", "");
    table.add({row["name"], number("triangles", 0), median("seconds"),
               milliseconds(row["seconds"]["min"]), milliseconds(row["seconds"]["max"]),
               median("processor_seconds"), median("first_seconds"), median("prepare_seconds"),
               number("mtri_s", 1), number("mvoxel_s", 0), number("busy_cores", 2),
               mebibytes(row["peak_rss_bytes"]), mebibytes(row["output_bytes"]),
               number("ratio", 2)});
  }
  if (!reference.empty())
    reference = fmt::format("ratio: how many times as fast as {}\n", reference);
  return table.text() + reference + failures;
}

std::string textOfDistances(const Json& rows) {
  TextTable table("LRRRRRRR");
  table.add({"", "triangles", "mean", "99 %", "max", "back: mean", "99 %", "max"});
  bool any = false;
  for (const Json& row : rows) {
    if (!row.contains("distance")) continue;
    any = true;
    std::vector<std::string> cells = {row["name"], fmt::format("{}", row["triangles"].dump())};
    for (const char* way : {"to_finest", "from_finest"})
      for (const char* key : {"mean", "p99", "max"})
        cells.push_back(fmt::format("{:.4f}", row["distance"][way][key].get<double>()));
    table.add(std::move(cells));
  }
  return any ? "\nvoxels from it to the finest surface, and back\n" + table.text() : "";
}

}  // namespace

double machineLoad() {
  std::array<double, 1> load{0};
  return getloadavg(load.data(), 1) == 1 ? load[0] : 0;
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
               {"processor", processorName()},
               {"cores", std::thread::hardware_concurrency()},
               {"load", {{"before", scene.load_before}, {"after", machineLoad()}}},
               {"rows", Json::array()}};
  for (const BenchRow& row : rows) json["rows"].push_back(jsonOfRow(row, settings, scene));
  addRatios(json["rows"]);
  return json;
}

std::string textOfBench(const Json& bench) {
  const Json &size = bench["dimensions"], &load = bench["load"];
  std::string text = fmt::format(
      "{}: {} x {} x {} {}, isovalue {}, {} threads, {} rounds\n{}, {} cores, load {:.2f} before "
      "and {:.2f} after\n",
      bench["file"].get<std::string>(), size[0].dump(), size[1].dump(), size[2].dump(),
      bench["voxel_type"].get<std::string>(), bench["isovalue"].get<double>(),
      bench["threads"].dump(), bench["rounds"].dump(), bench["processor"].get<std::string>(),
      bench["cores"].dump(), load["before"].get<double>(), load["after"].get<double>());
  const Json& rows = bench["rows"];
  text +=
      rows[0]["cache"] == "cold" ? "\ncold: from the file on the disk to the mesh\n" : "\nwarm\n";
  return text + textOfTimes(rows) + textOfDistances(rows);
}

}  // namespace isobrick
