#include "isobrick/viewer/serve/surface_session.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <variant>

#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/listed_components.h"

namespace isobrick {
namespace {

using SessionJson = nlohmann::ordered_json;

// [[4, 9], [12, 12]]
SessionJson rangesOf(const std::vector<ChunkId>& ascending) {
  SessionJson ranges = SessionJson::array();
  for (const ChunkId id : ascending) {
    if (!ranges.empty() && ranges.back()[1].get<ChunkId>() + 1 == id)
      ranges.back()[1] = id;
    else
      ranges.push_back({id, id});
  }
  return ranges;
}

std::vector<ChunkId> idsWithout(const std::vector<ChunkId>& a, const std::vector<ChunkId>& b) {
  std::vector<ChunkId> result;
  std::set_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(result));
  return result;
}

// A line of 20 Mbit/s carries 50,000 triangles in the time of a picture; with the extraction and
// 50 ms there and back, a quarter of a second goes by.
constexpr PaceTimes kLineTimes{.extraction = 0.06, .drawing = 0.14, .unhurried = 0.25};

}  // namespace

ChunkId ClientChunks::reserve(const SurfaceChunk& chunk) {
  const Kept kept{chunk.packed.empty() ? 0u : trianglesOfPacket(chunk.packed), chunk.bytes()};
  if (triangles_ + kept.triangles > most_triangles_.value_or(~std::uint64_t{0}) ||
      bytes_ + kept.bytes > most_bytes_.value_or(~std::uint64_t{0}))
    throw NoGraphicsMemory("the client has no room for the surface");
  dropped_.reserve(dropped_.size() + kept_.size() + 1);  // release() must not fail
  const ChunkId id = line_.nextChunk();
  kept_.emplace(id, kept);
  triangles_ += kept.triangles;
  bytes_ += kept.bytes;
  return id;
}

bool ClientChunks::uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                               std::size_t bytes) {
  if (!line_.hasRoom()) return false;
  if (begin + bytes < chunk.packed.size()) return true;
  std::vector<std::byte> packet = chunk.packed;
  setChunkNumber(packet, id, volume_);
  line_.sendChunk(std::move(packet));
  return true;
}

void ClientChunks::release(ChunkId chunk) noexcept {
  const auto kept = kept_.find(chunk);
  if (!kept->second.was_shown) {
    takeAway(kept->second);
    dropped_.push_back(chunk);
  }
  kept_.erase(kept);
}

void ClientChunks::takeAway(const Kept& kept) noexcept {
  triangles_ -= kept.triangles;
  bytes_ -= kept.bytes;
}

ClientChunks::Change ClientChunks::show(std::vector<ChunkId> shown) {
  std::sort(shown.begin(), shown.end());
  Change change{idsWithout(shown, shown_), idsWithout(shown_, shown)};
  for (const ChunkId id : change.show) {
    Kept& kept = kept_.at(id);
    kept.was_shown = true;
    takeAway(kept);
  }
  shown_ = std::move(shown);
  return change;
}

std::vector<ChunkId> ClientChunks::takeDropped() {
  std::vector<ChunkId> taken = dropped_;
  dropped_.clear();  // its room stays, for release()
  std::sort(taken.begin(), taken.end());
  return taken;
}

SurfaceSession::SurfaceSession(std::shared_ptr<const OpenedVolume> opened, std::uint32_t number,
                               int threads, ClientLine& line, std::function<void()> on_news)
    : opened_(std::move(opened)),
      shown_(opened_->file, std::nullopt, opened_->histogram.isovalues),
      steps_(shown_.volume().voxels),
      number_(number),
      line_(line),
      chunks_(line, number),
      requests_(shown_, opened_->histogram, chunks_, ChunkBudget(4 * kMostWaitingBytes), threads,
                std::make_shared<KnownComponents>(), std::move(on_news),
                {[this](SurfaceChunk& chunk) { packForClient(steps_, chunk); }, false},
                kLineTimes) {}

