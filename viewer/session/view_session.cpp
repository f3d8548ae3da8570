#include "isobrick/viewer/session/view_session.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/error.h"
#include "isobrick/viewer/clock_seconds.h"
#include "isobrick/viewer/session/shown_mesh.h"
#include "isobrick/viewer/session/view_legend.h"

namespace isobrick {
namespace {

// The view is at rest if the user has not changed anything for so long.
constexpr double kRestSeconds = 0.15;
// A drawing waits so long for the next surface, if it takes longer itself.
constexpr double kPostponedSeconds = 0.1;

ViewVolume volumeOf(const Pyramid& pyramid, const std::optional<PreviewOf>& preview_of) {
  ViewVolume volume;
  volume.voxels = pyramid.spec().voxels;
  volume.geometry = pyramid.spec().geometry;
  volume.least_value = static_cast<double>(pyramid.valueRange().min);
  volume.greatest_value = static_cast<double>(pyramid.valueRange().max);
  if (preview_of) {
    volume.voxels = preview_of->voxels;
    volume.geometry.spacing /= static_cast<double>(preview_of->step);
    volume.has_all_values = false;
  }
  return volume;
}

void addCounts(const std::vector<LevelCounts>& counts, std::vector<LevelCounts>& sums) {
  for (const LevelCounts& count : counts) {
    const auto same = std::find_if(
        sums.begin(), sums.end(), [&](const LevelCounts& sum) { return sum.level == count.level; });
    LevelCounts& sum = same != sums.end() ? *same : sums.emplace_back();
    sum.level = count.level;
    sum.cells += count.cells;
    sum.triangles += count.triangles;
    sum.transition_cells += count.transition_cells;
  }
  std::sort(sums.begin(), sums.end(),
            [](const LevelCounts& a, const LevelCounts& b) { return a.level < b.level; });
}

// Takes the rate of the triangles that were not reused for all; does nothing if these are few.
DragQuality measuredPass(const DragQuality& quality, const StreamMessage& pass) {
  if (4 * pass.triangles_made < pass.triangles) return quality;
  const double share = pass.triangles == 0 ? 1.0
                                           : static_cast<double>(pass.triangles_made) /
                                                 static_cast<double>(pass.triangles);
  return measured(quality, pass.radius, pass.triangles, pass.seconds / share);
}

// What is still that of the opening view follows it.
void adoptOpening(const ViewState& before, const ViewState& after, ViewState& view) {
  if (view.camera == before.camera) view.camera = after.camera;
  if (view.focus == before.focus) view.focus = after.focus;
}

std::string whole(double number) { return std::to_string(std::llround(number)); }

}  // namespace

ViewSession::ViewSession(std::shared_ptr<const Pyramid> pyramid, SceneRenderer& renderer,
                         const SessionOptions& options)
    : ViewSession(pyramid, histogramOf(*pyramid), renderer, options) {}

ViewSession::ViewSession(std::shared_ptr<const Pyramid> pyramid, ValueHistogram histogram,
                         SceneRenderer& renderer, const SessionOptions& options)
    : pyramid_(std::move(pyramid)),
      renderer_(&renderer),
      gpu_budget_bytes_(options.gpu_budget_bytes),
      preview_of_(options.preview_of),
      volume_(volumeOf(*pyramid_, preview_of_)),
      histogram_(std::move(histogram)),
      state_(firstView(volume_, 1.0)),
      opening_(state_),
      surfaces_(std::in_place, renderer, options.gpu_budget_bytes),
      stream_(pyramid_, options.threads),
      planes_(pyramid_, preview_of_ ? static_cast<double>(preview_of_->step) : 1.0),
      pieces_(pyramid_, options.threads) {
  volume_.isovalues = histogram_.isovalues;
  state_.surfaces[0].isovalue =
      volume_.isovalues.empty() ? volume_.least_value : volume_.isovalues.front();
  state_.ambient_occlusion = !renderer.isSoftware();
  opening_ = OpeningView(state_);
}

ViewSession::~ViewSession() { planes_.release(*renderer_); }

void ViewSession::suspend() {
  planes_.release(*renderer_);
  surfaces_.reset();
  stream_.cancel();
  forgotten_request_ = last_request_;
  request_times_.clear();
  drawn_camera_.reset();
  requested_.reset();
  shown_surfaces_.clear();
  shows_less_ = true;
}

void ViewSession::resume(SceneRenderer& renderer) {
  renderer_ = &renderer;
  surfaces_.emplace(renderer, gpu_budget_bytes_);
}

// Drops messages of passes that began before suspend(), as a part of these is gone.
std::optional<StreamMessage> ViewSession::nextMessage() {
  auto message = stream_.poll();
  while (message && message->request <= forgotten_request_) message = stream_.poll();
  return message;
}

void ViewSession::follow(const ViewSession& other) {
  interaction_ = other.interaction_;
  last_update_ = other.last_update_;
  state_ = other.state_;
  history_ = other.history_;
  // The first view of a volume follows from its values.
  const ViewState &before = other.opening_.view(), &first = opening_.view();
  const auto adopt = [&](ViewState& view) {
    double& isovalue = view.surfaces[0].isovalue;
    if (isovalue == before.surfaces[0].isovalue) isovalue = first.surfaces[0].isovalue;
    if (view.value_window == before.value_window) view.value_window = first.value_window;
    adoptOpening(before, first, view);
  };
  adopt(state_);
  history_.amend(adopt);
  opening_.follow(other.opening_);
}

void ViewSession::show(const ViewState& state) {
  state_ = state;
  opening_.end();
}

bool ViewSession::hasShown() const {
  return passes_ > 0 || over_budget_ || !surfaces_->error().empty();
}

Wishes ViewSession::apply(const InputEvent& event, double seconds, bool on_panel) {
  const bool selects = interaction_.tool == Interaction::Tool::kPiece;
  const Wishes wishes = applyEvent(event, seconds, on_panel, volume_, interaction_, state_);
  grantView(wishes);
  // Esc: its box goes with the tool.
  if (selects && interaction_.tool == Interaction::Tool::kNone) pieces_.select(std::nullopt);
  return wishes;
}

void ViewSession::grantView(const Wishes& wishes) {
  if (wishes.focus_at)
    if (const auto point = surfaceAt(*wishes.focus_at)) focusOn(*point, volume_, state_);
  if (wishes.measure_at)
    if (const auto point = surfaceAt(*wishes.measure_at)) measureAt(*point, interaction_, state_);
  if (wishes.piece_at)
    if (const auto point = surfaceAt(*wishes.piece_at)) listPieces(point);
  if (wishes.keep_piece) keepSelectedPiece();
  if (wishes.hide_piece) hideSelectedPiece();
  if (wishes.first_view) {
    if (!opening_.hasFramed()) opening_.restart();  // another view came first
    state_ = opening_.view();
  }
  if (wishes.frame_surfaces)
    state_.camera =
        framed(state_.camera, shownBox().value_or(volume_.box()), interaction_.aspect());
  if (wishes.undo) state_ = history_.undo(state_).value_or(state_);
  if (wishes.redo) state_ = history_.redo(state_).value_or(state_);
}

void ViewSession::update(double seconds, UploadAllowance& allowance) {
  now_ = seconds;
  advanceFlight(std::clamp(seconds - last_update_, 0.0, 0.1), volume_, interaction_, state_);
  last_update_ = seconds;
  state_ = bounded(state_, volume_);
  // They come first in a frame, so that surfaces that keep coming leave them room.
  planes_.update(*renderer_, planesOf(state_, volume_, interaction_.size.y), allowance);
  // The past extractions decide the size of the next request.
  takeNews(surfaces_->pump([&] { return nextMessage(); }, clockSeconds, allowance));
  updateOpening();
  pieces_.update();
  const bool is_held = interaction_.drag != Interaction::Drag::kNone || interaction_.flying;
  history_.note(state_, is_held, seconds);
  requestSurfaces(seconds);
}

std::optional<WorldBox> ViewSession::shownBox() const {
  const auto shown = surfaces_->shownBox();
  if (!shown) return std::nullopt;
  const double step = preview_of_ ? static_cast<double>(preview_of_->step) : 1.0;
  return volume_.boxAround(step * (*shown)[0], step * (*shown)[1]);
}

void ViewSession::updateOpening() {
  if (opening_.isOver() || !(interaction_.size.y > 0.0)) return;
  OpeningView::Sight sight;
  sight.box = shownBox();
  // The slices of a preview grow; the camera stays.
  if (preview_of_ && sight.box) sight.box = volume_.box();
  sight.radius = shown_pass_.radius;
  if (shown_pass_.bricks_read == 0) sight.extraction_seconds = shown_pass_.seconds;
  sight.waited = clockSeconds() - last_news_;
  sight.over_budget = over_budget_;
  sight.is_whole = !preview_of_ && isFine();
  sight.is_preview = preview_of_.has_value();
  const ViewState before = opening_.view();
  opening_.update(sight, volume_, interaction_.aspect(), state_);
  // It is no step of the user's.
  history_.amend([&](ViewState& view) { adoptOpening(before, opening_.view(), view); });
}

// While the state changes, one pass that fits the time; at rest, all passes up to the wanted
// radius.
void ViewSession::requestSurfaces(double seconds) {
  const double wanted = radiusAtRest();
  const bool first = !requested_;
  if (first || ask_again_ || !asksAsRequested()) {
    const double age = longestWait().value_or(0.0);
    requested_ = Asked{state_, interaction_.size.y};
    ask_again_ = false;
    last_change_ = seconds;
    over_budget_ = false;
    asked_for_all_ = first;
    if (first)
      requestPasses(passRadii(quality_.radius, wanted), true, seconds);
    else
      requestQuickly(std::min(hurriedRadius(quality_.radius, age), wanted), seconds);
  } else if (!asked_for_all_ && seconds - last_change_ >= kRestSeconds) {
    asked_for_all_ = true;
    // A surface that is shown is not made again.
    if (over_budget_ || (showsTheLatest() && shown_pass_.radius >= wanted)) return;
    requestPasses(showsTheLatest() ? finerRadii(shown_pass_.radius, wanted)
                                   : passRadii(quality_.radius, wanted),
                  shown_request_ != last_request_, seconds);
  }
}

bool ViewSession::asksAsRequested() const {
  return asksForTheSame(requested_->state, state_) &&
         (!state_.view_pixels || requested_->height == interaction_.size.y);
}

double ViewSession::radiusAtRest() const {
  return preview_of_ ? volume_.diagonal() : wantedRadius(state_, volume_);
}

// Which one of the volume the pyramid's level 0 is.
int ViewSession::firstLevel() const {
  return preview_of_ ? std::countr_zero(static_cast<std::uint64_t>(preview_of_->step)) : 0;
}

// The query of the view, in samples of the pyramid.
Query ViewSession::currentQuery(std::size_t surface, double radius) const {
  Query query = queryOf(state_, volume_, surface, radius, interaction_.size.y);
  if (!preview_of_) return query;
  Query coarse;
  coarse.isovalue = query.isovalue;
  const auto step = static_cast<double>(preview_of_->step);
  if (query.focus)
    coarse.focus = FocusSphere{query.focus->center / step, query.focus->radius / step};
  return coarse;
}

StreamPass ViewSession::passOf(double radius) const {
  StreamPass pass;
  pass.radius = radius;
  for (std::size_t s = 0; s < state_.surfaces.size(); ++s) {
    if (!state_.surfaces[s].visible) continue;
    const int number = static_cast<int>(s);
    if (isShown(s, radius))
      pass.kept.push_back({number, surfaces_->contentOf(number)});
    else
      pass.queries.push_back({number, currentQuery(s, radius), state_.surfaces[s].pieces});
  }
  return pass;
}

// As fine as with this radius, or finer, but not finer than wanted, and no pass under way will
// replace it.
bool ViewSession::isShown(std::size_t surface, double radius) const {
  const int number = static_cast<int>(surface);
  if (!request_times_.empty() && kept_.count(number) == 0) return false;
  const auto found = shown_surfaces_.find(number);
  return found != shown_surfaces_.end() && found->second.is_complete &&
         found->second.radius >= radius && found->second.radius <= radiusAtRest() &&
         asksForTheSameSurface(found->second.asked.state, state_, surface) &&
         (!state_.view_pixels || found->second.asked.height == interaction_.size.y);
}

void ViewSession::requestQuickly(double radius, double seconds) {
  StreamRequest request;
  request.passes.push_back(passOf(radius));
  boundFirstPass(request);
  send(std::move(request), seconds);
}

// A surface that a user waits for is given up for half the radius if it has many triangles.
void ViewSession::boundFirstPass(StreamRequest& request) const {
  for (const double smaller : smallerRadii(request.passes[0].radius))
    request.smaller.push_back(passOf(smaller));
  request.most_triangles = mostTriangles(quality_);
}

StreamValues ViewSession::wantedValues() const {
  if (state_.coloring == ViewColoring::kGradient) return {StreamValues::What::kGradient, ""};
  // Until a pyramid was named there is nothing to colour by.
  if (state_.coloring == ViewColoring::kOther && !state_.values.other.empty())
    return {StreamValues::What::kOther, state_.values.other};
  return {};
}

// `at_once`: no part of the requested surfaces is shown yet.
void ViewSession::requestPasses(const std::vector<double>& radii, bool at_once, double seconds) {
  StreamRequest request;
  for (const double radius : radii) request.passes.push_back(passOf(radius));
  request.at_once = at_once;
  if (at_once) boundFirstPass(request);
  send(std::move(request), at_once ? std::optional(seconds) : std::nullopt);
}

void ViewSession::send(StreamRequest request, std::optional<double> waiting_since) {
  all_passes_done_ = false;
  kept_.clear();
  for (const StreamPass::KeptSurface& kept : request.passes[0].kept) kept_.insert(kept.surface);
  request.values = wantedValues();
  request.may_reuse = !shows_less_;
  shows_less_ = false;
  first_radius_ = request.passes[0].radius;
  // All that may fail comes before the request, whose answer is looked up here.
  auto time = decltype(request_times_){{0, waiting_since}}.extract(0);
  auto asked = decltype(asked_){{0, Asked{state_, interaction_.size.y}}}.extract(0);
  last_request_ = stream_.request(std::move(request));
  time.key() = asked.key() = last_request_;
  last_news_ = clockSeconds();
  request_times_.insert(std::move(time));
  asked_.insert(std::move(asked));
}

void ViewSession::noteDrawing(std::optional<double> seconds) {
  opening_.noteDrawing(seconds);
  if (!seconds) return;
  quality_ = drawn(quality_, trianglesShown(), *seconds);
  const double now = clockSeconds();
  drawings_.add(now - *seconds, now);
  last_drawing_ = *seconds;
}

bool ViewSession::drawsBetterLater() const {
  return last_drawing_ > kPostponedSeconds &&
         longestWait().value_or(kPostponedSeconds) < kPostponedSeconds;
}

// Seconds for which the user has waited for a surface that is not shown yet; none without one.
std::optional<double> ViewSession::longestWait() const {
  for (const auto& [request, since] : request_times_)
    if (since) return now_ - *since;
  return std::nullopt;
}

// `pass` will be shown; the wait for the requests that it answers is over.
void ViewSession::noteWait(const StreamMessage& pass) {
  const std::optional<double> waited = longestWait();
  request_times_.erase(request_times_.begin(), request_times_.upper_bound(pass.request));
  if (!waited || longestWait() == waited) return;
  waits_.push_back(
      surfaceWait(*waited, pass.seconds, clockSeconds() - pass.ended, drawings_.since(pass.ended)));
}

void ViewSession::takeNews(const SurfaceSet::News& news) {
  waits_.clear();
  for (const StreamMessage& pass : news.passes) {
    if (pass.too_many) {
      quality_ = givenUp(quality_, pass.radius, pass.triangles_made, pass.seconds);
      continue;
    }
    noteWait(pass);
    if (pass.is_complete && !pass.surfaces.empty()) quality_ = measuredPass(quality_, pass);
    shown_request_ = pass.request;
    asked_.erase(asked_.begin(), asked_.lower_bound(shown_request_));
    std::map<int, ShownSurface> shown;
    for (const StreamPass::KeptSurface& kept : pass.kept)
      shown[kept.surface] = shown_surfaces_.at(kept.surface);
    for (const StreamedSurface& made : pass.surfaces)
      shown[made.surface] = {asked_.at(shown_request_), pass.radius, pass.is_complete, made};
    shown_surfaces_ = std::move(shown);
    shown_pass_ = pass;
    last_news_ = clockSeconds();
    ++passes_;
    all_passes_done_ = pass.request == last_request_ && pass.last_pass;
  }
  shows_less_ = shows_less_ || news.over_budget || news.stale;
  if (news.over_budget) shrinkToBudget();
  ask_again_ = ask_again_ || news.stale;
  if (news.over_budget || news.failed) request_times_.clear();
}

void ViewSession::shrinkToBudget() {
  stream_.cancel();
  over_budget_ = true;
  // The next drag begins with a radius that fits.
  quality_.radius = std::max(kLeastRadius, 0.7 * std::min(quality_.radius, first_radius_));
  // The part of this request that is shown already is as fine as it gets.
  if (!showsTheLatest() && first_radius_ > 1.0)
    requestPasses({std::max(1.0, 0.5 * first_radius_)}, false, now_);
}

std::uint64_t ViewSession::trianglesShown() const {
  std::uint64_t triangles = 0;
  for (const auto& [number, surface] : shown_surfaces_) triangles += surface.counts.triangles;
  return triangles;
}

// The surface of the latest request, and all of its bricks were there.
bool ViewSession::showsTheLatest() const {
  return shown_request_ == last_request_ && shown_pass_.is_complete;
}

SceneFrame ViewSession::sceneNow(int width, int height) const {
  SceneFrame frame = sceneOf(state_, volume_, width, height);
  const GridGeometry& lattice = pyramid_->spec().geometry;
  frame.lattice = {lattice.indexToWorldMatrix(), lattice.origin};
  frame.chunks = surfaces_->shown();
  frame.first_level = firstLevel();
  if (const auto window = valueWindow()) {
    const auto& values = shown_pass_.values;
    const auto shareOf = [&](double value) {
      return (value - values[0]) / (values[1] - values[0]);
    };
    if (state_.coloring == ViewColoring::kPlaneDistance) {
      frame.value_plane = SceneClipPlane{state_.values.plane.normal, state_.values.plane.offset};
      frame.value_window = window;
    } else {
      frame.value_window = {shareOf((*window)[0]), shareOf((*window)[1])};
    }
  }
  for (WantedPlane wanted : planesOf(state_, volume_, interaction_.size.y)) {
    const auto shown = planes_.shown(wanted);
    if (!shown) continue;
    wanted.plane = shown->plane;
    frame.slices.push_back(sliceOf(wanted, shown->image, state_, volume_));
  }
  return frame;
}

bool ViewSession::draw() {
  const int width = static_cast<int>(interaction_.size.x);
  const int height = static_cast<int>(interaction_.size.y);
  if (width < 1 || height < 1) return false;
  SceneFrame frame = sceneNow(width, height);
  frame.pixel_scale = interaction_.scale;
  drawn_camera_.reset();
  renderer_->draw(frame);
  drawn_camera_ = frame.camera;
  drawn_state_ = state_;
  return true;
}

Image ViewSession::picture(const glm::dvec2& size, int times, bool layers) {
  const int width = std::max(1, static_cast<int>(size.x));
  const int height = std::max(1, static_cast<int>(size.y));
  const int factor = std::clamp(renderer_->greatestSize() / std::max(width, height), 1, times);
  SceneFrame frame = sceneNow(factor * width, factor * height);
  frame.pixel_scale = interaction_.scale * factor;
  frame.transparent = state_.pictures.transparent;
  drawn_camera_.reset();
  cursor_hit_.reset();
  renderer_->draw(frame);
  Image image = renderer_->picture();
  if (!layers) return image;
  frame.normals = true;
  frame.transparent = false;
  renderer_->draw(frame);
  image.normals = renderer_->picture().rgb;
  // Samples of a pixel were averaged.
  for (std::size_t i = 0; i + 2 < image.normals.size(); i += 3) {
    glm::vec3 normal(image.normals[i], image.normals[i + 1], image.normals[i + 2]);
    const float length = glm::length(normal);
    for (glm::length_t c = 0; c < 3; ++c)
      image.normals[i + static_cast<std::size_t>(c)] = length > 1e-3f ? normal[c] / length : 0.0f;
  }
  image.depth = renderer_->distances();
  return image;
}

PictureNotes ViewSession::notes() const {
  return notesOf(state_, status().levels, valueWindow(), pyramid_->spec().geometry.unit);
}

bool ViewSession::settled() const {
  return isFine() && !pieces_.busy() &&
         (preview_of_ || opening_.isOver() || !(interaction_.size.y > 0.0));
}

bool ViewSession::isFine() const {
  const bool surfaces_done = asked_for_all_ &&
                             (all_passes_done_ || over_budget_ || !surfaces_->error().empty()) &&
                             requested_ && asksAsRequested();
  return surfaces_done && !stream_.busy() && !surfaces_->isReleasing() && !planes_.busy();
}

SessionStatus ViewSession::status() const {
  SessionStatus status;
  status.wanted_radius = radiusAtRest();
  status.shown_radius = shown_pass_.radius;
  status.triangles = trianglesShown();
  status.triangles_made = shown_pass_.triangles_made;
  status.shown_bytes = surfaces_->shownBytes();
  status.bricks_read = shown_pass_.bricks_read;
  status.extract_seconds = shown_pass_.seconds;
  for (const auto& [number, surface] : shown_surfaces_)
    addCounts(surface.counts.levels, status.levels);
  for (LevelCounts& level : status.levels) level.level += firstLevel();
  status.triangles_per_second = quality_.triangles_per_second;
  status.drag_radius = quality_.radius;
  status.passes = passes_;
  status.surface_age = longestWait().value_or(0.0);
  if (!asked_for_all_)
    status.doing = "following the user";
  else if (isFine())
    status.doing = "ready";
  else if (!shown_pass_.is_complete)
    status.doing = "reading what is lacking";
  else
    status.doing = "refining to radius " + whole(status.wanted_radius);
  if (preview_of_) status.limited = "preview at 1/" + std::to_string(preview_of_->step);
  if (!opening_.limit(state_).empty()) status.limited = opening_.limit(state_);
  if (over_budget_)
    status.limited = showsTheLatest()
                         ? "GPU budget reached: showing radius " + whole(status.shown_radius) +
                               " of " + whole(status.wanted_radius)
                         : "GPU budget reached: not even the coarsest surface fits";
  if (const std::size_t lost = lostPieces(); lost > 0 && status.limited.empty())
    status.limited = std::to_string(lost) +
                     (lost == 1 ? " chosen piece is" : " chosen pieces are") +
                     " not there at this isovalue";
  for (const std::string* error : {&surfaces_->error(), &planes_.error()})
    if (!error->empty()) status.error = *error;
  return status;
}

std::optional<glm::dvec3> ViewSession::surfaceAt(const glm::dvec2& pixel) {
  // The depths are those of the camera that drew them, and not of one that has moved since.
  if (!drawn_camera_) return std::nullopt;
  const std::optional<double> distance = renderer_->distanceAt(pixel);
  if (!distance) return std::nullopt;
  return rayThrough(*drawn_camera_, interaction_.toPicture(pixel + 0.5)).at(*distance);
}

std::optional<glm::dvec3> ViewSession::surfaceUnderCursor() {
  const bool rests = isFine() && interaction_.drag == Interaction::Drag::kNone &&
                     !interaction_.flying && drawn_state_ && *drawn_state_ == state_;
  if (!rests) return std::nullopt;
  const bool is_known = cursor_hit_ && cursor_hit_->cursor == interaction_.cursor &&
                        cursor_hit_->size == interaction_.size && cursor_hit_->view == state_ &&
                        cursor_hit_->passes == passes_;
  if (!is_known)
    cursor_hit_ = CursorHit{interaction_.cursor, interaction_.size, state_, passes_,
                            surfaceAt(interaction_.cursor)};
  return cursor_hit_->point;
}

MeshOrder ViewSession::meshOrder(const std::string& path) const {
  Query query = currentQuery(static_cast<std::size_t>(state_.active_surface), radiusAtRest());
  if (state_.mesh_distance) query.simplify = SimplifyOptions{*state_.mesh_distance};
  return {pyramid_, query, path,
          state_.surfaces[static_cast<std::size_t>(state_.active_surface)].pieces};
}

void ViewSession::writeShownMesh(const std::string& path) const {
  const auto sink = makeMeshFileSink(path, {});
  takeShownMesh(*renderer_, surfaces_->shown(),
                {pyramid_->spec().geometry, pyramid_->spec().voxels}, *sink);
}

}  // namespace isobrick
