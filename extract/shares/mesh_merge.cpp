// Merging shares: their batches, checked, in the order of the whole surface.
#include <fcntl.h>
#include <sys/stat.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <deque>
#include <mutex>

#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/shares/share_format.h"
#include "isobrick/extract/simplify/batch_simplifier.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/file_io.h"
#include "isobrick/storage/stored_grid.h"

namespace isobrick {
namespace {

using share_format::BatchRecord;
using share_format::SharedRecord;
using ShareHeader = share_format::Header;

// Longer identities are refused: a query has few choices.
constexpr std::uint64_t kMostIdentityBytes = std::uint64_t{1} << 24;
// And longer records: the largest brick has 256^3 cells of at most 5 triangles.
constexpr std::uint64_t kMostRecordBytes = std::uint64_t{1} << 32;

[[noreturn]] void failShare(const std::string& path, const std::string& what) {
  throw Error("'" + path + "' " + what, {.path = path});
}
[[noreturn]] void failDamaged(const std::string& path, std::uint64_t offset) {
  throw Error(
      "'" + path + "' is damaged at byte " + std::to_string(offset) + "; extract this share again",
      {.path = path, .offset = offset});
}

// An open share, whose header was checked.
class ShareFile {
 public:
  explicit ShareFile(const std::string& path)
      // Without O_NONBLOCK a pipe would be waited for.
      : path_(path), file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
    if (file_.get() < 0)
      throw Error("cannot open '" + path + "': " + std::strerror(errno) + "; check the path",
                  {.path = path});
    struct stat status = {};
    if (fstat(file_.get(), &status) != 0 || !S_ISREG(status.st_mode))
      failShare(path, "is not a regular file; name the files that 'isobrick extract' wrote");
    size_ = static_cast<std::uint64_t>(status.st_size);
    if (size_ >= sizeof header_) read(0, &header_, sizeof header_);
    if (std::memcmp(header_.magic, share_format::kMagic, sizeof header_.magic) != 0)
      failShare(path, "is no share of a mesh; make shares with 'isobrick extract'");
    if (header_.version != share_format::kVersion)
      failShare(path, "has version " + std::to_string(header_.version) +
                          ", this program reads version " + std::to_string(share_format::kVersion) +
                          "; extract it again");
    if (!isChecksum(checksum64(&header_, offsetof(ShareHeader, header_checksum)),
                    header_.header_checksum))
      failDamaged(path, 0);
    if (header_.file_bytes != size_)
      failShare(path, "has " + std::to_string(size_) + " bytes where its header says " +
                          std::to_string(header_.file_bytes) +
                          ": it was cut or changed; extract this share again");
    if (!isSane()) failShare(path, "has impossible numbers in its header; extract it again");
  }

  const std::string& path() const { return path_; }
  const ShareHeader& header() const { return header_; }
  // The offset at which the batches end.
  std::uint64_t batchesEnd() const { return size_ - header_.identity_bytes; }

  std::string identity() const {
    std::string text(header_.identity_bytes, '\0');
    read(batchesEnd(), text.data(), text.size());
    if (!isChecksum(checksum64(text.data(), text.size()), header_.identity_checksum))
      failDamaged(path_, batchesEnd());
    return text;
  }

  MeshFrame frame() const {
    MeshFrame frame;
    readGrid(header_, frame.voxels, frame.geometry);
    frame.inside = static_cast<InsideOf>(header_.inside);
    frame.has_caps = header_.has_caps == 1;
    return frame;
  }

  // The range lies in the file.
  void read(std::uint64_t offset, void* out, std::size_t bytes) const {
    const IoResult result = readBytesAt(file_.get(), offset, out, bytes);
    if (result.bytes < bytes)
      throw ResumableError(
          "cannot read '" + path_ + "' " + ioFailureText(offset, result) + "; check the disk",
          {.path = path_, .offset = offset});
  }