void SurfaceSession::take(const ClientMessage& message) {
  if (const auto* const shown = std::get_if<ClientShown>(&message)) {
    const auto pass = told_triangles_.find(shown->pass);
    if (pass == told_triangles_.end()) return;
    requests_.noteDrawing(pass->second, shown->seconds);
    requests_.noteSeen(clockSeconds());
    told_triangles_.erase(told_triangles_.begin(), std::next(pass));
  }
  if (const auto* const wish = std::get_if<ClientWish>(&message)) {
    wish_ = *wish;
    is_new_ = true;
    chunks_.bound(wish->most_triangles, wish->most_bytes);
    told_fine_ = false;
    told_error_.clear();
  }
}

std::optional<double> SurfaceSession::update() {
  UploadAllowance allowance;
  requests_.take(clockSeconds(), allowance);
  tellShown();
  if (wish_ && (is_new_ || isSeen())) {
    requests_.request(wish_->surfaces, clockSeconds());
    numbers_.try_emplace(requests_.latestRequest(), wish_->number);
    is_new_ = false;
  }
  tellDropped();
  tellState();
  if (allowance.isSpent()) return 0.0;
  constexpr double kFrame = 1.0 / 60;  // the pace goes by the time, too
  return told_fine_ ? std::nullopt : std::optional(kFrame);
}

// Nothing finer is made for a client that does not see the first answer yet: it may well have
// another wish when it does.
bool SurfaceSession::isSeen() const {
  constexpr double kUnsaidSeconds = 0.5;  // not all clients say it
  return told_triangles_.empty() || clockSeconds() - told_at_ > kUnsaidSeconds;
}

void SurfaceSession::tellShown() {
  const ShownSurfaces& shown = requests_.shown();
  if (shown.passes() == told_passes_) return;
  told_passes_ = shown.passes();
  const StreamMessage& pass = shown.pass();
  told_at_ = clockSeconds();
  constexpr std::size_t kMostUnseen = 64;
  told_triangles_.emplace(told_passes_, pass.triangles_made);
  if (told_triangles_.size() > kMostUnseen) told_triangles_.erase(told_triangles_.begin());
  numbers_.erase(numbers_.begin(), numbers_.lower_bound(pass.request));
  const ClientChunks::Change change = chunks_.show(requests_.chunks());
  SessionJson surfaces = SessionJson::array();
  for (std::size_t s = 0; s < wish_->surfaces.surfaces.size(); ++s) {
    const StreamedSurface* const made = shown.surface(s);
    if (made == nullptr) continue;
    SessionJson levels = SessionJson::array();
    for (const LevelCounts& counts : made->levels)
      levels.push_back({counts.level, counts.triangles});
    surfaces.push_back({{"surface", s}, {"triangles", made->triangles}, {"levels", levels}});
  }
  tellWithLimit({{"type", "show"},
                 {"wish", numbers_.count(pass.request) != 0 ? numbers_.at(pass.request) : 0},
                 {"pass", told_passes_},
                 {"show", rangesOf(change.show)},
                 {"drop", rangesOf(change.drop)},
                 {"triangles", shown.triangles()},
                 {"radius", pass.radius},
                 {"complete", pass.is_complete},
                 {"seconds", pass.seconds},
                 {"surfaces", std::move(surfaces)}});
}

void SurfaceSession::tellDropped() {
  if (const std::vector<ChunkId> dropped = chunks_.takeDropped(); !dropped.empty())
    tell({{"type", "drop"}, {"drop", rangesOf(dropped)}});
}

void SurfaceSession::tellState() {
  if (const std::string& error = requests_.error(); error != told_error_) {
    told_error_ = error;
    if (!error.empty()) tell({{"type", "error"}, {"error", error}});
  }
  if (told_fine_ || !wish_ || !requests_.isFine(wish_->surfaces)) return;
  told_fine_ = true;
  tellWithLimit({{"type", "fine"}, {"wish", wish_->number}});
}

void SurfaceSession::tellWithLimit(SessionJson message) const {
  if (requests_.isOverBudget())
    message["limited"] =
        "coarser than wished: all of it is more than the browser or the connection can take";
  tell(std::move(message));
}

void SurfaceSession::tell(SessionJson message) const {
  message["volume"] = number_;
  line_.sendWord(message);
}

}  // namespace isobrick
