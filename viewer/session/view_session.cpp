#include "isobrick/viewer/session/view_session.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/session/drawn_scene.h"

namespace isobrick {
namespace {

// What is still that of the opening view follows it.
void adoptOpening(const ViewState& before, const ViewState& after, ViewState& view) {
  if (view.camera == before.camera) view.camera = after.camera;
  if (view.focus == before.focus) view.focus = after.focus;
}

double firstIsovalue(const ViewVolume& volume) {
  return volume.isovalues.empty() ? volume.least_value : volume.isovalues.front();
}

ComponentSeed seedOf(const SurfaceComponent& piece) { return {piece.point, piece.area}; }

// Why the active surface, of a view of more volumes, is not there; empty: it is.
std::string missingVolume(const ViewState& state, std::size_t besides) {
  const int number = activeSurface(state).volume;
  if (number >= 0 && static_cast<std::size_t>(number) <= besides) return {};
  return "the active surface is of volume " + std::to_string(number) +
         ", which is not open; open all volumes of the view with it";
}

// The same of a mask.
std::string maskWords(const std::string& missing) {
  if (missing.empty()) return {};
  return "the mask '" + withoutSecrets(missing) +
         "' is not open, and cuts nothing; open the view with --state";
}

}  // namespace

// NOLINTNEXTLINE(performance-unnecessary-value-param): as the other one
ViewSession::ViewSession(std::shared_ptr<const Pyramid> pyramid, SceneRenderer& renderer,
                         const SessionOptions& options)
    : ViewSession(pyramid, histogramOf(*pyramid), renderer, options) {}

ViewSession::ViewSession(std::shared_ptr<const Pyramid> pyramid, ValueHistogram histogram,
                         SceneRenderer& renderer, const SessionOptions& options)
    : shown_(std::move(pyramid), options.preview_of, histogram.isovalues, options.masks,
             options.is_step),
      histogram_(std::move(histogram)),
      masks_(options.masks),
      renderer_(&renderer),
      state_(firstView(volume(), 1.0)),
      opening_(state_),
      known_(std::make_shared<KnownComponents>()),
      requests_(shown_, histogram_, renderer, options.gpu_budget, options.threads, known_),
      planes_(shown_.pyramid(), shown_.step()),
      slice_views_(shown_.pyramid(), shown_.step()),
      pieces_(shown_.pyramid(), options.threads, known_) {
  state_.region = options.region;
  state_.surfaces[0].isovalue = firstIsovalue(volume());
  state_.ambient_occlusion = !renderer.isSoftware();
  for (const OpenedVolume& opened : options.beside) {
    beside_sources_.push_back(opened.source);
    const std::size_t number = state_.surfaces.size();
    beside_.push_back(std::make_unique<BesideVolume>(opened, static_cast<int>(number),
                                                     shown_.lattice(), options.masks, renderer,
                                                     options.gpu_budget, options.threads));
    ViewSurface& surface = state_.surfaces.emplace_back();
    surface.isovalue = firstIsovalue(beside_.back()->volume());
    surface.color = componentColor(number);
    surface.volume = static_cast<int>(number);
  }
  opening_ = OpeningView(state_);
}

ViewSession::~ViewSession() { planes_.release(*renderer_); }

void ViewSession::suspend() {
  planes_.release(*renderer_);
  requests_.suspend();
  for (const auto& beside : beside_) beside->requests().suspend();
  scene_.forget();
  scene_.forgetQuestions();
  clicks_.clear();
  under_cursor_.reset();
}

void ViewSession::resume(SceneRenderer& renderer) {
  renderer_ = &renderer;
  requests_.resume(renderer);
  for (const auto& beside : beside_) beside->requests().resume(renderer);
}

const BesideVolume* ViewSession::activeBeside() const {
  const int number = activeSurface(state_).volume;
  const bool is_there = number > 0 && number <= std::ssize(beside_);
  return is_there ? beside_[static_cast<std::size_t>(number) - 1].get() : nullptr;
}

const ShownVolume& ViewSession::activeShown() const {
  const BesideVolume* const beside = activeBeside();
  return beside != nullptr ? beside->shown() : shown_;
}

const ValueHistogram& ViewSession::activeHistogram() const {
  const BesideVolume* const beside = activeBeside();
  return beside != nullptr ? beside->histogram() : histogram_;
}

double ViewSession::predictedTriangles(double isovalue) const {
  const BesideVolume* const beside = activeBeside();
  const SurfaceRequests& requests = beside != nullptr ? beside->requests() : requests_;
  return requests.shareOfFinest() * activeHistogram().trianglesAt(isovalue);
}

bool ViewSession::isOverBudget() const {
  return requests_.isOverBudget() || std::ranges::any_of(beside_, [](const auto& beside) {
           return beside->requests().isOverBudget();
         });
}

// Places are those of the session's own volume, isovalues those of the active surface's.
ViewVolume ViewSession::volumeOfKeys() const {
  ViewVolume result = volume();
  result.least_value = activeVolume().least_value;
  result.greatest_value = activeVolume().greatest_value;
  result.isovalues = activeVolume().isovalues;
  if (activeBeside() != nullptr) result.has_all_values = false;  // of all surfaces
  return result;
}

void ViewSession::follow(const ViewSession& other) {
  interaction_ = other.interaction_;
  last_update_ = other.last_update_;
  state_ = other.state_;
  history_ = other.history_;
  if (!other.previewOf()) {
    opening_ = other.opening_;
    return;
  }
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
  if (isPlaced(state.camera)) return;
  state_.camera = framed(state.camera, volume().box(), interaction_.aspect());
  opening_.frame(state_.camera);
}

Wishes ViewSession::apply(const InputEvent& event, double seconds, bool on_panel) {
  const bool selects = interaction_.tool == Interaction::Tool::kPiece;
  const Wishes wishes = applyEvent(event, seconds, on_panel, volumeOfKeys(), interaction_, state_);
  grantView(wishes);
  // Esc: its box goes with the tool.
  if (selects && interaction_.tool == Interaction::Tool::kNone) pieces_.select(std::nullopt);
  return wishes;
}

void ViewSession::grantView(const Wishes& wishes) {
  if (wishes.focus_at) ask(ClickedFor::kFocus, *wishes.focus_at);
  if (wishes.measure_at) ask(ClickedFor::kMeasure, *wishes.measure_at);
  if (wishes.piece_at) ask(ClickedFor::kPiece, *wishes.piece_at);
  takePoints();
  if (wishes.keep_piece) keepSelectedPiece();
  if (wishes.hide_piece) hideSelectedPiece();
  if (wishes.first_view) {
    if (!opening_.hasFramed()) opening_.restart();  // another view came first
    state_ = opening_.view();
  }
  if (wishes.frame_surfaces)
    state_.camera =
        framed(state_.camera, shownBox().value_or(volume().box()), interaction_.aspect());
  if (wishes.undo) state_ = history_.undo(state_).value_or(state_);
  if (wishes.redo) state_ = history_.redo(state_).value_or(state_);
}

void ViewSession::ask(ClickedFor what, const glm::dvec2& pixel) {
  if (const std::uint64_t question = scene_.ask(*renderer_, pixel)) clicks_[question] = what;
}

void ViewSession::takePoints() {
  while (const auto answer = scene_.take(*renderer_)) {
    if (under_cursor_ && under_cursor_->question == answer->question) {
      under_cursor_->question = 0;
      under_cursor_->point = answer->point;
    }
    const auto click = clicks_.extract(answer->question);
    if (click && answer->point) grant(click.mapped(), *answer->point);
  }
}

void ViewSession::grant(ClickedFor what, const glm::dvec3& point) {
  switch (what) {
    case ClickedFor::kFocus:
      return focusOn(point, volume(), state_);
    case ClickedFor::kMeasure:
      return measureAt(point, interaction_, state_);
    case ClickedFor::kPiece:
      return listPieces(point);
  }
}

void ViewSession::update(double seconds, UploadAllowance& allowance) {
  takePoints();
  advanceFlight(std::clamp(seconds - last_update_, 0.0, 0.1), volume(), interaction_, state_);
  last_update_ = seconds;
  state_ = bounded(state_, volume());
  for (const auto& beside : beside_) beside->bound(state_);
  // They come first in a frame, so that surfaces that keep coming leave them room.
  planes_.update(*renderer_, planesOf(state_, volume(), interaction_.size.y), allowance);
  // The past extractions decide the size of the next request.
  requests_.take(seconds, allowance);
  for (const auto& beside : beside_) beside->requests().take(seconds, allowance);
  updateOpening();
  slice_views_.update();
  updatePieces(seconds);
  const bool is_held =
      interaction_.drag != Interaction::Drag::kNone || interaction_.flying || interaction_.playing;
  history_.note(state_, is_held, seconds);
  requests_.request(wish(), seconds);
  for (const auto& beside : beside_) beside->requests().request(wishOf(*beside), seconds);
}

SurfaceWish ViewSession::wish() const {
  SurfaceWish wish = shown_.wishOf(state_, interaction_.size.y);
  for (std::size_t s = 0; s < wish.surfaces.size(); ++s)
    wish.surfaces[s].visible = wish.surfaces[s].visible && state_.surfaces[s].volume == 0;
  for (std::size_t s = 0; s < std::min(colored_by_.size(), wish.surfaces.size()); ++s)
    if (wish.surfaces[s].visible) wish.surfaces[s].listed = colored_by_[s];
  // A coarse level alone has no colours of pieces, and takes a list of its own for chosen ones.
  const bool has_pieces =
      state_.coloring == ViewColoring::kComponent ||
      std::ranges::any_of(wish.surfaces, [](const SurfaceWish::Surface& surface) {
        return surface.pieces != PieceChoice();
      });
  wish.is_whole = !has_pieces && (state_.focus.everywhere || !opening_.limit(state_).empty());
  return wish;
}

std::optional<WorldBox> ViewSession::shownBox() const {
  std::optional<WorldBox> all;
  const auto include = [&](const SurfaceRequests& requests) {
    const auto box = requests.shownBox();
    if (!box) return;
    const WorldBox in_world = shown_.boxAround(*box);
    if (!all) all = in_world;
    all->include(in_world.lower);
    all->include(in_world.upper);
  };
  include(requests_);
  for (const auto& beside : beside_) include(beside->requests());
  return all;
}

void ViewSession::updateOpening() {
  if (opening_.isOver() || !(interaction_.size.y > 0.0)) return;
  OpeningView::Sight sight;
  sight.is_preview = previewOf().has_value();
  sight.box = shownBox();
  // The slices of a preview grow; the camera stays.
  if (sight.is_preview && sight.box) sight.box = volume().box();
  const StreamMessage& pass = requests_.shown().pass();
  sight.radius = pass.radius;
  if (pass.bricks_read == 0) sight.extraction_seconds = pass.seconds;
  sight.waited = requests_.sinceNews();
  sight.over_budget = requests_.isOverBudget();
  sight.is_whole = !sight.is_preview && isFine();
  const ViewState before = state_;
  opening_.update(sight, volume(), interaction_.aspect(), state_);
  // It is no step of the user's.
  history_.amend([&](ViewState& view) { adoptOpening(before, state_, view); });
}

void ViewSession::noteDrawing(std::optional<double> seconds) {
  if (!drew_) return;
  opening_.noteDrawing(seconds);
  if (!seconds) return;
  requests_.noteDrawing(*seconds);
  for (const auto& beside : beside_) beside->requests().noteDrawing(*seconds);
}

SceneFrame ViewSession::sceneNow(int width, int height) const {
  SceneFrame frame = sceneOf(state_, volume(), width, height);
  frame.lattice = shown_.lattice();
  frame.chunks = requests_.chunks();
  for (const auto& beside : beside_) {
    for (const ChunkId chunk : beside->requests().chunks()) frame.chunks.push_back(chunk);
    for (const glm::dvec3& corner : cornersOf(beside->volume().box())) frame.bounds.include(corner);
  }
  frame.first_level = shown_.firstLevel();
  frame.color_by_component = state_.coloring == ViewColoring::kComponent &&
                             requests_.shown().pass().what == StreamValues::What::kComponent;
  if (const auto window = valueWindow()) {
    const auto& values = requests_.shown().pass().values;
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
  for (WantedPlane wanted : planesOf(state_, volume(), interaction_.size.y)) {
    const auto shown = planes_.shown(wanted);
    if (!shown) continue;
    wanted.plane = shown->plane;
    frame.slices.push_back(sliceOf(wanted, shown->image, state_, volume()));
  }
  return frame;
}

bool ViewSession::draw() {
  const int width = static_cast<int>(interaction_.size.x);
  const int height = static_cast<int>(interaction_.size.y);
  drew_ = width >= 1 && height >= 1;
  if (!drew_) return false;
  SceneFrame frame = sceneNow(width, height);
  frame.pixel_scale = interaction_.scale;
  // How long its pictures take decides about the view that a volume opens with.
  drew_ = scene_.draw(*renderer_, frame, !opening_.isOver());
  if (drew_) under_cursor_.reset();
  drawn_state_ = state_;
  return drew_;
}

SceneFrame ViewSession::pictureFrame(int width, int height) const {
  SceneFrame frame = sceneNow(width, height);
  frame.transparent = state_.pictures.transparent;
  return frame;
}

bool ViewSession::showsTheSameAt(int height) const {
  if (state_.view_pixels && height != interaction_.size.y) return false;
  const auto mostValues = [&](double of_height) {
    std::vector<int> values;
    for (const WantedPlane& plane : planesOf(state_, volume(), of_height))
      values.push_back(plane.most_values);
    return values;
  };
  return mostValues(height) == mostValues(interaction_.size.y);
}

PictureNotes ViewSession::notes() const {
  return notesOf(state_, status().levels, valueWindow(), pyramid().spec().geometry.unit,
                 coloredPieces());
}

bool ViewSession::settled() const {
  return isFine() && clicks_.empty() && !pieces_.busy() && !waitsForPieces() &&
         !slice_views_.busy() && (previewOf() || opening_.isOver() || !(interaction_.size.y > 0.0));
}

bool ViewSession::isFine() const {
  return requests_.isFine(wish()) && !planes_.busy() &&
         std::ranges::all_of(beside_, [&](const auto& beside) {
           return beside->requests().isFine(wishOf(*beside));
         });
}

SessionStatus ViewSession::status() const {
  SessionStatus status = statusOf(requests_, shown_, state_, isFine());
  for (const auto& beside : beside_) beside->addTo(status);
  if (!requests_.isOverBudget() && !opening_.limit(state_).empty())
    status.limited = opening_.limit(state_);
  if (const std::size_t lost = requests_.shown().lostPieces(); lost > 0 && status.limited.empty())
    status.limited = std::to_string(lost) +
                     (lost == 1 ? " chosen piece is" : " chosen pieces are") +
                     " not there at this isovalue";
  if (status.limited.empty()) status.limited = missingVolume(state_, beside_.size());
  if (status.limited.empty()) status.limited = maskWords(missingMask(state_.region, masks_));
  if (waitsForPieces() && isFine()) status.doing = "finding the pieces";
  if (hides_no_more_ && activeSurface(state_).pieces.hide.size() >= kMostSeeds)
    status.limited = std::to_string(kMostSeeds) +
                     " pieces are hidden, and no more can be: leave out small pieces, or keep one";
  if (const std::string error = pieces_.wantedError(); !error.empty()) status.error = error;
  for (const std::string* error : {&planes_.error(), &slice_views_.error()})
    if (!error->empty()) status.error = *error;
  return status;
}

std::optional<glm::dvec3> ViewSession::surfaceUnderCursor() {
  const bool rests = isFine() && interaction_.drag == Interaction::Drag::kNone &&
                     !interaction_.flying && drawn_state_ == state_;
  if (!rests) return std::nullopt;
  const glm::dvec2 cursor = interaction_.cursor;
  if (!under_cursor_)
    under_cursor_ = UnderCursor{cursor, scene_.ask(*renderer_, cursor), std::nullopt};
  else if (under_cursor_->question == 0 && under_cursor_->cursor != cursor)
    under_cursor_ = UnderCursor{cursor, scene_.ask(*renderer_, cursor), under_cursor_->point};
  takePoints();
  return under_cursor_ ? under_cursor_->point : std::nullopt;
}

MeshOrder ViewSession::meshOrder(const std::string& path) const {
  if (const std::string missing = missingVolume(state_, beside_.size()); !missing.empty())
    throw Error(missing);
  if (const std::string mask = missingMask(state_.region, masks_); !mask.empty())
    throw Error(maskWords(mask), {withoutSecrets(mask)});
  const auto surface = static_cast<std::size_t>(state_.active_surface);
  const BesideVolume* const beside = activeBeside();
  const SurfaceWish wish =
      beside != nullptr ? wishOf(*beside) : shown_.wishOf(state_, interaction_.size.y);
  const ShownVolume& shown = activeShown();
  Query query = shown.queryOf(wish, surface, wish.radius);
  // A query counts in samples, of which a preview has fewer.
  if (state_.mesh_distance) query.simplify = SimplifyOptions{*state_.mesh_distance / shown.step()};
  return {shown.pyramid(), query, path, wish.surfaces[surface].pieces};
}

void ViewSession::writeShownMesh(const std::string& path) const {
  const auto sink = makeMeshFileSink(path, {});
  takeShownMesh(*renderer_, sceneNow(1, 1).chunks,
                {pyramid().spec().geometry, pyramid().spec().voxels}, *sink);
}

void ViewSession::listPieces(const std::optional<glm::dvec3>& point) {
  hides_no_more_ = false;
  if (activeBeside() == nullptr) pieces_.request(activeSurface(state_).isovalue, point);
}

bool ViewSession::piecesAreCurrent() const {
  return activeBeside() == nullptr && pieces_.listed() &&
         pieces_.listed()->isovalue() == activeSurface(state_).isovalue;
}

void ViewSession::keepSelectedPiece() {
  if (const SurfaceComponent* const piece = pieces_.selectedPiece())
    keepOnly(seedOf(*piece), activeSurface(state_).pieces);
}

void ViewSession::hideSelectedPiece() {
  const SurfaceComponent* const piece = pieces_.selectedPiece();
  if (piece == nullptr) return;
  hides_no_more_ = !hide(seedOf(*piece), activeSurface(state_).pieces);
  if (!hides_no_more_) pieces_.select(std::nullopt);
}

void ViewSession::measureSelectedPiece() {
  const SurfaceComponent* const piece = pieces_.selectedPiece();
  if (piece == nullptr || state_.piece_measures.size() >= kMostPieceMeasures) return;
  const ListedComponents& listed = *pieces_.listed();
  state_.piece_measures.push_back(
      measureOf(*piece, listed.isovalue(), listed.level() + shown_.firstLevel()));
  state_.piece_measures.back().volume = volumeOf(*piece);
}

std::optional<double> ViewSession::volumeOf(const SurfaceComponent& piece) const {
  if (!piece.volume || activeSurface(state_).inside == InsideOf::kAbove) return piece.volume;
  return -*piece.volume;
}

// Asks for the lists that the surfaces are coloured by, and takes those that are there.
void ViewSession::updatePieces(double seconds) {
  std::set<double> isovalues;
  if (state_.coloring == ViewColoring::kComponent)
    for (const ViewSurface& surface : state_.surfaces)
      if (surface.visible && surface.volume == 0) isovalues.insert(surface.isovalue);
  pieces_.want(isovalues, seconds);
  pieces_.update();
  colored_by_.resize(isovalues.empty() ? 0 : state_.surfaces.size());
  for (std::size_t s = 0; s < colored_by_.size(); ++s)
    colored_by_[s] =
        state_.surfaces[s].volume == 0 ? pieces_.wanted(state_.surfaces[s].isovalue) : nullptr;
}

std::vector<ColoredPieces> ViewSession::coloredPieces() const {
  std::vector<ColoredPieces> colored;
  for (std::size_t s = 0; s < colored_by_.size(); ++s) {
    const ViewSurface& surface = state_.surfaces[s];
    const StreamedSurface* const shown = requests_.shown().surface(s);
    const auto listed = colored_by_[s];
    if (!surface.visible || !(surface.opacity > 0.0) || !listed || shown == nullptr) continue;
    ColoredPieces& pieces = colored.emplace_back();
    pieces.isovalue = surface.isovalue;
    pieces.count = shown->pieces;
    for (const std::size_t place : shown->largest)
      if (place < listed->list().size())
        pieces.largest.emplace_back(place, listed->list()[place].area);
  }
  return colored;
}

VolumeShow::Showing VolumeShow::showingOf(OpenedVolume opened, SceneRenderer& renderer) const {
  auto session =
      std::make_unique<ViewSession>(opened.file, opened.histogram, renderer, options_.of(opened));
  return {std::move(opened), std::move(session)};
}

void VolumeShow::close() {
  next_.reset();
  shown_.reset();
}

void VolumeShow::open(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size) {
  const bool with_panel = !shown_ || session()->interaction().show_panel;
  close();
  shown_ = showingOf(std::move(opened), renderer);
  session()->interaction().show_panel = with_panel;
  if (!(size.y > 0.0)) return;
  session()->apply(InputEvent::resized(size.x, size.y), 0.0, false);
}

void VolumeShow::take(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size) {
  const bool is_next_step = opened.step && shown_ && shown_->opened.step;
  if (is_next_step || (showsPreview() && opened.source == shown_->opened.source)) {
    next_ = showingOf(std::move(opened), renderer);
    return;
  }
  if (!opened.preview_of)
    aside_.reset();
  else if (shown_ && !showsPreview())
    aside_ = Aside{shown_->opened, session()->state()};
  open(std::move(opened), renderer, size);
}

void VolumeShow::giveUpPreview(SceneRenderer& renderer, const glm::dvec2& size) {
  if (!showsPreview()) return;
  if (!aside_) return close();
  Aside before = *std::exchange(aside_, std::nullopt);
  open(std::move(before.opened), renderer, size);
  session()->show(before.state);
}

void VolumeShow::update(double seconds, UploadAllowance& allowance) {
  if (!shown_) return;
  session()->update(seconds, allowance);
  if (!next_) return;
  next_->session->follow(*session());
  next_->session->update(seconds, allowance);
  const bool takes_over =
      next_->session->isFine() || (next_->session->hasShown() && !session()->settled());
  const bool is_soon = next_->opened.step && seconds < shown_since_ + kStepSeconds;
  if (!takes_over || is_soon) return;
  shown_ = std::exchange(next_, std::nullopt);
  shown_since_ = seconds;
  if (session()->interaction().playing && shown_->opened.step)
    session()->state().step = *shown_->opened.step;
  if (!showsPreview()) aside_.reset();
}

void VolumeShow::suspend() {
  if (shown_) session()->suspend();
  if (next_) next_->session->suspend();
}

void VolumeShow::resume(SceneRenderer& renderer) {
  if (shown_) session()->resume(renderer);
  if (next_) next_->session->resume(renderer);
}

}  // namespace isobrick