 private:
  bool isSane() const {
    return header_.of >= 1 && header_.of <= kMostShares && header_.number >= 1 &&
           header_.number <= header_.of && header_.has_caps <= 1 &&
           header_.inside <= static_cast<std::uint32_t>(InsideOf::kBelow) &&
           header_.first_brick <= header_.all_bricks &&
           header_.brick_count <= header_.all_bricks - header_.first_brick &&
           header_.batches <= header_.brick_count && header_.identity_bytes <= kMostIdentityBytes &&
           header_.identity_bytes <= size_ - sizeof header_ && isStoredGridSane(header_) &&
           isUsableGeometry(frame().geometry) && header_.simplify_in_world <= 1 &&
           header_.brick_cells <= 256 &&
           (header_.brick_cells == 0 ||
            (std::isfinite(header_.simplify_distance) && header_.simplify_distance > 0));
  }

  std::string path_;
  OpenDescriptor file_;
  std::uint64_t size_ = 0;
  ShareHeader header_{};
};

bool isFinite(const glm::vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

// The arrays of a record, one after the other.
class ArrayReader {
 public:
  explicit ArrayReader(const std::byte* at) : at_(at) {}
  // T has the layout of the file, without padding.
  template <typename T>
  void read(T* elements, std::size_t count) {
    if (count > 0) std::memcpy(elements, at_, count * sizeof(T));
    at_ += count * sizeof(T);
  }

 private:
  const std::byte* at_;
};
static_assert(sizeof(glm::vec3) == share_format::kVectorBytes);

// A batch on its way, with memory that is reused.
struct MergedBatch {
  PlacedBatch placed;
  std::vector<std::byte> bytes;  // of its record
  std::string path;
  std::uint64_t offset = 0;
};

// Numbers that are left of the simplification of a brick. False if it cannot go on from there.
bool decodeRemains(ArrayReader& arrays, PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  if (placed.remains == nullptr) placed.remains = std::make_shared<SimplifyRemains>();
  auto& [vertices, triangles] = *placed.remains;
  vertices.resize(batch.positions.size());
  triangles.resize(batch.triangles.size() / 3);
  arrays.read(vertices.data(), vertices.size());
  arrays.read(triangles.data(), triangles.size());
  const auto isFiniteAll = [](const auto& element) {
    std::array<float, sizeof element / sizeof(float)> numbers;
    std::memcpy(numbers.data(), &element, sizeof element);
    return std::ranges::all_of(numbers, [](float number) { return std::isfinite(number); });
  };
  bool is_sane =
      std::ranges::all_of(vertices, isFiniteAll) && std::ranges::all_of(triangles, isFiniteAll);
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    const std::uint32_t a = batch.triangles[i], b = batch.triangles[i + 1],
                        c = batch.triangles[i + 2];
    is_sane = is_sane && a != b && b != c && c != a;
  }
  std::vector<EdgeKey> keys;
  for (const MeshBatch::SharedVertex& shared : batch.shared) keys.push_back(shared.key);
  std::ranges::sort(keys);
  return is_sane && std::ranges::adjacent_find(keys) == keys.end();
}

// Fills the batch from its record, whose length was checked. Throws Error if anything in it could
// lead a sink astray.
void decode(MergedBatch& merged, const Index3& voxels, bool has_remains) {
  BatchRecord record;
  std::memcpy(&record, merged.bytes.data(), sizeof record);
  constexpr std::size_t kChecked = offsetof(BatchRecord, level);
  if (!isChecksum(checksum64(merged.bytes.data() + kChecked, merged.bytes.size() - kChecked),
                  record.checksum))
    failDamaged(merged.path, merged.offset);
  MeshBatch& batch = merged.placed.batch;
  bool is_sane = record.level < 64 && record.is_uniform <= 1 && record.indices % 3 == 0 &&
                 record.transition_indices <= record.indices &&
                 record.cap_indices <= record.indices && record.cap_indices % 3 == 0;
  batch.level = static_cast<int>(record.level);
  batch.is_uniform = record.is_uniform == 1;
  for (int axis = 0; axis < 3; ++axis) {
    is_sane = is_sane && record.brick[axis] >= 0 && record.brick[axis] < voxels[axis] &&
              record.origin[axis] >= 0 && record.origin[axis] < voxels[axis];
    batch.brick[axis] = record.brick[axis];
    batch.origin[axis] = record.origin[axis];
  }
  batch.transition_indices = record.transition_indices;
  batch.cap_indices = record.cap_indices;
  batch.cells = record.cells;
  batch.transition_cells = record.transition_cells;
  ArrayReader arrays(merged.bytes.data() + sizeof record);
  batch.positions.resize(record.positions);
  batch.normals.resize(record.positions);
  batch.triangles.resize(record.indices);
  arrays.read(batch.positions.data(), record.positions);
  arrays.read(batch.normals.data(), record.positions);
  arrays.read(batch.triangles.data(), record.indices);
  is_sane = is_sane && std::all_of(batch.positions.begin(), batch.positions.end(), isFinite) &&
            std::all_of(batch.normals.begin(), batch.normals.end(), isFinite) &&
            std::all_of(batch.triangles.begin(), batch.triangles.end(),
                        [&](std::uint32_t index) { return index < record.positions; });
  batch.shared.clear();
  std::int64_t last = -1;
  for (std::uint32_t i = 0; i < record.shared; ++i) {
    SharedRecord shared;
    arrays.read(&shared, 1);
    is_sane = is_sane && shared.vertex < record.positions && shared.vertex > last &&
              shared.batches <= 0xFF && shared.key != kNoEdge;
    last = shared.vertex;
    batch.shared.push_back({shared.vertex, static_cast<std::uint8_t>(shared.batches), shared.key});
  }
  if (is_sane && has_remains) is_sane = decodeRemains(arrays, merged.placed);
  if (!is_sane) failDamaged(merged.path, merged.offset);
}

// The shares of one surface, in their order.
class ShareList {
 public:
  explicit ShareList(const std::vector<std::string>& paths) {
    if (paths.empty()) throw Error("there are no shares to merge; name their files");
    std::string identity;
    for (const std::string& path : paths) {
      const ShareFile file(path);
      if (shares_.empty()) {
        identity = file.identity();
        frame_ = file.frame();
      } else {
        refuseOther(file, identity);
      }
      shares_.push_back({path, file.header()});
      batches_ += file.header().batches;
      triangles_ += file.header().triangles;
      bytes_ += file.header().file_bytes;
    }
    std::sort(shares_.begin(), shares_.end(),
              [](const Share& a, const Share& b) { return a.header.number < b.header.number; });
    refuseTwins();
    refuseGaps();
  }

