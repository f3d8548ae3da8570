#include "tools/choice_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <numbers>
#include <sstream>

#include "isobrick/storage/error.h"
#include "tools/parse_text.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

double parseAboveZero(const std::string& text) {
  const double value = parseNumber(text);
  if (!(value > 0)) throw std::invalid_argument(fmt::format("'{}' is not above 0", text));
  return value;
}

double parseFieldOfView(const std::string& text) {
  const double degrees = parseAboveZero(text);
  if (!(degrees < 180)) throw std::invalid_argument(fmt::format("'{}' is not below 180", text));
  return degrees;
}

ViewPoint makeView(const ChoiceOptions& options) {
  ViewPoint view;
  view.eye = *options.eye;
  view.pixels_per_radian = options.pixels_per_radian.value_or(view.pixels_per_radian);
  view.pixels_per_unit = options.pixels_per_unit;
  view.pixels = options.pixels.value_or(view.pixels);
  if (options.look_at) {
    view.field = ViewPoint::Field{};
    view.field->direction = *options.look_at - *options.eye;
    view.field->half_angle =
        options.field_of_view.value_or(kDefaultFieldOfView) * std::numbers::pi / 360;
    view.field->radius = options.field_radius.value_or(0);
  }
  return view;
}

void addViewOptions(CLI::App& app, ChoiceOptions& options) {
  CLI::Option* const eye = addParsedOption(
      app, "--eye", options.eye, parserOfLengths(parsePoint, options.eye_has_unit), "X,Y,Z[mm]",
      "Seen from this world point: refine what covers more than --pixels of the picture");
  CLI::Option* const per_radian = addParsedOption(
      app, "--pixels-per-radian", options.pixels_per_radian, parseAboveZero, "P",
      "The picture's height in pixels over its field of view in radians; default: 1000");
  CLI::Option* const per_unit =
      addParsedOption(app, "--pixels-per-unit", options.pixels_per_unit, parseAboveZero, "Q",
                      "Of a parallel projection: pixels per world unit");
  CLI::Option* const pixels = addParsedOption(app, "--pixels", options.pixels, parseAboveZero, "T",
                                              "Pixels that a cell's edge may cover; default: 1");
  CLI::Option* const look_at =
      addParsedOption(app, "--look-at", options.look_at,
                      parserOfLengths(parsePoint, options.eye_has_unit), "X,Y,Z[mm]",
                      "A world point in the middle of the picture: coarser outside of the field; "
                      "'render' draws the picture from there");
  CLI::Option* const angle =
      addParsedOption(app, "--field-of-view", options.field_of_view, parseFieldOfView, "DEGREES",
                      "From corner to corner of the picture; default: 90");
  CLI::Option* const radius =
      addParsedOption(app, "--field-radius", options.field_radius,
                      parserOfLengths(parseAboveZero, options.eye_has_unit), "R[mm]",
                      "Of a parallel projection: half of that, in world units");
  for (CLI::Option* const option : {per_radian, per_unit, pixels, look_at}) option->needs(eye);
  for (CLI::Option* const option : {angle, radius}) option->needs(look_at);
  per_radian->excludes(per_unit);
  radius->needs(per_unit);
  angle->excludes(per_unit);
}

}  // namespace

void addChoiceOptions(CLI::App& app, ChoiceOptions& options) {
  CLI::Option* const focus = addParsedOption(
      app, "--focus", options.focus, parserOfLengths(parsePoint, options.focus_in_world),
      "X,Y,Z[mm]",
      "Centre of interest in voxel indices: finest around it, coarser with distance. With a unit, "
      "75,30,75mm, a point of the world");
  CLI::Option* const radius = addParsedOption(
      app, "--radius", options.radius, parserOfLengths(numberFrom(0), options.radius_in_world),
      "R[mm]",
      "Radius of interest in voxels: everything within is of the finest level. With a unit, 10mm "
      "or 500um, in the world");
  focus->needs(radius);
  radius->needs(focus);
  CLI::Option* const curvature = addParsedOption(
      app, "--curvature", options.curvature_tolerance, numberFrom(0), "T",
      "Leave parts at level 1 where the total curvature is at most T, in 1/voxel^2");
  CLI::Option* const rho =
      addParsedOption(app, "--curvature-radius", options.curvature_radius, parseAboveZero, "RHO",
                      "The same for parts flatter than a sphere of RHO voxels: T = 1/(2 RHO^2)");
  curvature->excludes(rho);
  addViewOptions(app, options);
  addLevelOption(app, options.level, 63)->excludes(focus);
}

bool isFinest(const ChoiceOptions& options) {
  const bool chooses = options.focus || options.radius || options.curvature_tolerance ||
                       options.curvature_radius || options.eye || options.pixels_per_radian ||
                       options.pixels_per_unit || options.pixels || options.look_at ||
                       options.field_of_view || options.field_radius;
  return !chooses && options.level.value_or(0) == 0;
}

ChoiceOptions parseChoice(const std::string& text) {
  ChoiceOptions options;
  CLI::App app;
  app.set_help_flag();
  addChoiceOptions(app, options);
  std::vector<std::string> words;
  std::istringstream stream(text);
  for (std::string word; stream >> word;) {
    if (word.find('=') == std::string::npos)
      throw std::invalid_argument(fmt::format("'{}' is not NAME=VALUE", word));
    words.push_back("--" + word);
  }
  if (words.empty()) throw std::invalid_argument("it names nothing; give NAME=VALUE pairs");
  std::reverse(words.begin(), words.end());  // as CLI11 takes them
  try {
    app.parse(words);
  } catch (const CLI::ParseError& failure) {
    throw std::invalid_argument(failure.what());
  }
  return options;
}

void refuseUnitOfUnknown(const GridGeometry& geometry, const char* option) {
  if (geometry.unit == LengthUnit::kUnknown)
    throw Error(
        fmt::format("{} is given with a unit, and that of the volume is unknown; give it in "
                    "voxels, whose least spacing is {}, or with --world in the volume's own unit",
                    option, geometry.leastSpacing()));
}

DetailChoice makeChoice(const ChoiceOptions& options, bool world, const Pyramid& pyramid) {
  const GridGeometry& geometry = pyramid.spec().geometry;
  DetailChoice choice;
  if (options.focus) {
    if (options.focus_in_world) refuseUnitOfUnknown(geometry, "--focus");
    if (options.radius_in_world) refuseUnitOfUnknown(geometry, "--radius");
    choice.focus.emplace();
    choice.focus->center =
        world || options.focus_in_world ? geometry.worldToIndex(*options.focus) : *options.focus;
    choice.focus->radius = world || options.radius_in_world
                               ? *options.radius / geometry.leastSpacing()
                               : *options.radius;
  }
  choice.uniform_level = options.level;
  choice.curvature_tolerance = options.curvature_tolerance;
  if (options.curvature_radius) {
    const double rho = *options.curvature_radius;
    choice.curvature_tolerance = 1 / (2 * rho * rho);
  }
  if (options.eye_has_unit) refuseUnitOfUnknown(geometry, "--eye, --look-at or --field-radius");
  if (options.eye) choice.view = makeView(options);
  return choice;
}

}  // namespace isobrick
