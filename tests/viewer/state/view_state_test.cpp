// Views as JSON, in their bounds, and as queries.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/state/view_file.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

// No field has its default.
ViewState fullState() {
  ViewState state;
  state.camera = {{1.1, -2.2, 3.3}, 44.4, -170.25, 33.5, 41.0, true};
  state.surfaces = {{512.5, {0.1f, 0.2f, 0.3f}, 0.25, false},
                    {-3.0, {0.91f, 0.8f, 0.7f}, 0.5, false}};
  state.active_surface = 1;
  state.step = 3;
  state.focus = {{10.0, 20.5, 30.0}, 77.7, true, false, true};
  state.curvature_tolerance = 0.125;
  state.view_pixels = 1.5;
  state.clip_planes = {{{0.36, 0.48, 0.8}, -12.5, false, false}};
  state.region = {{{{0.5, 1.5, 2.0}, 3.0}}, {{{1.0, 2.0, 3.0}, 4.0}}, {{"/scans/organ.isb", 7.0}}};
  state.slices = {{{true, 3.0}, {true, 4.0}, {true, 5.0}}};
  state.slice_views = {true, 3.5, glm::dvec3(1.0, 2.0, 3.0)};
  state.slice_opacity = 0.25;
  state.slice_threshold = 120.0;
  state.value_window = {-100.0, 1500.0};
  state.coloring = ViewColoring::kLevel;
  state.values = {ColorMap::kInferno,         {{2.0, 30.0}},  "/scans/pet.isb", {{-1.5, 4.5}},
                  {{0.48, 0.6, -0.64}, 21.5}, {{-5.0, 12.0}}, {0.25, 0.75}};
  state.show_transitions = true;
  state.lighting = ViewLighting::kHeadlight;
  state.ambient_occlusion = true;
  state.shadow = true;
  state.pictures = {true, 3, true, true, true};
  for (ViewSurface& surface : state.surfaces) surface.inside = InsideOf::kBelow;
  for (ViewSurface& surface : state.surfaces) surface.volume = 2;
  for (ViewSurface& surface : state.surfaces)
    surface.pieces = {{{{1.0, 2.0, 3.0}, 4.0}}, {{{5.0, 6.0, 7.0}, 8.0}}, 9.0};
  state.piece_measures = {{1.0, 2, 3.0, 4.0, {5, 6, 7}, {8, 9, 10}, {11, 12, 13}, {14, 15, 16}}};
  state.measurements = {{{{1.0, 2.0, 3.0}, {4.0, 5.0, 6.0}}}};
  state.capped = true;
  state.mesh_distance = 0.75;
  state.wireframe = true;
  state.show_box = false;
  state.show_handles = false;
  state.background_top = {0.11f, 0.12f, 0.13f};
  state.background_bottom = {0.21f, 0.22f, 0.23f};
  return state;
}

ViewVolume someVolume() {
  ViewVolume volume;
  volume.voxels = {101, 51, 21};
  volume.geometry.spacing = {0.5, 1.0, 2.0};
  volume.geometry.origin = {1000.0, -30.0, 5.0};
  volume.least_value = -1000.0;
  volume.greatest_value = 3000.0;
  return volume;
}

TEST(ViewStateTest, EveryFieldSurvivesTheWayThroughJson) {
  const ViewState full = fullState();
  EXPECT_EQ(viewStateFromJson(viewStateToJson(full)), full);
  // No leaf of it is what a new view has, so none was left out above; which fields there are, the
  // structured bindings of view_file.cpp see to.
  const auto flat = [](const ViewState& state) {
    return nlohmann::json::parse(viewStateToJson(state)).flatten();
  };
  ViewState plain;
  plain.surfaces.resize(2);
  plain.clip_planes.resize(1);
  plain.region.half_spaces = {HalfSpace()};
  plain.region.balls = {ViewBall()};
  plain.region.masks = {{"", 0.0}};
  for (ViewSurface& surface : plain.surfaces)
    surface.pieces.keep = surface.pieces.hide = {ComponentSeed{}};
  plain.piece_measures.resize(1);
  plain.slice_views.center = glm::dvec3(0.0);
  plain.measurements = {{{glm::dvec3(0.0), glm::dvec3(0.0)}}};
  plain.values.gradient_window = plain.values.other_window = plain.values.plane_window = {0.0, 0.0};
  const nlohmann::json with = flat(full), without = flat(plain);
  for (const auto& leaf : without.items()) {
    ASSERT_TRUE(with.contains(leaf.key())) << leaf.key();
    EXPECT_NE(with[leaf.key()], leaf.value()) << leaf.key();
  }
}