  struct Share {
    std::string path;
    ShareHeader header;
  };
  const std::vector<Share>& shares() const { return shares_; }
  const MeshFrame& frame() const { return frame_; }
  std::uint64_t batches() const { return batches_; }
  std::uint64_t triangles() const { return triangles_; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  void refuseOther(const ShareFile& file, const std::string& identity) const {
    const Share& first = shares_.front();
    const std::string own = file.identity();
    if (own != identity)
      failShare(file.path(), "is of another surface than '" + first.path + "': " +
                                 firstDifference(own, identity) + "; merge shares of one surface");
    const ShareHeader& header = file.header();
    if (header.of != first.header.of || header.all_bricks != first.header.all_bricks ||
        header.brick_cells != first.header.brick_cells)
      failShare(file.path(), "is one of " + std::to_string(header.of) + " shares, and '" +
                                 first.path + "' one of " + std::to_string(first.header.of) +
                                 "; merge shares of one division");
  }
  void refuseTwins() const {
    const auto twin = std::adjacent_find(
        shares_.begin(), shares_.end(),
        [](const Share& a, const Share& b) { return a.header.number == b.header.number; });
    if (twin != shares_.end())
      failShare(twin[1].path, "is the same share, " + nameOf(twin->header.number) + ", as '" +
                                  twin->path + "'; leave one out");
  }
  void refuseGaps() const {
    std::vector<std::uint32_t> missing;
    std::uint32_t next = 1;
    for (const Share& share : shares_) {
      for (; next < share.header.number; ++next) missing.push_back(next);
      ++next;
    }
    for (; next <= shares_.front().header.of; ++next) missing.push_back(next);
    if (!missing.empty()) {
      constexpr std::size_t kMostNamed = 10;
      std::string names;
      for (std::size_t i = 0; i < std::min(missing.size(), kMostNamed); ++i)
        names += (i == 0 ? "" : ", ") + nameOf(missing[i]);
      if (missing.size() > kMostNamed)
        names += " and " + std::to_string(missing.size() - kMostNamed) + " more";
      throw Error("the surface is not whole without " + names +
                  "; extract them as the others were, or name their files");
    }
    std::uint64_t brick = 0;
    for (const Share& share : shares_) {
      if (share.header.first_brick != brick)
        failShare(share.path, "does not begin where the share before it ends; extract it again");
      brick += share.header.brick_count;
    }
    if (brick != shares_.back().header.all_bricks)
      failShare(shares_.back().path, "does not end with the surface; extract it again");
  }
  std::string nameOf(std::uint32_t number) const {
    return std::to_string(number) + "/" + std::to_string(shares_.front().header.of);
  }

  std::vector<Share> shares_;
  MeshFrame frame_;
  std::uint64_t batches_ = 0, triangles_ = 0, bytes_ = 0;
};

// The records of all shares, one after the other; one file is open at a time.
class RecordReader {
 public:
  explicit RecordReader(const ShareList& list) : list_(list) {}

