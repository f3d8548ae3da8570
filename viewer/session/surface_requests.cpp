#include "isobrick/viewer/session/surface_requests.h"

#include <algorithm>
#include <utility>

#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/listed_components.h"

namespace isobrick {
namespace {

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

}  // namespace

void ShownSurfaces::take(const StreamMessage& pass, const SurfaceWish& asked) {
  std::map<int, Shown> shown;
  // One that is not known, since there was no memory for it, is asked for again.
  for (const StreamPass::KeptSurface& kept : pass.kept) {
    const auto before = surfaces_.find(kept.surface);
    if (before != surfaces_.end()) shown.insert(*before);
  }
  for (const StreamedSurface& made : pass.surfaces)
    shown[made.surface] = {asked.surfaces[static_cast<std::size_t>(made.surface)], asked.detail,
                           pass.radius, pass.is_complete, made};
  StreamMessage copy = pass;
  surfaces_ = std::move(shown);
  pass_ = std::move(copy);
  ++passes_;
}

bool ShownSurfaces::has(std::size_t surface, const SurfaceWish& wish, double least,
                        double most) const {
  const auto found = surfaces_.find(static_cast<int>(surface));
  if (found == surfaces_.end()) return false;
  const Shown& shown = found->second;
  return shown.is_complete && shown.radius >= least && shown.radius <= most &&
         shown.surface == wish.surfaces[surface] && shown.detail == wish.detail;
}

std::uint64_t ShownSurfaces::triangles() const {
  std::uint64_t triangles = 0;
  for (const auto& [number, surface] : surfaces_) triangles += surface.counts.triangles;
  return triangles;
}

std::vector<LevelCounts> ShownSurfaces::levels() const {
  std::vector<LevelCounts> levels;
  for (const auto& [number, surface] : surfaces_) addCounts(surface.counts.levels, levels);
  return levels;
}

const StreamedSurface* ShownSurfaces::surface(std::size_t number) const {
  const auto found = surfaces_.find(static_cast<int>(number));
  return found != surfaces_.end() ? &found->second.counts : nullptr;
}

std::size_t ShownSurfaces::lostPieces() const {
  std::size_t lost = 0;
  for (const auto& [number, surface] : surfaces_) lost += surface.counts.lost_pieces;
  return lost;
}

SurfaceRequests::SurfaceRequests(const ShownVolume& volume, const ValueHistogram& histogram,
                                 ChunkStore& store, ChunkBudget budget, int threads,
                                 std::shared_ptr<KnownComponents> known,
                                 std::function<void()> on_news, ChunkDelivery delivery,
                                 const PaceTimes& times)
    : volume_(volume),
      histogram_(histogram),
      budget_(std::move(budget)),
      known_(std::move(known)),
      pace_(SurfacePace::Rates(), times),
      surfaces_(std::in_place, store, budget_),
      stream_(volume.pyramid(), threads, std::move(on_news), SurfaceStream::kPatienceSeconds,
              known_, std::min(SurfaceStream::kQueueBytes, budget_.most() / 4),
              std::move(delivery)) {}

void SurfaceRequests::suspend() {
  surfaces_.reset();
  stream_.cancel();
  forgotten_request_ = last_request_;
  waits_.giveUp();
  requested_.reset();
  shown_.forget();
  shows_less_ = true;
}

void SurfaceRequests::resume(ChunkStore& store) { surfaces_.emplace(store, budget_); }

bool SurfaceRequests::hasShown() const {
  return shown_.passes() > 0 || over_budget_ || !surfaces_->error().empty();
}

bool SurfaceRequests::showsTheLatest() const {
  return shown_.pass().request == last_request_ && shown_.pass().is_complete;
}

bool SurfaceRequests::isFine(const SurfaceWish& wish) const {
  return asked_for_all_ && (all_passes_done_ || over_budget_ || !surfaces_->error().empty()) &&
         requested_ == wish && !stream_.busy() && !surfaces_->isReleasing();
}

double SurfaceRequests::sinceNews() const { return clockSeconds() - last_news_; }

void SurfaceRequests::noteDrawing(double seconds) {
  pace_.noteDrawing(shown_.triangles(), seconds);
  const double now = clockSeconds();
  waits_.noteDrawing(now - seconds, now);
}

// ----------------------------------------------------------------------------------- what has come

// Drops messages of passes that began before suspend(), as a part of these is gone.
std::optional<StreamMessage> SurfaceRequests::nextMessage() {
  auto message = stream_.poll();
  while (message && message->request <= forgotten_request_) message = stream_.poll();
  return message;
}

void SurfaceRequests::take(double seconds, UploadAllowance& allowance) {
  now_ = seconds;
  waits_.clearEnded();
  // If this fails, the surface is asked for again.
  const bool asks = std::exchange(ask_again_, true);
  const SurfaceSet::News news =
      surfaces_->pump([&] { return nextMessage(); }, clockSeconds, allowance);
  for (const StreamMessage& pass : news.passes) takePass(pass);
  shows_less_ = shows_less_ || news.over_budget || news.stale;
  if (news.over_budget) shrinkToBudget();
  ask_again_ = asks || news.stale;
  if (news.over_budget || news.failed) waits_.giveUp();
}

void SurfaceRequests::takePass(const StreamMessage& pass) {
  if (pass.too_many) return pace_.noteGivenUp(pass.radius, pass.triangles_made, pass.seconds);
  waits_.end(pass, now_);
  asked_.erase(asked_.begin(), asked_.lower_bound(pass.request));
  if (pass.is_complete && !pass.surfaces.empty()) {
    const double finest = finestTriangles(asked_.at(pass.request));
    pace_.noteExtraction(pass.radius, pass.triangles, pass.triangles_made, pass.seconds, finest);
    if (pass.kept.empty() && finest > 0.0)
      share_of_finest_ = static_cast<double>(pass.triangles) / finest;
  }
  shown_.take(pass, asked_.at(pass.request));
  last_news_ = clockSeconds();
  all_passes_done_ = pass.request == last_request_ && pass.last_pass;
  // Given up for a smaller one: it becomes finer after a rest.
  if (all_passes_done_ && pass.radius < requested_->radius) asked_for_all_ = false;
}

void SurfaceRequests::shrinkToBudget() {
  stream_.cancel();
  over_budget_ = true;
  pace_.noteOverBudget(first_radius_);
  // The part of this request that is shown already is as fine as it gets.
  if (!showsTheLatest() && first_radius_ > 1.0)
    requestPasses({std::max(1.0, 0.5 * first_radius_)}, false);
}

// ------------------------------------------------------------------------------- what is asked for

void SurfaceRequests::request(const SurfaceWish& wish, double seconds) {
  now_ = seconds;
  const bool first = !requested_;
  if (over_budget_ && surfaces_->hasMoreRoom()) {  // it becomes finer, after a rest
    over_budget_ = asked_for_all_ = false;
    last_change_ = seconds;
  }
  if (!first && !ask_again_ && changesAtRest(wish)) {
    requestAtRest(wish, requested_->withoutLists() != wish.withoutLists());
  } else if (ask_again_ || requested_ != wish) {
    const double age = longestWait().value_or(0.0);
    ask_again_ = true;  // until it was sent
    requested_ = wish;
    last_change_ = seconds;
    over_budget_ = false;
    asked_for_all_ = first;
    if (first)
      requestPasses(pace_.passRadii(wish.radius), true);
    else
      requestQuickly(pace_.quickRadius(wish.radius, age, finestTriangles(wish)));
  } else if (!asked_for_all_ && seconds - last_change_ >= SurfacePace::kRestSeconds) {
    const double shown = shown_.pass().radius;
    // A surface that is shown is not made again.
    if (!over_budget_ && !(showsTheLatest() && shown >= wish.radius))
      requestPasses(showsTheLatest() ? SurfacePace::finerRadii(shown, wish.radius)
                                     : pace_.passRadii(wish.radius),
                    shown_.pass().request != last_request_);
    asked_for_all_ = true;
  }
}

// The view asks for other colours, or for other pieces that are known, and nothing else.
bool SurfaceRequests::changesAtRest(const SurfaceWish& wish) const {
  const StreamMessage& shown = shown_.pass();
  const bool is_whole = shown_.passes() > 0 && shown.is_complete && shown.radius >= wish.radius;
  if (!asked_for_all_ || !is_whole || requested_ == wish) return false;
  SurfaceWish before = requested_->withoutLists();
  for (std::size_t s = 0; s < std::min(before.surfaces.size(), wish.surfaces.size()); ++s) {
    const SurfaceWish::Surface& surface = wish.surfaces[s];
    if (before.surfaces[s].pieces == surface.pieces) continue;
    before.surfaces[s].pieces = surface.pieces;
    const std::optional<int> level = onlyLevelOf(volume_.queryOf(wish, s, wish.radius));
    if (!level || known_->find(surface.isovalue, *level) == nullptr) return false;
  }
  return before == wish.withoutLists();
}

// In one pass: none of the surfaces gets coarser for that. `waits`: a user does.
void SurfaceRequests::requestAtRest(const SurfaceWish& wish, bool waits) {
  ask_again_ = true;  // until it was sent
  requested_ = wish;
  StreamRequest request;
  request.passes.push_back(passOf(wish.radius));
  request.at_once = waits;
  send(std::move(request), waits ? std::optional(now_) : std::nullopt);
}

StreamPass SurfaceRequests::passOf(double radius) const {
  StreamPass pass;
  pass.radius = radius = volume_.radiusOfPass(*requested_, radius);
  const std::vector<SurfaceWish::Surface>& surfaces = requested_->surfaces;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    if (!surfaces[s].visible) continue;
    const int number = static_cast<int>(s);
    if (isShown(s, radius))
      pass.kept.push_back({number, surfaces_->contentOf(number)});
    else
      pass.queries.push_back({number, volume_.queryOf(*requested_, s, radius), surfaces[s].pieces,
                              surfaces[s].listed});
  }
  return pass;
}

