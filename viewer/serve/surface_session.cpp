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
SessionJson rangesOf(std::vector<ChunkId> chunks) {
  std::sort(chunks.begin(), chunks.end());
  SessionJson ranges = SessionJson::array();
  for (const ChunkId id : chunks) {
    if (!ranges.empty() && ranges.back()[1].get<ChunkId>() + 1 == id)
      ranges.back()[1] = id;
    else
      ranges.push_back({id, id});
  }
  return ranges;
}

// Both ascending.
std::vector<ChunkId> idsWithout(const std::vector<ChunkId>& a, const std::vector<ChunkId>& b) {
  std::vector<ChunkId> result;
  std::set_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(result));
  return result;
}

// A line of 20 Mbit/s carries 50,000 triangles in the time of a picture; with the extraction and
// 50 ms there and back, a quarter of a second goes by.
constexpr PaceTimes kLineTimes{.extraction = 0.06, .drawing = 0.14, .unhurried = 0.25};

}  // namespace

SurfaceSession::SurfaceSession(std::shared_ptr<const OpenedVolume> opened, int threads,
                               ClientLine& line, std::function<void()> on_news)
    : opened_(std::move(opened)),
      shown_volume_(opened_->file, std::nullopt, opened_->histogram.isovalues),
      steps_(volume().voxels),
      line_(line),
      requests_(shown_volume_, opened_->histogram, *this, ChunkBudget(4 * kMostWaitingBytes),
                threads, std::make_shared<KnownComponents>(), std::move(on_news),
                {[this](SurfaceChunk& chunk) { packForClient(steps_, chunk); }, false},
                kLineTimes) {}

ChunkId SurfaceSession::reserve(const SurfaceChunk& chunk) {
  const Load load{
      unshown_load_.triangles + (chunk.packed.empty() ? 0u : trianglesOfPacket(chunk.packed)),
      unshown_load_.bytes + chunk.bytes()};
  if (load.triangles > wish_->most_triangles.value_or(load.triangles) ||
      load.bytes > wish_->most_bytes.value_or(load.bytes))
    throw NoGraphicsMemory("the client has no room for the surface");
  dropped_.reserve(dropped_.size() + unshown_.size() + 1);  // release() must not fail
  unshown_[++last_chunk_] = {load.triangles - unshown_load_.triangles,
                             load.bytes - unshown_load_.bytes};
  unshown_load_ = load;
  return last_chunk_;
}

bool SurfaceSession::uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                                 std::size_t bytes) {
  if (!line_.hasRoom()) return false;
  if (begin + bytes < chunk.packed.size()) return true;
  std::vector<std::byte> packet = chunk.packed;
  setChunkNumber(packet, id);
  line_.sendChunk(std::move(packet));
  return true;
}

void SurfaceSession::release(ChunkId chunk) noexcept {
  if (takeFromUnshown(chunk)) dropped_.push_back(chunk);
}

// False: it is none of these.
bool SurfaceSession::takeFromUnshown(ChunkId chunk) noexcept {
  const auto found = unshown_.find(chunk);
  if (found == unshown_.end()) return false;
  unshown_load_.triangles -= found->second.triangles;
  unshown_load_.bytes -= found->second.bytes;
  unshown_.erase(found);
  return true;
}

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
  if (!dropped_.empty()) {
    line_.sendWord({{"type", "drop"}, {"drop", rangesOf(dropped_)}});
    dropped_.clear();  // its room stays, for release()
  }
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
  std::vector<ChunkId> now = requests_.chunks();
  std::sort(now.begin(), now.end());
  const std::vector<ChunkId> come = idsWithout(now, shown_), gone = idsWithout(shown_, now);
  for (const ChunkId chunk : come) takeFromUnshown(chunk);
  shown_ = std::move(now);
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
                 {"show", rangesOf(come)},
                 {"drop", rangesOf(gone)},
                 {"triangles", shown.triangles()},
                 {"radius", pass.radius},
                 {"complete", pass.is_complete},
                 {"seconds", pass.seconds},
                 {"surfaces", std::move(surfaces)}});
}

void SurfaceSession::tellState() {
  if (const std::string& error = requests_.error(); error != told_error_) {
    told_error_ = error;
    if (!error.empty()) line_.sendWord({{"type", "error"}, {"error", error}});
  }
  if (told_fine_ || !wish_ || !requests_.isFine(wish_->surfaces)) return;
  told_fine_ = true;
  tellWithLimit({{"type", "fine"}, {"wish", wish_->number}});
}

void SurfaceSession::tellWithLimit(SessionJson message) const {
  if (requests_.isOverBudget())
    message["limited"] =
        "coarser than wished: all of it is more than the browser or the connection can take";
  line_.sendWord(message);
}

}  // namespace isobrick
