#include "tools/extract_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <string>
#include <utility>

#include "isobrick/storage/remote_options.h"
#include "tools/plain_text.h"

namespace isobrick {

Json jsonOfQuality(const MeshQuality& quality) {
  return {{"solid", quality.isSolid()},
          {"vertices", quality.vertices},
          {"edges", quality.edges},
          {"triangles", quality.triangles},
          {"open_edges", quality.open_edges},
          {"boundary_loops", quality.boundary_loops},
          {"nonmanifold_edges", quality.nonmanifold_edges},
          {"misoriented_edges", quality.misoriented_edges},
          {"zero_area_triangles", quality.zero_area},
          {"crossing_triangles", quality.crossing},
          {"euler_number", quality.euler},
          {"area", quality.area},
          {"volume", quality.isClosed() ? Json(quality.volume) : Json()},
          {"least_angle", quality.least_angle},
          {"mean_aspect", quality.mean_aspect},
          {"worst_aspect", quality.worst_aspect}};
}

void printQuality(const MeshQuality& quality) {
  const auto faultText = [](std::uint64_t count, const char* fault, const char* none) {
    return count > 0 ? fmt::format("{} {}", countText(count), fault) : std::string(none);
  };
  fmt::print("  check: {}; {}; {}; {}; {}\n",
             quality.isClosed()
                 ? std::string("closed")
                 : fmt::format("open, {} edges in {} loops", countText(quality.open_edges),
                               countText(quality.boundary_loops)),
             faultText(quality.nonmanifold_edges, "edges of more than two triangles", "manifold"),
             faultText(quality.misoriented_edges, "edges with two ways round", "oriented"),
             faultText(quality.zero_area, "triangles without area", "no triangle without area"),
             faultText(quality.crossing, "triangles cross", "none cross"));
  fmt::print(
      "         Euler number {}, area {:.6g}{}; least angle {:.3g} degrees, aspect {:.3g} on "
      "average and {:.3g} at worst\n",
      quality.euler, quality.area,
      quality.isClosed() ? fmt::format(", volume {:.6g}", quality.volume) : "", quality.least_angle,
      quality.mean_aspect, quality.worst_aspect);
}

Json jsonOfComponents(const SurfaceComponents& components) {
  Json json = Json::array();
  for (const SurfaceComponent& one : components.list())
    json.push_back({{"triangles", one.triangles},
                    {"area", one.area},
                    {"volume", one.volume ? Json(*one.volume) : Json()},
                    {"enclosed", one.enclosed ? Json(*one.enclosed) : Json()},
                    {"lower", {one.lower.x, one.lower.y, one.lower.z}},
                    {"upper", {one.upper.x, one.upper.y, one.upper.z}}});
  return json;
}

void printComponents(const SurfaceComponents& components, const std::vector<std::uint8_t>& is_kept,
                     const std::string& ranked_by) {
  constexpr std::size_t kMostLines = 20;
  const std::vector<SurfaceComponent>& list = components.list();
  const auto kept = static_cast<std::uint64_t>(std::ranges::count(is_kept, 1));
  fmt::print("{} components, {} of them kept{}\n", countText(list.size()), countText(kept),
             ranked_by.empty() ? "" : ", the largest by " + ranked_by);
  if (list.empty()) return;
  fmt::print("  {:>6} {:>14} {:>14} {:>14}  box\n", "number", "triangles", "area", "volume");
  for (std::size_t i = 0; i < std::min(list.size(), kMostLines); ++i) {
    const SurfaceComponent& one = list[i];
    fmt::print("  {:>6} {:>14} {:>14.6g} {:>14}  {:.6g},{:.6g},{:.6g} to {:.6g},{:.6g},{:.6g}\n", i,
               countText(one.triangles), one.area,
               one.volume ? fmt::format("{:.6g}", *one.volume) : "has a border", one.lower.x,
               one.lower.y, one.lower.z, one.upper.x, one.upper.y, one.upper.z);
  }
  if (list.size() > kMostLines)
    fmt::print("  and {} smaller ones; --json lists all\n", countText(list.size() - kMostLines));
}
namespace {

Json jsonOfPager(const BrickPager::Counters& counters) {
  return {{"hits", counters.hits},
          {"misses", counters.misses},
          {"loads_joined", counters.loads_joined},
          {"bytes_read", counters.bytes_read},
          {"bytes_unpacked", counters.bytes_unpacked},
          {"evictions", counters.parts_released},
          {"fetched", counters.parts_fetched},
          {"fetched_unused", counters.fetched_unused},
          {"seconds_waited", 1e-9 * static_cast<double>(counters.wait_nanoseconds)}};
}

Json jsonOfRemote(const RemoteCounters& all, const RemoteCounters& opening) {
  return {{"requests", all.requests},
          {"repeated", all.repeated},
          {"bytes", all.bytes},
          {"open_requests", opening.requests},
          {"open_bytes", opening.bytes},
          {"cached_parts", all.cached_parts},
          {"cached_bytes", all.cached_bytes}};
}

Json jsonOfSurface(const ExtractResults& results, const ExtractResult& result) {
  const ExtractionReport& report = result.report;
  Json json = Json::object();
  json["output"] = result.output.empty() ? Json() : Json(result.output);
  Json attributes = Json::array();
  for (std::size_t i = 0; i < results.attributes.size(); ++i) {
    const auto& [name, path] = results.attributes[i];
    attributes.push_back({{"name", name}});
    if (path.empty()) continue;
    attributes.back()["path"] = withoutSecrets(path);
    attributes.back()["vertices_outside"] = result.vertices_outside.at(i);
  }
  if (attributes.size() == 1) json["attribute"] = attributes.front();
  json["attributes"] = std::move(attributes);
  if (!result.file.empty()) json["file"] = withoutSecrets(result.file);
  if (result.quality) json["check"] = jsonOfQuality(*result.quality);
  json["isovalue"] = result.isovalue;
  if (result.label) json["label"] = *result.label;
  if (result.moved)
    json["moved"] = {{"mean", result.moved->mean()},
                     {"most", result.moved->most},
                     {"crossings", result.moved->crossings},
                     {"gone", result.moved->gone}};
  if (results.part) json["part"] = {{"number", results.part->number}, {"of", results.part->of}};
  if (result.simplify) json["simplify"] = result.simplify->distance;
  const auto& [space, mesh_unit, shift] = result.placement;
  if (space != MeshSpace::kLps) json["space"] = space == MeshSpace::kRas ? "RAS" : "index";
  if (!mesh_unit.empty()) json["unit"] = mesh_unit;
  if (shift != glm::dvec3(0.0)) json["shift"] = {shift.x, shift.y, shift.z};
  if (result.components) {
    json["components"] = jsonOfComponents(*result.components);
    json["components_kept"] = std::ranges::count(result.is_kept, 1);
    if (!result.ranked_by.empty()) json["ranked_by"] = result.ranked_by;
  }
  if (result.missing_voxels > 0) json["missing_voxels"] = result.missing_voxels;
  json["triangles"] = report.triangles;
  json["vertices"] = result.vertices;
  json["seconds"] = {{"extract", result.extract_seconds}, {"write", result.write_seconds}};
  if (result.components) json["seconds"]["components"] = result.components_seconds;
  json["levels"] = Json::array();
  for (const LevelCounts& counts : report.levels)
    json["levels"].push_back({{"level", counts.level},
                              {"cells", counts.cells},
                              {"triangles", counts.triangles},
                              {"transition_cells", counts.transition_cells},
                              {"cap_triangles", counts.cap_triangles}});
  json["bricks"] = {{"active", report.bricks_active}, {"read", report.bricks_read}};
  json["bytes_read"] = report.bytes_read;
  json["bytes_active"] = report.bytes_active;
  return json;
}

std::string distanceText(const SimplifyOptions& simplify, LengthUnit unit) {
  const std::string number = fmt::format("{:.4g}", simplify.distance);
  const bool is_one = number == "1";
  if (!simplify.in_world) return number + (is_one ? " voxel" : " voxels");
  if (unit == LengthUnit::kMillimetre) return number + " mm";
  return number + (is_one ? " unit of the world" : " units of the world");
}

void printSummary(const ExtractResult& result, LengthUnit unit) {
  if (result.components) printComponents(*result.components, result.is_kept, result.ranked_by);
  const ExtractionReport& report = result.report;
  fmt::print("{}{} triangles, {} vertices\n", result.output.empty() ? "" : result.output + ": ",
             countText(report.triangles), countText(result.vertices));
  if (result.moved)
    fmt::print("  moved by --denoise: {:.3g} voxels in the mean, {:.3g} at most{}\n",
               result.moved->mean(), result.moved->most,
               result.moved->gone > 0
                   ? fmt::format("; {} of {} crossings of voxel edges are gone",
                                 countText(result.moved->gone),
                                 countText(result.moved->gone + result.moved->crossings))
                   : "");
  if (result.simplify)
    fmt::print("  within {} of {}\n", distanceText(*result.simplify, unit),
               result.is_finest ? "the finest surface" : "this surface without --simplify");
  if (result.quality) printQuality(*result.quality);
  if (result.missing_voxels > 0)
    fmt::print("  open beside voxels without data, of which the volume has {}\n",
               countText(result.missing_voxels));
  const glm::dvec3& shift = result.placement.shift;
  if (shift != glm::dvec3(0.0)) fmt::print("  shifted by {},{},{}\n", shift.x, shift.y, shift.z);
  for (const LevelCounts& counts : report.levels)
    fmt::print("  level {:<2} {:>14} triangles in {} cells, {} of them in transition\n",
               counts.level, countText(counts.triangles), countText(counts.cells),
               countText(counts.transition_cells));
  fmt::print("bricks: {} active of {}, {} read of {}\n", countText(report.bricks_active),
             byteSizeText(report.bytes_active), countText(report.bricks_read),
             byteSizeText(report.bytes_read));
}

}  // namespace

void addResults(ExtractResults one, ExtractResults& all) {
  std::move(one.surfaces.begin(), one.surfaces.end(), std::back_inserter(all.surfaces));
  all.open_seconds += one.open_seconds;
  const auto add = [](auto& sum, const auto& more, auto... counters) {
    ((sum.*counters += more.*counters), ...);
  };
  using Pager = BrickPager::Counters;
  add(all.pager, one.pager, &Pager::hits, &Pager::misses, &Pager::loads_joined, &Pager::parts_read,
      &Pager::bytes_read, &Pager::bytes_unpacked, &Pager::parts_released, &Pager::buffers_beside,
      &Pager::wait_nanoseconds, &Pager::parts_fetched, &Pager::fetched_unused);
  using Remote = RemoteCounters;
  const auto addRemote = [&](Remote& sum, const Remote& more) {
    add(sum, more, &Remote::requests, &Remote::repeated, &Remote::bytes, &Remote::cached_parts,
        &Remote::cached_bytes);
  };
  addRemote(all.opening, one.opening);
  if (!one.remote) return;
  if (!all.remote) all.remote.emplace();
  addRemote(*all.remote, *one.remote);
}

Json jsonOfResults(const ExtractResults& results) {
  Json json = Json::object();
  if (results.surfaces.size() == 1) {
    json = jsonOfSurface(results, results.surfaces.front());
    Json seconds = {{"open", results.open_seconds}};
    seconds.update(json["seconds"]);
    json["seconds"] = std::move(seconds);
  } else {
    json["seconds"] = {{"open", results.open_seconds}};
  }
  json["surfaces"] = Json::array();
  for (const ExtractResult& surface : results.surfaces)
    json["surfaces"].push_back(jsonOfSurface(results, surface));
  json["pager"] = jsonOfPager(results.pager);
  if (results.remote) json["remote"] = jsonOfRemote(*results.remote, results.opening);
  json["peak_rss_bytes"] = peakResidentBytes();
  json["threads"] = results.threads;
  return json;
}

void printResults(const ExtractResults& results) {
  std::string extract_text;
  double write_seconds = 0;
  for (const ExtractResult& result : results.surfaces) {
    if (result.components) extract_text += fmt::format(" {:.4f} +", result.components_seconds);
    if (!result.file.empty()) fmt::print("{}: ", oneLine(withoutSecrets(result.file)));
    if (results.surfaces.size() > 1)
      fmt::print("{}: ", result.label ? fmt::format("label {}", *result.label)
                                      : fmt::format("isovalue {}", result.isovalue));
    printSummary(result, results.unit);
    for (const double seconds : result.extract_seconds)
      extract_text += fmt::format(" {:.4f}", seconds);
    write_seconds += result.write_seconds;
  }
  if (results.remote)
    fmt::print("network: {} requests, {}{}\n", countText(results.remote->requests),
               byteSizeText(results.remote->bytes),
               results.remote->cached_bytes > 0
                   ? fmt::format("; {} from the cache", byteSizeText(results.remote->cached_bytes))
                   : "");
  fmt::print("seconds: open {:.4f}, extract{}, write {:.4f}; {} threads; peak memory {}\n",
             results.open_seconds, extract_text, write_seconds, results.threads,
             byteSizeText(peakResidentBytes()));
}

}  // namespace isobrick
