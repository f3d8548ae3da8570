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
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/outputs.h"
#include "tools/parse_text.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/render/picture_output.h"
#include "tools/render/picture_surface.h"
#include "tools/shared_options.h"
#include "tools/view_region.h"

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
  bool steps = false;  // each FILE is a step of time
  bool force = false;
  bool json = false;
  // Saved views, in place of most of the above: one, or the stops of the camera's path.
  std::vector<std::string> states;
  int pictures = 1;  // more: a turntable, or along the path
  std::optional<double> pictures_per_second;
};

std::vector<std::string> inputsOf(const RenderArguments& arguments) {
  std::vector<std::string> inputs = arguments.states;
  inputs.insert(inputs.end(), arguments.query.files.begin(), arguments.query.files.end());
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

std::shared_ptr<PictureOutput> outputOf(const RenderArguments& arguments, const std::string& name) {
  PicturePlan plan;
  plan.output = name;
  plan.pictures = arguments.pictures;
  plan.pictures_per_second = arguments.pictures_per_second.value_or(plan.pictures_per_second);
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

// What was drawn. `seconds`: by phase.
void printDrawn(const RenderArguments& arguments, std::uint64_t triangles, const Json& seconds,
                const std::string& device) {
  if (arguments.json)
    return printJson({{"output", arguments.output},
                      {"frames", arguments.pictures},
                      {"width", arguments.size.width},
                      {"height", arguments.size.height},
                      {"triangles", triangles},
                      {"seconds", seconds},
                      {"device", device}});
  std::string times;
  for (const auto& [phase, time] : seconds.items())
    times += fmt::format("{}{} {:.2f} s", times.empty() ? "" : ", ", phase, time.get<double>());
  fmt::print("{}: {}, {} triangles; {} ({})\n", arguments.output, sizeText(arguments),
             countText(triangles), times, device);
}

std::vector<QueryOptions> queriesOf(const RenderArguments& arguments) {
  std::vector<QueryOptions> queries;
  for (std::size_t i = 0; i < arguments.query.files.size(); ++i)
    queries.push_back(queryOfFile(arguments.query, i));
  return queries;
}

// Where pictures go, one after the other: all into one sequence, or each to a file of its own.
class PictureFiles {
 public:
  explicit PictureFiles(const RenderArguments& arguments) {
    const bool is_sequence = arguments.pictures > 1 || isSequenceName(arguments.output);
    if (!arguments.steps || is_sequence) {
      outputs_.push_back(outputOf(arguments, arguments.output));
      return;
    }
    for (const std::string& name : outputsOfEach(arguments.output, arguments.query.files))
      outputs_.push_back(outputOf(arguments, name));
  }

  ImageFormat format() const { return outputs_.front()->format(); }
  // Takes the pictures that a renderer draws from now on, of which `first` came before them.
  OffscreenRenderer::TakeRows taker(std::size_t first) const {
    const auto output = outputs_.size() > 1 ? outputs_[first] : outputs_.front();
    const std::size_t before = outputs_.size() > 1 ? 0 : first;
    return [output, before](ViewRows rows) {
      output->add(before + rows.picture, rows.shape, std::move(rows.rows), rows.share);
    };
  }
  void finish() const {
    for (const auto& output : outputs_) output->finish();
  }
  void giveUp() const {
    for (const auto& output : outputs_) output->giveUp();
  }

 private:
  std::vector<std::shared_ptr<PictureOutput>> outputs_;
};

// Draws saved views as `isobrick view` shows them: all FILE in each of them or, if they are steps,
// one after the other.
int renderStates(RenderArguments& arguments) {
  const PictureFiles output(arguments);
  std::vector<QueryOptions> volumes = queriesOf(arguments);
  for (QueryOptions& volume : volumes) findPyramid(volume);
  std::vector<ViewState> views;
  ViewRegion region;  // with the masks of all
  for (const std::string& path : arguments.states) {
    const SavedView view = readView(path);
    views.push_back(view.state);
    const std::vector<ViewMask>& masks = view.state.region.masks;
    region.masks.insert(region.masks.end(), masks.begin(), masks.end());
    if (volumes.size() > 1) continue;
    for (const std::string& beside : view.beside) {
      volumes.push_back(volumes.front());
      volumes.back().input.path = beside;
      findPyramid(volumes.back());
    }
  }
  if (arguments.pictures > 1 && !arguments.steps)
    views = views.size() == 1 ? turntable(views.front(), arguments.pictures)
                              : viewsAlong(views, arguments.pictures);
  arguments.query.region = regionOptionsOf(region);
  findMasks(arguments.query);
  const Stopwatch watch;
  std::uint64_t triangles = 0;
  OffscreenRenderer renderer;
  runWithThreads(arguments.query.threads, [&] {
    const std::uint64_t memory_bytes =
        arguments.query.memory_bytes /
        ((arguments.steps ? 1 : volumes.size()) + region.masks.size());
    openMasks(arguments.query, memory_bytes);
    ViewDrawing drawing{arguments.size.width, arguments.size.height, arguments.query.threads,
                        output.format() == ImageFormat::kExr};
    drawing.is_step = arguments.steps;
    drawing.masks = openMasksOf(arguments.query.region);
    for (std::size_t i = 1; i < volumes.size() && !arguments.steps; ++i)
      drawing.beside.push_back(openPyramid(volumes[i].input.pyramid, memory_bytes,
                                           remoteOptions(volumes[i].input), &interruptFlag(),
                                           fileAccess(arguments.query.no_map)));
    for (std::size_t i = 0; i + drawing.beside.size() < volumes.size(); ++i) {
      const auto pyramid =
          openPyramidFile(volumes[i].input.pyramid, memory_bytes,
                          fileAccess(arguments.query.no_map), remoteOptions(volumes[i].input));
      renderer.drawViews(pyramid, views, drawing, interruptFlag(),
                         [&, take = output.taker(i)](ViewRows rows) {
                           triangles = rows.triangles;
                           take(std::move(rows));
                         });
    }
  });
  output.finish();
  printDrawn(arguments, triangles, {{"all", watch.seconds()}}, renderer.deviceName());
  return 0;
}

// Pictures of surfaces that are extracted for them.
class SurfacePictures {
 public:
  SurfacePictures(RenderArguments& arguments, bool has_eye)
      : arguments_(arguments),
        has_eye_(has_eye),
        // A mistyped name, or a machine that cannot draw, must not cost an extraction.
        output_(std::make_shared<PictureFiles>(arguments)),
        renderer_(std::make_shared<OffscreenRenderer>()) {}

  // Those of one scene; `number` came before them.
  void draw(std::vector<QueryOptions> volumes, std::size_t number) {
    ViewState& view = arguments_.view;
    const Stopwatch extract_watch;
    auto surface = std::make_shared<DrawableSurface>(runWithThreads(arguments_.query.threads, [&] {
      return extractPictureSurface(std::move(volumes), arguments_.looks, view);
    }));
    extract_seconds_ += extract_watch.seconds();
    const Stopwatch draw_watch;
    triangles_ += surface->triangles;
    const ViewDrawing drawing{arguments_.size.width, arguments_.size.height};
    const double aspect = static_cast<double>(drawing.width) / drawing.height;
    const bool turns = arguments_.pictures > 1 && !arguments_.steps;
    // Steps of time have one camera, whatever grows and moves in them.
    if (!has_eye_)
      view.camera = arguments_.steps ? framed(view.camera, surface->volume.box(), aspect)
                                     : cameraOf(*surface, view.camera, aspect, turns);
    has_eye_ = has_eye_ || arguments_.steps;
    const std::vector<ViewState> views = turntable(view, turns ? arguments_.pictures : 1);
    try {
      // OpenGL does not stop before its end.
      runAbandonable(&interruptFlag(), [renderer = renderer_, output = output_, surface, views,
                                        drawing, number] {
        const auto take = output->taker(number);
        renderer->drawSurface(std::move(*surface), views, drawing, interruptFlag(), take);
        return true;
      });
    } catch (const Cancelled&) {
      output_->giveUp();
      throw;
    }
    draw_seconds_ += draw_watch.seconds();
  }

  void finish() {
    const Stopwatch draw_watch;
    try {
      output_->finish();
    } catch (const Cancelled&) {
      output_->giveUp();
      throw;
    }
    printDrawn(arguments_, triangles_,
               {{"extract", extract_seconds_}, {"draw", draw_seconds_ + draw_watch.seconds()}},
               renderer_->deviceName());
  }

 private:
  RenderArguments& arguments_;
  bool has_eye_;
  const std::shared_ptr<PictureFiles> output_;
  const std::shared_ptr<OffscreenRenderer> renderer_;
  std::uint64_t triangles_ = 0;
  double extract_seconds_ = 0, draw_seconds_ = 0;
};

// One picture, or those of a turntable, or of steps of time.
int runRender(RenderArguments arguments) {
  const bool has_eye = placeEye(arguments);
  SurfacePictures pictures(arguments, has_eye);
  findMasks(arguments.query);
  std::vector<QueryOptions> volumes = queriesOf(arguments);
  for (QueryOptions& volume : volumes) findPyramid(volume);
  ViewState& view = arguments.view;
  view.coloring = arguments.by_component ? ViewColoring::kComponent
                  : arguments.by_level   ? ViewColoring::kLevel
                                         : ViewColoring::kPlain;
  view.show_box = false;
  view.focus.show_sphere = arguments.show_focus;
  if (!arguments.steps)
    pictures.draw(std::move(volumes), 0);
  else
    for (std::size_t i = 0; i < volumes.size(); ++i) pictures.draw({volumes[i]}, i);
  pictures.finish();
  return 0;
}

// FILE are steps of time, with one picture each, or volumes of one scene.
void checkFiles(RenderArguments& arguments) {
  const std::size_t files = arguments.query.files.size();
  if (arguments.steps && files < 2)
    throw UsageError("--steps draws a picture of each of several FILE; give more of them");
  if (!arguments.steps && files > kMostVolumes)
    throw UsageError(fmt::format(
        "a scene has at most {} volumes; if these are steps of time, give --steps", kMostVolumes));
  if (arguments.steps && arguments.states.size() > 1)
    throw UsageError("--steps has one camera; give one --state");
  if (arguments.steps && isSequenceName(arguments.output))
    arguments.pictures = static_cast<int>(files);
}

void checkArguments(RenderArguments& arguments, bool has_isovalue) {
  const std::size_t states = arguments.states.size();
  if (states == 0 && !has_isovalue) throw UsageError("--iso is required, or --label, or --state");
  std::size_t surfaces = 0;
  for (const QueryOptions& volume : queriesOf(arguments)) {
    surfaces = (arguments.steps ? 0 : surfaces) + volume.isovalues.size();
    if (arguments.steps && surfaces != arguments.query.isovalues.size())
      throw UsageError("--iso holds for all steps; give it once");
  }
  const auto refuseCount = [&](std::size_t count, const char* option) {
    if (count != 0 && count != surfaces)
      throw UsageError(
          fmt::format("{} is wanted once for each isovalue of each FILE, in their order", option));
  };
  refuseCount(arguments.looks.colors.size(), "--color");
  refuseCount(arguments.looks.opacities.size(), "--opacity");
  checkFiles(arguments);
  if (states > 1 && arguments.pictures == 1)
    throw UsageError("several --state are the stops of a path; say how many --frames it has");
  if (arguments.pictures == 1 && isSequenceName(arguments.output))
    throw UsageError(
        fmt::format("'{}' is a name of many pictures; say how many --frames", arguments.output));
  if (arguments.pictures == 1 && arguments.pictures_per_second)
    throw UsageError("--fps goes with --frames, or with a movie of --steps");
  if (arguments.pictures > 1 && !arguments.steps && arguments.query.choice.look_at)
    throw UsageError("--frames turns the picture around; leave out --look-at");
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
  addParsedOption(app, "--frames", arguments.pictures, integerWithin(2, 100000), "N",
                  "So many pictures: all around the surface, or along the path of several --state");
  addParsedOption(app, "--fps", arguments.pictures_per_second, numberFrom(0.1), "N",
                  "Of a movie; default: 25");
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
      "COLOUR",
      "Colour of the surface: #rrggbb, a name such as red, or R,G,B from 0 to 1, sRGB; of several, "
      "once for each");
  addRepeatedOption(
      app, "--opacity",
      [&arguments](const std::string& text) {
        const double opacity = parseNumberFrom(text, 0);
        if (opacity > 1) throw std::invalid_argument("a number from 0 to 1 is wanted");
        arguments.looks.opacities.push_back(opacity);
      },
      "O", "Opacity of the surface, from 0 to 1 (default); of several, once for each");
  addParsedOption(app, "--background-top", view.background_top, parseColor, "COLOUR",
                  "Colour at the upper edge of the picture");
  addParsedOption(app, "--background-bottom", view.background_bottom, parseColor, "COLOUR",
                  "Colour at the lower edge");
  addParsedOption(
      app, "--background", view.background_top,
      [&view](const std::string& text) { return parseBackground(view, text); },
      "dark|light|white|COLOUR",
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
                  "--frames folder/%04d.png, or a movie, .mp4")
      ->type_name("IMAGE")
      ->required();
  sub->add_flag(
      "--steps", arguments->steps,
      "Each FILE is a step of time: a picture of each, where {name} stands in the output, "
      "or folder/%04d.png or a movie of all; without it they are volumes of one scene");
  addForceFlag(*sub, arguments->force);
  addJsonFlag(*sub, arguments->json);
  addPictureOptions(*sub, *arguments);
  findOption(*sub, "--steps")->excludes(findOption(*sub, "--frames"));
  CLI::Option* const state =
      sub->add_option(
             "--state", arguments->states,
             "Saved view; as 'isobrick view' wrote it, in place of --iso and of all that says "
             "what is seen from where; several are the stops of a path")
          ->type_name("VIEW.json")
          ->allow_extra_args(false);
  findOption(*sub, "--iso")->required(false);
  for (CLI::Option* const option : optionsBeside(
           *sub, {"FILE", "--output", "--size", "--dpi", "--frames", "--fps", "--memory", "--help",
                  "--threads", "--state", "--steps", "--force", "--no-map", "--json"}))
    state->excludes(option);
  sub->footer(R"(
Example:
  isobrick render head.isb --iso 500 --size 800x600 --azimuth 40 -o skin.png
  isobrick render head.isb --iso 530,1160 --opacity 0.3 --opacity 1 -o skull.png
  isobrick render ct.isb pet.isb --iso 300 --iso 4 -o both.png    in one world
  isobrick render run-*.isb --steps --iso 500 -o run.mp4)");
  return {sub, [arguments, state] {
            checkArguments(*arguments, !arguments->query.isovalues.empty());
            if (state->count() > 0) return renderStates(*arguments);
            return runRender(*arguments);
          }};
}

}  // namespace isobrick