TEST(ViewStateTest, DoublesComeBackToTheBit) {
  ViewState state;
  state.camera.distance = 0.1 + 0.2;
  state.surfaces[0].isovalue = 1.0 / 3.0;
  state.surfaces[0].color = {0.1f, 1.0f / 3.0f, 0.7f};
  EXPECT_EQ(viewStateFromJson(viewStateToJson(state)), state);
}

TEST(ViewStateTest, MissingFieldsKeepTheirDefaults) {
  ViewState expected;
  expected.wireframe = true;
  expected.focus.radius = 12.0;
  expected.camera.distance = 0.0;  // no place: the surface is framed
  EXPECT_EQ(viewStateFromJson(R"({"wireframe": true, "focus": {"radius": 12}})"), expected);
}

TEST(ViewStateTest, ColoursByPieceComeBackFromTheirName) {
  const ViewState state = viewStateFromJson(R"({"coloring": "component"})");
  EXPECT_EQ(state.coloring, ViewColoring::kComponent);
  EXPECT_NE(viewStateToJson(state).find(R"("coloring": "component")"), std::string::npos);
  EXPECT_EQ(viewStateFromJson(viewStateToJson(state)), state);
  // The triangles are those without colours; another kind of value is another request.
  ViewState other = state;
  other.coloring = ViewColoring::kPlain;
  const ViewVolume volume = someVolume();
  EXPECT_EQ(wishOf(state, volume, 600.0), wishOf(other, volume, 600.0));
  other.coloring = ViewColoring::kGradient;
  EXPECT_NE(wishOf(state, volume, 600.0), wishOf(other, volume, 600.0));
}

TEST(ViewStateTest, WrongTextIsRefusedByTheNameOfTheField) {
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      viewStateFromJson(text);
    } catch (const Error& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_EQ(refusal("{"), "the view is not JSON");
  EXPECT_EQ(refusal("[]"), "the view's 'view' is not an object");
  const std::pair<const char*, const char*> cases[] = {
      {R"({"wirefram": true})", "wirefram"},
      {R"({"measurements": [{"points": [[0, 0, 0]]}]})", "measurements"},
      {R"({"measurements": [3]})", "measurements[0]"},
      {R"({"camera": {"distance": "far"}})", "camera.distance"},
      {R"({"camera": {"distance": -1}})", "camera.distance"},
      {R"({"camera": {"vertical_fov": 400}})", "camera.vertical_fov"},
      {R"({"camera": {"pivot": [1, 2]}})", "camera.pivot"},
      {R"({"camera": {"pivot": [1, 2, 1e300]}})", "camera.pivot[2]"},
      {R"({"coloring": "blue"})", "coloring"},
      {R"({"surfaces": []})", "surfaces"},
      {R"({"surfaces": [{"visible": 1}]})", "surfaces[0].visible"},
      {R"({"active_surface": 1})", "active_surface"},
      {R"({"active_surface": -1})", "active_surface"},
      {R"({"active_surface": 0.5})", "active_surface"},
      {R"({"curvature_tolerance": -1})", "curvature_tolerance"},
      {R"({"view_pixels": 0})", "view_pixels"},
      {R"({"focus": {"radius": 0}})", "focus.radius"},
      {R"({"slices": [{}]})", "slices"},
      {R"({"clip_planes": [{}, {}, {}, {}, {}, {}, {}]})", "clip_planes"},
  };
  for (const auto& [text, field] : cases) {
    const std::string said = refusal(text);
    EXPECT_NE(said.find("'" + std::string(field) + "'"), std::string::npos) << said;
  }
}

TEST(ViewStateTest, TheActiveSurfaceStaysSoWhenAnotherOneGoes) {
  ViewState state;
  state.surfaces.resize(4);
  for (int i = 0; i < 4; ++i) state.surfaces[static_cast<std::size_t>(i)].isovalue = i;
  state.active_surface = 2;
  removeSurface(0, state);
  EXPECT_EQ(activeSurface(state).isovalue, 2.0);
  removeSurface(2, state);
  EXPECT_EQ(activeSurface(state).isovalue, 2.0);
  removeSurface(1, state);
  EXPECT_EQ(activeSurface(state).isovalue, 1.0);
}

