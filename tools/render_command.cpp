// isobrick render: a picture of one isosurface, without a window.
#include <fmt/format.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <numbers>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/abandonable.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/state/view_history.h"
#include "isobrick/viewer/view_picture.h"
#include "tools/byte_size.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/output_check.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"
#include "tools/query_options.h"
#include "tools/render/picture_output.h"
#include "tools/render/picture_surface.h"
#include "tools/shared_options.h"
#include "tools/stopwatch.h"
#include "tools/thread_count.h"

namespace isobrick {
namespace {

struct RenderArguments {
  QueryOptions query;
  std::string output;
  PrintSize print_size{1024.0, 1024.0, false};
  std::optional<double> pixels_per_inch;
  PixelSize size;  // both together
  RenderOptions picture;
  bool show_focus = false;
  bool force = false;
  // Saved views, in place of most of the above: one, or the stops of the camera's path.
  std::vector<std::string> states;
  int pictures = 1;  // more: a turntable, or along the path
  double pictures_per_second = 25.0;
};

std::vector<std::string> inputsOf(const RenderArguments& arguments) {
  std::vector<std::string> inputs = arguments.states;
  inputs.push_back(arguments.query.input.path);
  return inputs;
}

// The query's eye, if it looks at something, is the picture's; sizes in pixels are then those of
// this picture, unless the user gave others.
void placeEye(RenderArguments& arguments) {
  ChoiceOptions& choice = arguments.query.choice;
  if (!choice.eye || !choice.look_at || choice.pixels_per_unit) return;
  LookAtCamera& camera = arguments.picture.look_at.emplace();
  camera.eye = *choice.eye;
  camera.target = *choice.look_at;
  const glm::dvec3 forward = glm::normalize(camera.target - camera.eye);
  if (std::abs(glm::dot(forward, camera.up)) > 0.999) camera.up = {0.0, 1.0, 0.0};
  // From corner to corner, and from the lower edge to the upper one.
  const double diagonal =
      choice.field_of_view.value_or(kDefaultFieldOfView) * std::numbers::pi / 180;
  const double height = arguments.size.height;
  const double vertical =
      2 * std::atan(std::tan(diagonal / 2) * height / std::hypot(height, arguments.size.width));
  arguments.picture.vertical_fov = vertical * 180 / std::numbers::pi;
  if (!choice.pixels_per_radian) choice.pixels_per_radian = height / vertical;
}

PictureLegend legendOf(const RenderOptions& options, const PictureSurface& surface) {
  PictureLegend legend;
  if (options.color_by_component) {
    addPieces({surface.pieces}, surface.unit, legend);
    return legend;
  }
  if (!options.color_by_level) {
    legend.patches.push_back(
        {options.surface_color, fmt::format("isovalue {:.6g}", surface.isovalue)});
    return legend;
  }
  std::set<int> levels;
  for (const SurfaceChunk& chunk : surface.chunks) levels.insert(chunk.level);
  for (const int level : levels)
    legend.patches.push_back({levelColor(level), fmt::format("level {}", level)});
  return legend;
}

RenderOptions makeRenderOptions(const RenderArguments& arguments, const PictureSurface& surface) {
  RenderOptions options = arguments.picture;
  options.width = arguments.size.width;
  options.height = arguments.size.height;
  if (arguments.show_focus) options.focus_sphere = surface.focus;
  options.notes.unit = surface.unit;
  options.notes.meaning = legendOf(options, surface);
  return options;
}

std::shared_ptr<PictureOutput> outputOf(const RenderArguments& arguments) {
  PicturePlan plan;
  plan.output = arguments.output;
  plan.pictures = arguments.pictures;
  plan.pictures_per_second = arguments.pictures_per_second;
  plan.pixels_per_inch = arguments.pixels_per_inch.value_or(0.0);
  plan.megapixels = 1e-6 * arguments.size.width * arguments.size.height;
  plan.inputs = inputsOf(arguments);
  plan.force = arguments.force;
  return std::make_shared<PictureOutput>(std::move(plan));
}

std::string sizeText(const RenderArguments& arguments) {
  const std::string size =
      fmt::format("{} x {} pixels", arguments.size.width, arguments.size.height);
  return arguments.pictures > 1 ? fmt::format("{} pictures of {}", arguments.pictures, size) : size;
}

// Draws saved views as `isobrick view` shows them.
int renderStates(RenderArguments& arguments) {
  const std::shared_ptr<PictureOutput> output = outputOf(arguments);
  findPyramid(arguments.query);
  std::vector<ViewState> views;
  for (const std::string& path : arguments.states) views.push_back(readView(path).state);
  if (arguments.pictures > 1)
    views = views.size() == 1 ? turntable(views.front(), arguments.pictures)
                              : viewsAlong(views, arguments.pictures);
  const Stopwatch watch;
  std::uint64_t triangles = 0;
  std::string device;
  runWithThreads(arguments.query.threads, [&] {
    const auto pyramid =
        openPyramidFile(arguments.query.input.pyramid, arguments.query.memory_bytes,
                        fileAccess(arguments.query.no_map), remoteOptions(arguments.query.input));
    const ViewDrawing drawing{arguments.size.width, arguments.size.height, arguments.query.threads,
                              output->format() == ImageFormat::kExr};
    drawViews(pyramid, views, drawing, interruptFlag(), [&](ViewRows rows) {
      triangles = rows.triangles;
      device = rows.device;
      output->add(rows.picture, rows.shape, std::move(rows.rows), rows.share);
    });
  });
  output->finish();
  fmt::print("{}: {}, {} triangles; {:.2f} s ({})\n", arguments.output, sizeText(arguments),
             countText(triangles), watch.seconds(), device);
  return 0;
}

// One picture, or those of a turntable.
int runRender(RenderArguments arguments) {
  // A mistyped name, or a machine that cannot draw, must not cost an extraction.
  const std::shared_ptr<PictureOutput> output = outputOf(arguments);
  const auto renderer = std::make_shared<OffscreenRenderer>();
  findPyramid(arguments.query);
  placeEye(arguments);
  const Stopwatch extract_watch;
  PictureSurface surface = runWithThreads(arguments.query.threads, [&] {
    return extractPictureSurface(arguments.query, arguments.picture.color_by_component);
  });
  const double extract_seconds = extract_watch.seconds();

  const Stopwatch draw_watch;
  std::vector<RenderOptions> options{makeRenderOptions(arguments, surface)};
  if (arguments.pictures > 1) options = turntable(options.front(), surface, arguments.pictures);
  const PictureShape shape{arguments.size.width, arguments.size.height};
  const auto chunks = std::make_shared<std::vector<SurfaceChunk>>(std::move(surface.chunks));
  try {
    // OpenGL does not stop before its end.
    runAbandonable(&interruptFlag(), [renderer, chunks, output, shape, lattice = surface.lattice,
                                      options = std::move(options)] {
      renderer->renderRows(std::move(*chunks), lattice, options,
                           [&](std::size_t picture, Image rows, double share) {
                             output->add(picture, shape, std::move(rows), share);
                           });
      return true;
    });
    output->finish();
  } catch (const Cancelled&) {
    output->giveUp();
    throw;
  }
  fmt::print("{}: {}, {} triangles; extract {:.2f} s, draw {:.2f} s ({})\n", arguments.output,
             sizeText(arguments), countText(surface.triangles), extract_seconds,
             draw_watch.seconds(), renderer->deviceName());
  return 0;
}

void checkArguments(RenderArguments& arguments, bool has_isovalue) {
  const std::size_t states = arguments.states.size();
  if (states == 0 && !has_isovalue) throw UsageError("--iso is required, or --state");
  if (states > 1 && arguments.pictures == 1)
    throw UsageError("several --state are the stops of a path; say how many --pictures it has");
  if (arguments.pictures == 1 && isSequenceName(arguments.output))
    throw UsageError(
        fmt::format("'{}' is a name of many pictures; say how many --pictures", arguments.output));
  if (arguments.pictures > 1 && arguments.query.choice.look_at)
    throw UsageError("--pictures turns the picture around; leave out --look-at");
  if (arguments.print_size.in_millimetres && !arguments.pixels_per_inch)
    arguments.pixels_per_inch = 300.0;
  arguments.size = arguments.print_size.pixels(arguments.pixels_per_inch.value_or(300.0));
  const auto [width, height] = arguments.size;
  if (width > kMostPictureSide || height > kMostPictureSide)
    throw UsageError(fmt::format("--size gives {} x {} pixels, which is too large; at most {} each",
                                 width, height, kMostPictureSide));
}

// "dark", "light", "white", or a colour.
glm::vec3 parseBackground(RenderOptions& picture, const std::string& text) {
  for (const Background& background : kBackgrounds)
    if (text == background.name) {
      picture.background_bottom = background.bottom;
      return background.top;
    }
  return picture.background_bottom = parseColor(text);
}

void addPictureOptions(CLI::App& app, RenderArguments& arguments) {
  RenderOptions& picture = arguments.picture;
  beginGroup(app, kPictureGroup);
  addParsedOption(app, "--size", arguments.print_size, parsePrintSize, "WxH",
                  "Pixels, or, with --dpi, millimetres such as 85x60mm; default: 1024x1024");
  addParsedOption(
      app, "--dpi", arguments.pixels_per_inch, numberFrom(1.0), "N",
      "Pixels per inch of a print, which the picture keeps; default for millimetres: 300");
  addParsedOption(app, "--pictures", arguments.pictures, integerWithin(2, 100000), "N",
                  "So many pictures: all around the surface, or along the path of several --state");
  addParsedOption(app, "--pictures-per-second", arguments.pictures_per_second, numberFrom(0.1), "N",
                  "Of a movie; default: 25")
      ->needs(findOption(app, "--pictures"));
  addParsedOption(app, "--azimuth", picture.orbit.azimuth, parseNumber, "DEGREES",
                  "Walk around the surface, to the right; 0 looks along +y; default: 25");
  addParsedOption(app, "--elevation", picture.orbit.elevation, parseNumber, "DEGREES",
                  "Look from above, up to 90, or from below; default: 15");
  app.add_flag("--color-by-level", picture.color_by_level,
               "Colour triangles by their level: red for 0, then yellow, green, blue");
  app.add_flag("--color-by-component", picture.color_by_component,
               "Colour the connected pieces by their area: orange for the largest, then sky blue, "
               "green, yellow, blue, red, purple, and again")
      ->excludes(findOption(app, "--color-by-level"));
  app.add_flag("--wireframe", picture.wireframe, "Draw the edges of the triangles");
  app.add_flag("--ambient-occlusion", picture.ambient_occlusion, "Darken the surface in hollows");
  app.add_flag("--shadow", picture.shadow, "The surface throws a soft shadow on itself");
  app.add_flag("--scale-bar", picture.notes.scale_bar,
               "Draw a scale bar; it measures in the middle of what is framed");
  app.add_flag("--axes", picture.notes.axes, "Draw the directions of the world's x, y and z");
  app.add_flag("--legend", picture.notes.legend, "Draw what the colours mean");
  app.add_flag("--show-focus", arguments.show_focus, "Draw the outline of the sphere of interest")
      ->needs(findOption(app, "--focus"));
  addParsedOption(app, "--color", picture.surface_color, parseColor, "R,G,B",
                  "Colour of the surface, sRGB from 0 to 1");
  addParsedOption(app, "--background-top", picture.background_top, parseColor, "R,G,B",
                  "Colour at the upper edge of the picture");
  addParsedOption(app, "--background-bottom", picture.background_bottom, parseColor, "R,G,B",
                  "Colour at the lower edge");
  addParsedOption(
      app, "--background", picture.background_top,
      [&picture](const std::string& text) { return parseBackground(picture, text); },
      "dark|light|white|R,G,B",
      "Both of them: for screens (default), slides or print; or a colour");
}

}  // namespace

Command addRenderCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("render", "Draw an isosurface of a pyramid or a volume to a file");
  const auto arguments = std::make_shared<RenderArguments>();
  addQueryOptions(*sub, arguments->query);
  beginGroup(*sub, kOutputGroup);
  sub->add_option("-o,--output", arguments->output,
                  "Output; a picture, .png (8 bits, sRGB) or .exr (half floats, linear); with "
                  "--pictures folder/%04d.png, or a movie, .mp4")
      ->type_name("IMAGE")
      ->required();
  addForceFlag(*sub, arguments->force);
  addPictureOptions(*sub, *arguments);
  CLI::Option* const state =
      sub->add_option(
             "--state", arguments->states,
             "Saved view; as 'isobrick view' wrote it, in place of --iso and of all that says "
             "what is seen from where; several are the stops of a path")
          ->type_name("VIEW.json")
          ->allow_extra_args(false);
  CLI::Option* const isovalue = findOption(*sub, "--iso")->required(false);
  for (CLI::Option* const option : optionsBeside(
           *sub, {"FILE", "--output", "--size", "--dpi", "--pictures", "--pictures-per-second",
                  "--memory", "--help", "--threads", "--state", "--force", "--no-map"}))
    state->excludes(option);
  sub->footer(R"(
Example:
  isobrick render head.isb --iso 500 --size 800x600 --azimuth 40 -o skin.png)");
  return {sub, [arguments, state, isovalue] {
            checkArguments(*arguments, isovalue->count() > 0);
            if (state->count() > 0) return renderStates(*arguments);
            return runRender(*arguments);
          }};
}

}  // namespace isobrick
