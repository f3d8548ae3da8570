// isobrick render: a picture of one isosurface, without a window.
#include <fmt/format.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/abandonable.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/state/view_history.h"
#include "tools/byte_size.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/output_check.h"
#include "tools/parse_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/render/picture_output.h"
#include "tools/render/picture_surface.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

struct RenderArguments {
  QueryOptions query;
  std::string output;
  PrintSize print_size{1024.0, 1024.0, false};
  std::optional<double> pixels_per_inch;
  PixelSize size;  // both together
  ViewState view;  // without --state
  PictureLooks looks;
  bool by_level = false, by_component = false;
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
// this picture, unless the user gave others. False: the picture has an eye of its own.
bool placeEye(RenderArguments& arguments) {
  ChoiceOptions& choice = arguments.query.choice;
  if (!choice.eye || !choice.look_at || choice.pixels_per_unit) return false;
  arguments.view.camera = lookingAt(*choice.eye, *choice.look_at);
  // From corner to corner, and from the lower edge to the upper one.
  const double diagonal =
      choice.field_of_view.value_or(kDefaultFieldOfView) * std::numbers::pi / 180;
  const double height = arguments.size.height;
  const double vertical =
      2 * std::atan(std::tan(diagonal / 2) * height / std::hypot(height, arguments.size.width));
  arguments.view.camera.vertical_fov = vertical * 180 / std::numbers::pi;
  if (!choice.pixels_per_radian) choice.pixels_per_radian = height / vertical;
  return true;
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
  OffscreenRenderer renderer;
  runWithThreads(arguments.query.threads, [&] {
    const auto pyramid =
        openPyramidFile(arguments.query.input.pyramid, arguments.query.memory_bytes,
                        fileAccess(arguments.query.no_map), remoteOptions(arguments.query.input));
    const ViewDrawing drawing{arguments.size.width, arguments.size.height, arguments.query.threads,
                              output->format() == ImageFormat::kExr};
    renderer.drawViews(pyramid, views, drawing, interruptFlag(), [&](ViewRows rows) {
      triangles = rows.triangles;
      output->add(rows.picture, rows.shape, std::move(rows.rows), rows.share);
    });
  });
  output->finish();
  fmt::print("{}: {}, {} triangles; {:.2f} s ({})\n", arguments.output, sizeText(arguments),
             countText(triangles), watch.seconds(), renderer.deviceName());
  return 0;
}

// One picture, or those of a turntable.
int runRender(RenderArguments arguments) {
  // A mistyped name, or a machine that cannot draw, must not cost an extraction.
  const std::shared_ptr<PictureOutput> output = outputOf(arguments);
  const auto renderer = std::make_shared<OffscreenRenderer>();
  findMasks(arguments.query);
  findPyramid(arguments.query);
  const bool has_eye = placeEye(arguments);
  ViewState& view = arguments.view;
  view.coloring = arguments.by_component ? ViewColoring::kComponent
                  : arguments.by_level   ? ViewColoring::kLevel
                                         : ViewColoring::kPlain;
  view.show_box = false;
  view.focus.show_sphere = arguments.show_focus;
  const Stopwatch extract_watch;
  auto surface = std::make_shared<DrawableSurface>(runWithThreads(arguments.query.threads, [&] {
    return extractPictureSurface(arguments.query, arguments.looks, view);
  }));
  const double extract_seconds = extract_watch.seconds();

  const Stopwatch draw_watch;
  const std::uint64_t triangles = surface->triangles;
  const ViewDrawing drawing{arguments.size.width, arguments.size.height};
  const bool turns = arguments.pictures > 1;
  if (!has_eye)
    view.camera =
        cameraOf(*surface, view.camera, static_cast<double>(drawing.width) / drawing.height, turns);
  const std::vector<ViewState> views = turntable(view, arguments.pictures);
  try {
    // OpenGL does not stop before its end.
    runAbandonable(&interruptFlag(), [renderer, surface, output, views, drawing] {
      renderer->drawSurface(
          std::move(*surface), views, drawing, interruptFlag(), [&](ViewRows rows) {
            output->add(rows.picture, rows.shape, std::move(rows.rows), rows.share);
          });
      return true;
    });
    output->finish();
  } catch (const Cancelled&) {
    output->giveUp();
    throw;
  }
  fmt::print("{}: {}, {} triangles; extract {:.2f} s, draw {:.2f} s ({})\n", arguments.output,
             sizeText(arguments), countText(triangles), extract_seconds, draw_watch.seconds(),
             renderer->deviceName());
  return 0;
}

void checkArguments(RenderArguments& arguments, bool has_isovalue) {
  const std::size_t states = arguments.states.size();
  if (states == 0 && !has_isovalue) throw UsageError("--iso is required, or --label, or --state");
  const std::size_t surfaces = arguments.query.isovalues.size();
  const auto refuseCount = [&](std::size_t count, const char* option) {
    if (count != 0 && count != surfaces)
      throw UsageError(
          fmt::format("{} is wanted once for each isovalue of --iso, in their order", option));
  };
  refuseCount(arguments.looks.colors.size(), "--color");
  refuseCount(arguments.looks.opacities.size(), "--opacity");
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
glm::vec3 parseBackground(ViewState& view, const std::string& text) {
  for (const Background& background : kBackgrounds)
    if (text == background.name) {
      view.background_bottom = background.bottom;
      return background.top;
    }
  return view.background_bottom = parseColor(text);
}

void addPictureOptions(CLI::App& app, RenderArguments& arguments) {
  ViewState& view = arguments.view;
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
  addParsedOption(app, "--azimuth", view.camera.azimuth, parseNumber, "DEGREES",
                  "Walk around the surface, to the right; 0 looks along +y; default: 25");
  addParsedOption(app, "--elevation", view.camera.elevation, parseNumber, "DEGREES",
                  "Look from above, up to 90, or from below; default: 15");
  app.add_flag("--color-by-level", arguments.by_level,
               "Colour triangles by their level: red for 0, then yellow, green, blue");
  app.add_flag("--color-by-component", arguments.by_component,
               "Colour the connected pieces by their area: orange for the largest, then sky blue, "
               "green, yellow, blue, red, purple, and again")
      ->excludes(findOption(app, "--color-by-level"));
  app.add_flag("--wireframe", view.wireframe, "Draw the edges of the triangles");
  app.add_flag("--ambient-occlusion", view.ambient_occlusion, "Darken the surface in hollows");
  app.add_flag("--shadow", view.shadow, "The surface throws a soft shadow on itself");
  app.add_flag("--scale-bar", view.pictures.scale_bar,
               "Draw a scale bar; it measures in the middle of what is framed");
  app.add_flag("--axes", view.pictures.axes, "Draw the directions of the world's x, y and z");
  app.add_flag("--legend", view.pictures.legend, "Draw what the colours mean");
  app.add_flag("--show-focus", arguments.show_focus, "Draw the outline of the sphere of interest")
      ->needs(findOption(app, "--focus"));
  addRepeatedOption(
      app, "--color",
      [&arguments](const std::string& text) { arguments.looks.colors.push_back(parseColor(text)); },
      "R,G,B", "Colour of the surface, sRGB from 0 to 1; of several, once for each");
  addRepeatedOption(
      app, "--opacity",
      [&arguments](const std::string& text) {
        const double opacity = parseNumberFrom(text, 0);
        if (opacity > 1) throw std::invalid_argument("a number from 0 to 1 is wanted");
        arguments.looks.opacities.push_back(opacity);
      },
      "O", "Opacity of the surface, from 0 to 1 (default); of several, once for each");
  addParsedOption(app, "--background-top", view.background_top, parseColor, "R,G,B",
                  "Colour at the upper edge of the picture");
  addParsedOption(app, "--background-bottom", view.background_bottom, parseColor, "R,G,B",
                  "Colour at the lower edge");
  addParsedOption(
      app, "--background", view.background_top,
      [&view](const std::string& text) { return parseBackground(view, text); },
      "dark|light|white|R,G,B",
      "Both of them: for screens (default), slides or print; or a colour");
}

}  // namespace

Command addRenderCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("render", "Draw an isosurface of a pyramid or a volume to a file");
  const auto arguments = std::make_shared<RenderArguments>();
  addQueryOptions(*sub, arguments->query, true);
  addRegionOptions(*sub, arguments->query.region);
  beginGroup(*sub, kDetailGroup);
  addSimplifyOption(*sub, arguments->query);
  addParsedOption(*sub, "--keep-largest", arguments->looks.keep_largest,
                  integerWithin(1, std::numeric_limits<std::int64_t>::max()), "N",
                  "Only the N connected pieces that enclose the most, with their cavities, of each "
                  "surface; with --box, those of the largest area");
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
  findOption(*sub, "--iso")->required(false);
  for (CLI::Option* const option : optionsBeside(
           *sub, {"FILE", "--output", "--size", "--dpi", "--pictures", "--pictures-per-second",
                  "--memory", "--help", "--threads", "--state", "--force", "--no-map"}))
    state->excludes(option);
  sub->footer(R"(
Example:
  isobrick render head.isb --iso 500 --size 800x600 --azimuth 40 -o skin.png
  isobrick render head.isb --iso 530,1160 --opacity 0.3 --opacity 1 -o skull.png)");
  return {sub, [arguments, state] {
            checkArguments(*arguments, !arguments->query.isovalues.empty());
            if (state->count() > 0) return renderStates(*arguments);
            return runRender(*arguments);
          }};
}

}  // namespace isobrick