// Development builds saved them.
TEST(ViewStateTest, AToleranceAndOutlinesAreIgnored) {
  EXPECT_EQ(viewStateFromJson(R"({"wireframe": true, "tolerance": 3, "outlines": true})"),
            viewStateFromJson(R"({"wireframe": true})"));
}

// Earlier builds measured over the surface, too; a straight distance in its place would be wrong.
TEST(ViewStateTest, DistancesOverTheSurfaceAreLeftOut) {
  const ViewState state = viewStateFromJson(R"({"measurements": [
      {"points": [[0, 0, 0], [1, 0, 0]], "surface_isovalue": null},
      {"points": [[0, 0, 0], [2, 0, 0]], "surface_isovalue": 0},
      {"points": [[0, 0, 0], [3, 0, 0]]}]})");
  ASSERT_EQ(state.measurements.size(), 2u);
  EXPECT_EQ(state.measurements[0].value(), 1.0);
  EXPECT_EQ(state.measurements[1].value(), 3.0);
}

TEST(ViewStateTest, BoundsPutEverythingIntoTheVolume) {
  const ViewVolume volume = someVolume();
  ViewState wild = fullState();
  wild.surfaces.clear();
  wild.active_surface = 17;
  wild.focus.follow_view = false;
  wild.focus.center = {-5.0, 1e9, 7.0};
  wild.focus.radius = 1e9;
  wild.clip_planes.assign(9, ViewClipPlane{{0.0, 0.0, 5.0}, 0.0, true, true});
  wild.slices[2].position = 300.0;
  wild.camera.distance = 0.0;
  const ViewState tame = bounded(wild, volume);
  EXPECT_EQ(tame.surfaces.size(), 1u);
  EXPECT_EQ(tame.active_surface, 0);
  EXPECT_EQ(tame.focus.center, glm::dvec3(0.0, 50.0, 7.0));
  EXPECT_EQ(tame.focus.radius, volume.diagonal());
  EXPECT_EQ(tame.clip_planes.size(), kMostClipPlanes);
  EXPECT_EQ(tame.clip_planes[0].normal, glm::dvec3(0.0, 0.0, 1.0));
  EXPECT_EQ(tame.slices[2].position, 20.0);
  EXPECT_GT(tame.camera.distance, 0.0);
  EXPECT_EQ(bounded(tame, volume), tame);
  const ViewState first = firstView(volume, 1.5);
  EXPECT_EQ(bounded(first, volume), first);
}

// A view whose bounds move it with every frame is never at rest, and never drawn.
TEST(ViewStateTest, BoundsOnceMoreChangeNothing) {
  const ViewVolume volume = someVolume();
  test::Random random(3);
  const auto number = [&] {
    const double digits = test::randomReal(random, -1.0, 1.0);
    switch (test::randomBelow(random, 4)) {
      case 0:
        return std::round(10.0 * digits);
      case 1:
        return digits * std::pow(10.0, test::randomReal(random, -320.0, 30.0));
      default:
        return digits;
    }
  };
  const auto vector = [&] { return glm::dvec3(number(), number(), number()); };
  const auto check = [&](const glm::dvec3& normal) {
    ViewState state = fullState();
    state.clip_planes[0].normal = state.values.plane.normal = normal;
    state.focus.center = vector();
    state.focus.radius = number();
    state.focus.follow_view = test::randomBelow(random, 2) == 0;
    state.camera.pivot = vector();
    state.camera.distance = number();
    state.surfaces[0].isovalue = number();
    state.slices[1].position = number();
    state.slice_views.center = vector();
    const ViewState once = bounded(state, volume);
    EXPECT_EQ(bounded(once, volume), once) << normal.x << " " << normal.y << " " << normal.z;
    EXPECT_NEAR(glm::length(once.clip_planes[0].normal), 1.0, 1e-15);
    EXPECT_TRUE(normal == glm::dvec3(0.0) || glm::dot(once.clip_planes[0].normal, normal) > 0.0);
  };
  check({7.0, 7.0, 8.0});
  check({0.0, 0.0, 0.0});
  check({1e-300, 1e-300, 0.0});
  check({0.0, 5e-324, 0.0});
  for (int i = 0; i < 20000; ++i) check(vector());
}

