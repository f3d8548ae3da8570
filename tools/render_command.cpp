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
#include "isobrick/storage/atomic_file.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/session/view_picture.h"
#include "isobrick/viewer/state/view_file.h"
#include "tools/byte_size.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/output_check.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"
#include "tools/picture_surface.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"
#include "tools/stopwatch.h"
#include "tools/thread_count.h"

namespace isobrick {
namespace {

struct RenderArguments {
  QueryOptions query;
  std::string output;
  PixelSize size{RenderOptions{}.width, RenderOptions{}.height};
  RenderOptions picture;
  bool show_focus = false;
  bool force = false;
  std::string state;  // a saved view, in place of most of the above; empty: none
};

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

void writePicture(const RenderArguments& arguments, const std::vector<char>& picture) {
  AtomicFile file(arguments.output);
  file.write(picture.data(), picture.size());
  file.commit(&interruptFlag());
}

// Draws a saved view as `isobrick view` shows it.
int renderState(RenderArguments& arguments) {
  const ImageFormat format = imageFormatOf(arguments.output);
  refuseReplacing({arguments.output}, {arguments.query.input.path, arguments.state},
                  arguments.force);
  { const AtomicFile probe(arguments.output); }
  findPyramid(arguments.query);
  const ViewState state = readView(arguments.state).state;
  const Stopwatch watch;
  const ViewPicture view = runWithThreads(arguments.query.threads, [&] {
    return drawView(
        openPyramidFile(arguments.query.input.pyramid, arguments.query.memory_bytes,
                        fileAccess(arguments.query.no_map), remoteOptions(arguments.query.input)),
        state, arguments.size.width, arguments.size.height, arguments.query.threads,
        format == ImageFormat::kExr, interruptFlag());
  });
  writePicture(arguments, encodeImage(format, view.image));
  fmt::print("{}: {} x {} pixels, {} triangles; {:.2f} s ({})\n", arguments.output,
             arguments.size.width, arguments.size.height, countText(view.triangles),
             watch.seconds(), view.device);
  return 0;
}

int runRender(RenderArguments arguments) {
  // A mistyped name, or a machine that cannot draw, must not cost an extraction.
  const ImageFormat format = imageFormatOf(arguments.output);
  refuseReplacing({arguments.output}, {arguments.query.input.path, arguments.state},
                  arguments.force);
  { const AtomicFile probe(arguments.output); }
  const auto renderer = std::make_shared<OffscreenRenderer>();
  if (arguments.size.width > renderer->greatestSize() ||
      arguments.size.height > renderer->greatestSize())
    throw UsageError(fmt::format("--size {}x{} is too large; at most {} pixels each",
                                 arguments.size.width, arguments.size.height,
                                 renderer->greatestSize()));
  findPyramid(arguments.query);
  placeEye(arguments);
  const Stopwatch extract_watch;
  PictureSurface surface = runWithThreads(arguments.query.threads,
                                          [&] { return extractPictureSurface(arguments.query); });
  const double extract_seconds = extract_watch.seconds();

  const Stopwatch draw_watch;
  RenderOptions options = makeRenderOptions(arguments, surface);
  // Neither OpenGL nor the libraries that pack pictures stop before their end.
  const auto chunks = std::make_shared<std::vector<SurfaceChunk>>(std::move(surface.chunks));
  const std::vector<char> picture = runAbandonable(
      &interruptFlag(),
      [renderer, chunks, lattice = surface.lattice, format, options = std::move(options)] {
        return encodeImage(format, renderer->render(std::move(*chunks), lattice, options));
      });
  writePicture(arguments, picture);
  fmt::print("{}: {} x {} pixels, {} triangles; extract {:.2f} s, draw {:.2f} s ({})\n",
             arguments.output, arguments.size.width, arguments.size.height,
             countText(surface.triangles), extract_seconds, draw_watch.seconds(),
             renderer->deviceName());
  return 0;
}

}  // namespace

Command addRenderCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("render", "Draw an isosurface of a pyramid or a volume to a file");
  const auto arguments = std::make_shared<RenderArguments>();
  RenderOptions& picture = arguments->picture;
  addQueryOptions(*sub, arguments->query);
  beginGroup(*sub, kOutputGroup);
  sub->add_option("-o,--output", arguments->output,
                  "Output; a picture, .png (8 bits, sRGB) or .exr (half floats, linear)")
      ->type_name("IMAGE")
      ->required();
  addForceFlag(*sub, arguments->force);
  beginGroup(*sub, kPictureGroup);
  addParsedOption(*sub, "--size", arguments->size, parsePixelSize, "WxH",
                  "Pixels; default: 1024x1024");
  addParsedOption(*sub, "--azimuth", picture.orbit.azimuth, parseNumber, "DEGREES",
                  "Walk around the surface, to the right; 0 looks along +y; default: 25");
  addParsedOption(*sub, "--elevation", picture.orbit.elevation, parseNumber, "DEGREES",
                  "Look from above, up to 90, or from below; default: 15");
  sub->add_flag("--color-by-level", picture.color_by_level,
                "Colour triangles by their level: red for 0, then yellow, green, blue");
  sub->add_flag("--wireframe", picture.wireframe, "Draw the edges of the triangles");
  sub->add_flag("--scale-bar", picture.notes.scale_bar,
                "Draw a scale bar; it measures in the middle of what is framed");
  sub->add_flag("--axes", picture.notes.axes, "Draw the directions of the world's x, y and z");
  sub->add_flag("--legend", picture.notes.legend, "Draw what the colours mean");
  sub->add_flag("--show-focus", arguments->show_focus, "Draw the outline of the sphere of interest")
      ->needs(findOption(*sub, "--focus"));
  addParsedOption(*sub, "--color", picture.surface_color, parseColor, "R,G,B",
                  "Colour of the surface, sRGB from 0 to 1");
  addParsedOption(*sub, "--background-top", picture.background_top, parseColor, "R,G,B",
                  "Colour at the upper edge of the picture");
  addParsedOption(*sub, "--background-bottom", picture.background_bottom, parseColor, "R,G,B",
                  "Colour at the lower edge");
  addParsedOption(
      *sub, "--background", picture.background_top,
      [&picture](const std::string& text) { return picture.background_bottom = parseColor(text); },
      "R,G,B", "Both of them");
  CLI::Option* const state =
      sub->add_option(
             "--state", arguments->state,
             "Saved view; as 'isobrick view' wrote it, in place of --iso and of all that says "
             "what is seen from where")
          ->type_name("VIEW.json");
  CLI::Option* const isovalue = findOption(*sub, "--iso")->required(false);
  const std::set<std::string> together{"FILE",   "--output",  "--size",  "--memory", "--no-map",
                                       "--help", "--threads", "--state", "--force"};
  for (CLI::Option* const option : sub->get_options())
    if (option->get_group() != kVolumeGroup && option->get_group() != kRemoteGroup &&
        !option->get_group().empty() && together.count(option->get_name(false, true)) == 0 &&
        together.count(option->get_single_name()) == 0 &&
        together.count("--" + option->get_single_name()) == 0)
      state->excludes(option);
  sub->footer(R"(
Example:
  isobrick render head.isb --iso 500 --size 800x600 --azimuth 40 -o skin.png)");
  return {sub, [arguments, state, isovalue] {
            if (state->count() == 0 && isovalue->count() == 0)
              throw UsageError("--iso is required, or --state");
            if (state->count() > 0) return renderState(*arguments);
            return runRender(*arguments);
          }};
}

}  // namespace isobrick