// As fine as with this radius, or finer, but not finer than wanted, and no pass under way will
// replace it.
bool SurfaceRequests::isShown(std::size_t surface, double radius) const {
  if (waits_.areThereAny() && kept_.count(static_cast<int>(surface)) == 0) return false;
  return shown_.has(surface, *requested_, radius, requested_->radius);
}

void SurfaceRequests::requestQuickly(double radius) {
  StreamRequest request;
  request.passes.push_back(passOf(radius));
  boundFirstPass(request);
  send(std::move(request), now_);
}

// A surface that a user waits for is given up for half the radius if it has many triangles.
void SurfaceRequests::boundFirstPass(StreamRequest& request) const {
  for (const double smaller : SurfacePace::smallerRadii(request.passes[0].radius))
    request.smaller.push_back(passOf(smaller));
  request.most_triangles = pace_.mostTriangles();
}

// Of all that is shown.
double SurfaceRequests::finestTriangles(const SurfaceWish& wish) const {
  double triangles = 0.0;
  for (const SurfaceWish::Surface& surface : wish.surfaces)
    if (surface.visible) triangles += histogram_.trianglesAt(surface.isovalue);
  return triangles;
}

StreamValues SurfaceRequests::wantedValues() const {
  const SurfaceWish::Detail& detail = requested_->detail;
  if (detail.values == ViewColoring::kGradient) return {StreamValues::What::kGradient, ""};
  // Until one of the surfaces is listed, they are as if they were not coloured.
  for (const SurfaceWish::Surface& surface : requested_->surfaces)
    if (surface.listed != nullptr) return {StreamValues::What::kComponent, ""};
  // Until a pyramid was named there is nothing to colour by.
  if (!detail.other.empty()) return {StreamValues::What::kOther, detail.other};
  return {};
}

// `at_once`: no part of the requested surfaces is shown yet.
void SurfaceRequests::requestPasses(const std::vector<double>& radii, bool at_once) {
  StreamRequest request;
  for (const double radius : radii) request.passes.push_back(passOf(radius));
  request.at_once = at_once;
  if (at_once) boundFirstPass(request);
  send(std::move(request), at_once ? std::optional(now_) : std::nullopt);
}

void SurfaceRequests::send(StreamRequest request, const std::optional<double>& waiting_since) {
  all_passes_done_ = false;
  kept_.clear();
  for (const StreamPass::KeptSurface& kept : request.passes[0].kept) kept_.insert(kept.surface);
  request.values = wantedValues();
  request.may_reuse = !shows_less_;
  shows_less_ = false;
  first_radius_ = request.passes[0].radius;
  // All that may fail comes before the request, whose answer is looked up here.
  auto wait = SurfaceWaits::entry(waiting_since);
  auto asked = decltype(asked_){{0, *requested_}}.extract(0);
  last_request_ = stream_.request(std::move(request));
  asked.key() = last_request_;
  last_news_ = clockSeconds();
  waits_.add(last_request_, std::move(wait));
  asked_.insert(std::move(asked));
  ask_again_ = false;
}

}  // namespace isobrick