  // False after the last one.
  bool read(MergedBatch& merged) {
    while (file_ == nullptr || at_ == file_->batchesEnd())
      if (!openNext()) return false;
    BatchRecord record;
    const std::uint64_t left = file_->batchesEnd() - at_;
    if (left < sizeof record) failDamaged(file_->path(), at_);
    file_->read(at_, &record, sizeof record);
    if (record.bytes > std::min(left, kMostRecordBytes) ||
        record.bytes != share_format::recordBytes(record.positions, record.indices, record.shared,
                                                  file_->header().brick_cells > 0))
      failDamaged(file_->path(), at_);
    merged.bytes.resize(record.bytes);
    file_->read(at_, merged.bytes.data(), record.bytes);
    // The checksum is of what was read now.
    BatchRecord again;
    std::memcpy(&again, merged.bytes.data(), sizeof again);
    if (again.bytes != record.bytes || again.positions != record.positions ||
        again.indices != record.indices || again.shared != record.shared)
      failDamaged(file_->path(), at_);
    merged.path = file_->path();
    merged.offset = at_;
    at_ += record.bytes;
    ++batches_read_;
    ++all_read_;
    triangles_read_ += record.indices / 3;
    merged.placed.batch.fraction_done =
        static_cast<double>(all_read_) / static_cast<double>(list_.batches());
    return true;
  }

 private:
  bool openNext() {
    if (file_ != nullptr &&
        (batches_read_ != file_->header().batches || triangles_read_ != file_->header().triangles))
      failDamaged(file_->path(), at_);
    if (next_ == list_.shares().size()) return false;
    const ShareList::Share& share = list_.shares()[next_++];
    file_ = std::make_unique<ShareFile>(share.path);
    // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison): as files, it has no padding
    if (std::memcmp(&file_->header(), &share.header, sizeof share.header) != 0)
      failShare(share.path, "changed while it was merged; merge again");
    at_ = sizeof(ShareHeader);
    batches_read_ = triangles_read_ = 0;
    return true;
  }

  const ShareList& list_;
  std::unique_ptr<ShareFile> file_;
  std::size_t next_ = 0;
  std::uint64_t at_ = 0;
  std::uint64_t batches_read_ = 0, triangles_read_ = 0;  // of this file
  std::uint64_t all_read_ = 0;
};

std::size_t batchesAtOnce() {
  return static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()) + 2;
}

// Batches that no thread has at the moment.
class IdleBatches {
 public:
  explicit IdleBatches(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      all_.push_back(std::make_unique<MergedBatch>());
      idle_.push_back(all_.back().get());
    }
  }
  MergedBatch* take() {
    const std::lock_guard lock(mutex_);
    MergedBatch* const batch = idle_.back();
    idle_.pop_back();
    return batch;
  }
  void giveBack(MergedBatch* batch) {
    const std::lock_guard lock(mutex_);
    idle_.push_back(batch);
  }

 private:
  std::vector<std::unique_ptr<MergedBatch>> all_;
  std::mutex mutex_;  // guards idle_
  std::vector<MergedBatch*> idle_;
};