TEST(ViewStateTest, QueriesFollowTheFocusUpToAllOfTheVolume) {
  const ViewVolume volume = someVolume();
  ViewState state = firstView(volume, 1.0);
  state.surfaces[0].isovalue = 300.0;
  const Query near = queryOf(wishOf(state, volume, 600.0), volume, 0, 5.0);
  EXPECT_EQ(near.isovalue, 300.0);
  ASSERT_TRUE(near.focus);
  EXPECT_EQ(near.focus->center, state.focus.center);
  EXPECT_EQ(near.focus->radius, 5.0);
  EXPECT_FALSE(queryOf(wishOf(state, volume, 600.0), volume, 0, volume.diagonal()).focus);
  EXPECT_EQ(wantedRadius(state, volume), volume.diagonal());
  state.focus.everywhere = false;
  EXPECT_EQ(wantedRadius(state, volume), state.focus.radius);
}

TEST(ViewStateTest, TheViewAsksForWhatItsPictureShows) {
  const ViewVolume volume = someVolume();
  ViewState state = firstView(volume, 1.0);
  EXPECT_FALSE(queryOf(wishOf(state, volume, 600.0), volume, 0, 5.0).view);
  state.view_pixels = 2.0;
  const Query query = queryOf(wishOf(state, volume, 600.0), volume, 0, 5.0);
  ASSERT_TRUE(query.view);
  EXPECT_EQ(query.view->eye, placeCamera(state.camera, 1.0).eye);
  EXPECT_EQ(query.view->pixels, 2.0);
  EXPECT_NEAR(query.view->pixels_per_radian, 600.0 / (30.0 * std::numbers::pi / 180.0), 1e-9);
  EXPECT_FALSE(query.view->pixels_per_unit);
  // Then, and only then, the camera asks for other triangles.
  ViewState turned = state;
  turned.camera = orbited(state.camera, 10.0, 0.0);
  EXPECT_NE(wishOf(state, volume, 600.0), wishOf(turned, volume, 600.0));
  state.camera.orthographic = true;
  const double height = 2.0 * placeCamera(state.camera, 1.0).half_height;
  EXPECT_NEAR(*queryOf(wishOf(state, volume, 600.0), volume, 0, 5.0).view->pixels_per_unit,
              600.0 / height, 1e-9);
}

TEST(ViewStateTest, OnlyWhatChangesTrianglesAsksForThem) {
  const ViewVolume volume = someVolume();
  ViewState state = fullState();
  state.view_pixels.reset();
  state.focus.everywhere = false;
  const auto asks = [&](const auto& change) {
    ViewState other = state;
    change(other);
    return wishOf(state, volume, 600.0) != wishOf(other, volume, 600.0);
  };
  EXPECT_FALSE(asks([](ViewState& s) { s.camera.azimuth += 1.0; }));
  EXPECT_FALSE(asks([](ViewState& s) { s.wireframe = !s.wireframe; }));
  EXPECT_FALSE(asks([](ViewState& s) { s.ambient_occlusion = !s.ambient_occlusion; }));
  EXPECT_FALSE(asks([](ViewState& s) { s.surfaces[0].color.r = 1.0f; }));
  EXPECT_FALSE(asks([](ViewState& s) { s.clip_planes.clear(); }));
  EXPECT_TRUE(asks([](ViewState& s) { s.surfaces[1].isovalue += 1.0; }));
  EXPECT_TRUE(asks([](ViewState& s) { s.surfaces.pop_back(); }));
  EXPECT_TRUE(asks([](ViewState& s) { s.surfaces[0].visible = true; }));
  EXPECT_TRUE(asks([](ViewState& s) { s.focus.radius += 1.0; }));
  EXPECT_TRUE(asks([](ViewState& s) { s.focus.everywhere = true; }));
  EXPECT_TRUE(asks([](ViewState& s) { s.focus.center.x += 1.0; }));
  EXPECT_TRUE(asks([](ViewState& s) { s.curvature_tolerance.reset(); }));
  EXPECT_TRUE(asks([](ViewState& s) { s.view_pixels = 1.0; }));
  state.focus.everywhere = true;  // then no radius counts
  EXPECT_FALSE(asks([](ViewState& s) { s.focus.radius += 1.0; }));
}

}  // namespace
}  // namespace isobrick
