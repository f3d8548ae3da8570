#include "tools/render/graphics_text.h"

#include <fmt/format.h>

#include <string>

#include "isobrick/viewer/render/gl_device.h"
#include "tools/json_output.h"
#include "tools/text_table.h"

namespace isobrick {
namespace {

void printGraphicsJson(const GraphicsReport& report) {
  Json json = Json::object();
  json["device"] = report.device;
  json["vendor"] = report.vendor;
  json["version"] = report.version;
  json["software"] = report.is_software;
  json["place"] = report.place;
  json["places"] = Json::array();
  for (const GraphicsReport::Place& place : report.places)
    json["places"].push_back({{"name", place.name}, {"about", place.about}});
  json["limits"] = Json::object();
  for (const GlLimits::Row& row : report.limits)
    json["limits"][row.name] = {{"value", row.value}, {"wanted", row.wanted}};
  json["switched_off"] = report.switched_off;
  printJson(json);
}

}  // namespace

void printGraphics(bool json) {
  const GraphicsReport report = graphicsReport();
  if (json) return printGraphicsJson(report);
  fmt::print("device   {}{}\nversion  {}\nvendor   {}\n", report.device,
             report.is_software ? " (the processor draws)" : "", report.version, report.vendor);
  std::string places;
  for (const GraphicsReport::Place& place : report.places)
    places += fmt::format("{}{}{}", places.empty() ? "" : ", ", place.name,
                          place.about.empty() ? "" : " (" + place.about + ")");
  fmt::print("found    {}, of {} (ISOBRICK_GRAPHICS chooses)\n\n", report.place, places);
  TextTable table("LRRL");
  table.add({"limit", "here", "wanted", "with less"});
  for (const GlLimits::Row& row : report.limits)
    table.add({row.name, std::to_string(row.value),
               row.wanted == 0 ? "-" : std::to_string(row.wanted), row.with_less});
  fmt::print("{}\n", table.text());
  if (report.switched_off.empty()) fmt::print("Nothing is switched off.\n");
  for (const std::string& line : report.switched_off) fmt::print("Here {}.\n", line);
}

}  // namespace isobrick