// Passes what read() gives through the other calls, place() in its order, until that is null.
template <typename Token>
void runPipeline(const auto& read, const auto& prepare, const auto& place, const auto& write) {
  using enum tbb::filter_mode;
  const auto readNext = [&](tbb::flow_control& control) -> Token {
    Token token = read();
    if (token == nullptr) control.stop();
    return token;
  };
  const auto passOn = [](const auto& call) {
    return [&call](Token token) {
      call(*token);
      return token;
    };
  };
  // As the loops of storage/isolated_loop.h.
  tbb::task_group_context isolated(tbb::task_group_context::isolated);
  tbb::parallel_pipeline(batchesAtOnce(),
                         tbb::make_filter<void, Token>(serial_in_order, readNext) &
                             tbb::make_filter<Token, Token>(parallel, passOn(prepare)) &
                             tbb::make_filter<Token, Token>(serial_in_order, passOn(place)) &
                             tbb::make_filter<Token, void>(parallel, write),
                         isolated);
}

// Passes on the batches as they are.
void mergeBatches(const ShareList& list, TriangleSink& sink, const CancelFlag* cancel) {
  RecordReader reader(list);
  IdleBatches idle(batchesAtOnce());
  const auto read = [&]() -> MergedBatch* {
    if (cancel != nullptr) cancel->check();
    MergedBatch* const merged = idle.take();
    return reader.read(*merged) ? merged : nullptr;
  };
  const auto prepare = [&](MergedBatch& merged) {
    decode(merged, list.frame().voxels, false);
    sink.prepare(merged.placed);
  };
  const auto place = [&](MergedBatch& merged) {
    if (!merged.placed.batch.triangles.empty()) sink.place(merged.placed);
  };
  const auto write = [&](MergedBatch* merged) {
    if (!merged->placed.batch.triangles.empty()) sink.write(merged->placed);
    idle.giveBack(merged);
  };
  runPipeline<MergedBatch*>(read, prepare, place, write);
}

// Puts them into groups and simplifies these. Returns the triangles that are left.
std::uint64_t mergeGroups(const ShareList& list, TriangleSink& sink, const CancelFlag* cancel) {
  using Group = std::shared_ptr<BatchGroup>;
  const ShareHeader& header = list.shares().front().header;
  const SimplifySpace space = SimplifySpace::of(
      {.distance = header.simplify_distance, .in_world = header.simplify_in_world == 1},
      list.frame().geometry, list.frame().voxels);
  RecordReader reader(list);
  MergedBatch merged;
  GroupSorter sorter(header.brick_cells);
  std::deque<Group> whole;
  bool has_ended = false;
  std::uint64_t triangles = 0;
  tbb::enumerable_thread_specific<BatchSimplifier> simplifiers;
  const auto read = [&]() -> Group {
    while (whole.empty() && !has_ended) {
      if (cancel != nullptr) cancel->check();
      has_ended = !reader.read(merged);
      if (!has_ended) decode(merged, list.frame().voxels, true);
      for (auto& group : has_ended ? sorter.takeRest() : sorter.add(merged.placed))
        whole.push_back(std::move(group));
    }
    if (whole.empty()) return nullptr;
    Group group = std::move(whole.front());
    whole.pop_front();
    return group;
  };
  const auto simplify = [&](BatchGroup& group) {
    simplifiers.local().simplifyGroup(space, cancel, group);
    sink.prepare(group.placed);
  };
  const auto place = [&](BatchGroup& group) {
    triangles += group.placed.batch.triangles.size() / 3;
    if (!group.placed.batch.triangles.empty()) sink.place(group.placed);
  };
  const auto write = [&](const Group& group) {
    if (!group->placed.batch.triangles.empty()) sink.write(group->placed);
  };
  runPipeline<Group>(read, simplify, place, write);
  return triangles;
}

}  // namespace

MergeReport mergeMeshShares(const std::vector<std::string>& paths, TriangleSink& sink,
                            const CancelFlag* cancel) {
  const ShareList list(paths);
  sink.begin(list.frame());
  std::uint64_t triangles = list.triangles();
  if (list.shares().front().header.brick_cells > 0)
    triangles = mergeGroups(list, sink, cancel);
  else
    mergeBatches(list, sink, cancel);
  if (cancel != nullptr) cancel->check();
  sink.finish();
  return {static_cast<std::uint32_t>(list.shares().size()), triangles, list.bytes()};
}

}  // namespace isobrick
