#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/zarr_array.h"
#include "isobrick/preprocess/sources/zarr_remote.h"
#include "isobrick/preprocess/sources/zarr_store.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

using Indices = ZarrArray::Indices;

// Unpacked chunks. Thread-safe.
class ChunkCache {
 public:
  using Value = std::shared_ptr<const std::vector<std::byte>>;

  // Kept values take up to `budget_bytes`, or are one value.
  explicit ChunkCache(std::uint64_t budget_bytes) : budget_bytes_(budget_bytes) {}

  // Null: it is not there.
  Value find(const Indices& key) {
    const std::lock_guard lock(mutex_);
    const auto found = places_.find(key);
    if (found == places_.end()) return nullptr;
    values_.splice(values_.end(), values_, found->second);
    return found->second->second;
  }
  // If two threads made the same value, that of the first is kept.
  void add(const Indices& key, Value value) {
    const std::lock_guard lock(mutex_);
    if (places_.contains(key)) return;
    held_bytes_ += value->size();
    values_.emplace_back(key, std::move(value));
    places_[key] = std::prev(values_.end());
    while (held_bytes_ > budget_bytes_ && values_.size() > 1) {
      held_bytes_ -= values_.front().second->size();
      places_.erase(values_.front().first);
      values_.pop_front();
    }
  }

 private:
  using Values = std::list<std::pair<Indices, Value>>;

  const std::uint64_t budget_bytes_;
  std::mutex mutex_;  // guards all below
  Values values_;     // the one used last at the end
  std::map<Indices, Values::iterator> places_;
  std::uint64_t held_bytes_ = 0;
};

namespace fs = std::filesystem;
using Json = nlohmann::json;

template <typename... Parts>
Error cannotUse(const std::string& path, const Parts&... reason) {
  return unusable(path, reason..., "; correct its metadata");
}

// A list of transformations as a map of an index along each axis: scale * index + translation.
struct Placement {
  std::vector<double> scale, translation;
  bool has_translation = false;
};

Placement placementOf(const std::string& path, const Json& transformations, std::size_t axes) {
  Placement result{std::vector<double>(axes, 1), std::vector<double>(axes, 0)};
  if (transformations.is_null()) return result;
  if (!transformations.is_array())
    throw cannotUse(path, "its coordinateTransformations are no list");
  for (const Json& step : transformations) {
    const std::string type = textOf(member(step, "type"));
    if (type == "identity") continue;
    const Json& numbers = member(step, type.c_str());
    if ((type != "scale" && type != "translation") || !numbers.is_array() || numbers.size() != axes)
      throw cannotUse(path, "its coordinate transformation ", quotedText(type, 40),
                      " is no scale or translation of all axes");
    for (std::size_t i = 0; i < axes; ++i) {
      if (!numbers[i].is_number()) throw cannotUse(path, "its ", type, " has what is no number");
      const double number = numbers[i].get<double>();
      if (type == "scale") {
        result.scale[i] *= number;
        result.translation[i] *= number;
      } else {
        result.translation[i] += number;
        result.has_translation = true;
      }
    }
  }
  return result;
}

// The chunks that were read, each counted once, and how many of them the store lacks. Chunks are
// not counted if there are more than any volume has that was not made for it.
class ChunkTally {
 public:
  explicit ChunkTally(const Index3& chunks)
      : chunks_(chunks),
        was_read_(elementCount(chunks) <= kMost ? static_cast<std::size_t>(elementCount(chunks))
                                                : 0) {}

  void note(const Index3& at, bool is_missing) {
    const std::lock_guard lock(mutex_);
    if (!was_read_.empty()) {
      auto was_read = was_read_[static_cast<std::size_t>(linearIndex(at, chunks_))];
      if (was_read) return;
      was_read = true;
    }
    ++read_;
    missing_ += is_missing ? 1 : 0;
  }

  std::vector<std::string> notes(double fill) const {
    const std::lock_guard lock(mutex_);
    if (missing_ == 0) return {};
    const std::string which = was_read_.empty() ? std::string("chunks")
                                                : std::to_string(missing_) + " of the " +
                                                      std::to_string(read_) + " chunks";
    return {which + " that were read are not in the store: they have its fill value, " +
            shortText(fill)};
  }
  std::uint64_t bytes() const { return was_read_.size() / 8; }

 private:
  static constexpr std::int64_t kMost = std::int64_t{1} << 27;

  const Index3 chunks_;
  mutable std::mutex mutex_;    // guards all below
  std::vector<bool> was_read_;  // empty: too many
  std::uint64_t read_ = 0, missing_ = 0;
};

class ZarrSource final : public VolumeSource {
 public:
  // `axes`: which axis of the array x, y and z are. `fixed`: an index for all others, -1 for these.
  ZarrSource(VolumeInfo info, ZarrArray array, std::array<std::size_t, 3> axes, Indices fixed,
             std::vector<std::string> group_files, std::string identity, const OpenOptions& options)
      : info_(std::move(info)),
        array_(std::move(array)),
        axes_(axes),
        fixed_(std::move(fixed)),
        group_files_(std::move(group_files)),
        identity_(std::move(identity)),
        cancel_(options.cancel),
        // A few chunks are being unpacked. Whoever reads slices needs those of two layers.
        cache_bytes_(std::min(
            std::max(options.memory_bytes, 8 * array_.chunkBytes()) - 4 * array_.chunkBytes(),
            3 * layerBytes())),
        cache_(cache_bytes_),
        tally_((info_.voxels - Index3(1)) / chunkVoxels() + Index3(1)) {}

  const VolumeInfo& info() const override { return info_; }
  bool readsBoxes() const override { return true; }
  std::uint64_t bufferBytes() const override {
    return cache_bytes_ + 4 * array_.chunkBytes() + tally_.bytes();
  }
  std::vector<std::string> notesOfReading() const override { return tally_.notes(array_.fill()); }

  std::string identity() const override { return identity_; }
  std::vector<std::string> files() const override {
    if (!identity_.empty()) return {};
    std::vector<std::string> files = group_files_;
    for (std::string& file : array_.files(fixed_)) files.push_back(std::move(file));
    return files;
  }

  void readBox(const IndexBox& box, void* out) const override {
    const Index3 size = chunkVoxels();
    const IndexBox chunks = chunksOf(box);
    std::int64_t number = 0, asked = 0;
    forEachIndex(chunks, [&](const Index3& at) {
      if (cancel_ != nullptr) cancel_->check();
      if (array_.isRemote() && number >= asked && isAbsent(indicesOf(at))) {
        askAhead(chunks, number);
        asked = number + kStepAhead;
      }
      ++number;
      const ChunkCache::Value chunk = chunkAt(at);
      visitNumberType(info_.voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        copyChunk(reinterpret_cast<const T*>(chunk->data()), at * size, size, box,
                  static_cast<T*>(out));
      });
    });
  }

  // What has no room now is asked for by the next readBox(), behind its own.
  void announce(std::span<const IndexBox> boxes) const override {
    if (!array_.isRemote()) return;
    {
      const std::lock_guard lock(mutex_);
      announced_.clear();
      in_order_.clear();
      for (const IndexBox& box : boxes)
        if (box.size() > 0)
          forEachIndex(firstOf(chunksOf(box), kMostAnnounced - std::ssize(in_order_)),
                       [&](const Index3& at) {
                         Indices index = indicesOf(at);
                         if (announced_.insert(index).second) in_order_.push_back(std::move(index));
                       });
    }
    askAhead({}, 0);
  }

 private:
  using Clock = std::chrono::steady_clock;

  Index3 chunkVoxels() const {
    Index3 size;
    for (int axis = 0; axis < 3; ++axis) size[axis] = array_.chunk()[axes_[axis]];
    return size;
  }

  IndexBox chunksOf(const IndexBox& box) const {
    const Index3 size = chunkVoxels();
    const Index3 begin = box.first / size, end = (box.end() - Index3(1)) / size + Index3(1);
    return {begin, end - begin};
  }
  // About the first `most` chunks, in order, and no more than those.
  static IndexBox firstOf(IndexBox chunks, std::int64_t most) {
    for (const int axis : {2, 1, 0})
      if (chunks.size() > most)
        chunks.count[axis] =
            std::max<std::int64_t>(axis > 0 ? 1 : 0, most / (chunks.size() / chunks.count[axis]));
    return chunks;
  }
  // Neither here nor on its way.
  bool isAbsent(const Indices& index) const {
    const std::lock_guard lock(mutex_);
    return !being_read_.contains(index) && cache_.find(index) == nullptr;
  }

  std::uint64_t layerBytes() const {
    const Index3 chunks = (info_.voxels - Index3(1)) / chunkVoxels() + Index3(1);
    return static_cast<std::uint64_t>(chunks.x * chunks.y) * array_.chunkBytes();
  }

  // Of an array behind a URL: chunks are asked for ahead of the one that is read, as many as the
  // client keeps (RemoteStore, HttpRanges::kMostAheadBytes) even if they are packed to nothing
  // less, and again after every step of them.
  static constexpr std::int64_t kMostAhead = 256, kStepAhead = 16;
  // What is announced beyond is asked for when it is read: chunks may be as small as a voxel.
  static constexpr std::int64_t kMostAnnounced = 64 * kMostAhead;
  static constexpr std::uint64_t kAheadBytes = std::uint64_t{60} << 20;

  // Asks for chunks that are not here: those of the box from `number` on, then those that were
  // announced.
  void askAhead(const IndexBox& chunks, std::int64_t number) const {
    const std::size_t most = std::clamp<std::size_t>(
        kAheadBytes / mostPackedBytes(array_.chunkBytes()), kStepAhead, kMostAhead);
    std::vector<Indices> next;
    {
      const std::lock_guard lock(mutex_);
      const auto now = Clock::now();
      // The store has forgotten what nobody read.
      if (ahead_.size() >= most)
        std::erase_if(ahead_,
                      [&](const auto& one) { return now - one.second > RemoteStore::kForgotten; });
      const auto take = [&](Indices index) {
        if (being_read_.contains(index) || cache_.find(index) != nullptr) return;
        if (ahead_.try_emplace(index, now).second) next.push_back(std::move(index));
      };
      for (; ahead_.size() < most && number < chunks.size(); ++number)
        take(indicesOf(chunks.first + indexAt(number, chunks.count)));
      for (; ahead_.size() < most && !in_order_.empty(); in_order_.pop_front())
        if (announced_.erase(in_order_.front()) > 0) take(std::move(in_order_.front()));
    }
    array_.announce(next);
  }

  Indices indicesOf(const Index3& at) const {
    Indices index = fixed_;
    for (std::size_t i = 0; i < index.size(); ++i)
      if (index[i] >= 0) index[i] /= array_.chunk()[i];
    for (int axis = 0; axis < 3; ++axis) index[axes_[axis]] = at[axis];
    return index;
  }

  // While it lives, other threads that want the chunk wait.
  struct Reading {
    const ZarrSource& source;
    const Indices& index;
    ~Reading() {
      {
        const std::lock_guard lock(source.mutex_);
        source.being_read_.erase(index);
      }
      source.changed_.notify_all();
    }
  };

  ChunkCache::Value chunkAt(const Index3& at) const {
    const Indices index = indicesOf(at);
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return !being_read_.contains(index); });
      if (ChunkCache::Value chunk = cache_.find(index)) return chunk;
      being_read_.insert(index);
      ahead_.erase(index);
      announced_.erase(index);
    }
    const Reading reading{*this, index};
    auto voxels = std::make_shared<std::vector<std::byte>>();
    const bool is_stored = array_.readChunk(index, *voxels);
    tally_.note(at, !is_stored);
    cache_.add(index, voxels);
    return voxels;
  }

  template <typename T>
  void copyChunk(const T* chunk, const Index3& chunk_first, const Index3& size, const IndexBox& box,
                 T* out) const {
    // The place of the other axes, within the chunk.
    for (std::size_t i = 0; i < fixed_.size(); ++i)
      if (fixed_[i] >= 0) chunk += fixed_[i] % array_.chunk()[i] * array_.strides()[i];
    Index3 stride;
    for (int axis = 0; axis < 3; ++axis) stride[axis] = array_.strides()[axes_[axis]];
    const Index3 first = glm::max(chunk_first, box.first);
    const Index3 end = glm::min(chunk_first + size, box.end());
    for (std::int64_t z = first.z; z < end.z; ++z)
      for (std::int64_t y = first.y; y < end.y; ++y) {
        const Index3 in_chunk = Index3(first.x, y, z) - chunk_first;
        const T* from =
            chunk + in_chunk.x * stride.x + in_chunk.y * stride.y + in_chunk.z * stride.z;
        T* to = out + linearIndex(Index3(first.x, y, z) - box.first, box.count);
        if (stride.x == 1) {
          std::copy_n(from, end.x - first.x, to);
          continue;
        }
        for (std::int64_t x = first.x; x < end.x; ++x, from += stride.x) *to++ = *from;
      }
  }

  VolumeInfo info_;
  ZarrArray array_;
  std::array<std::size_t, 3> axes_;
  Indices fixed_;
  std::vector<std::string> group_files_;
  std::string identity_;  // of an array behind a URL; else empty
  const CancelFlag* cancel_;
  std::uint64_t cache_bytes_;
  mutable ChunkCache cache_;
  mutable ChunkTally tally_;
  mutable std::mutex mutex_;  // guards the four below
  mutable std::set<Indices> being_read_;
  mutable std::map<Indices, Clock::time_point>
      ahead_;                             // asked for and not read yet, and since when
  mutable std::set<Indices> announced_;   // not asked for, and not read since
  mutable std::deque<Indices> in_order_;  // those, and some that were read
  mutable std::condition_variable changed_;
};

// Opening, step by step.
class ZarrOpener {
 public:
  ZarrOpener(const std::string& path, const OpenOptions& options) : path_(path), options_(options) {
    if (isRemotePath(path_)) remote_ = RemoteStore::enter(path_, options.cancel);
    while (path_.size() > 1 && path_.back() == '/') path_.pop_back();
    std::string inside;
    zip_ = zipThrough(path_, inside);
  }

  std::unique_ptr<VolumeSource> open() {
    VolumeInfo info;
    info.source = path_;
    if (remote_ != nullptr && zip_ == nullptr && !hasRemoteMetadata())
      throw unreadable(path_,
                       "the server has no metadata of a Zarr store there (zarr.json, .zarray or "
                       ".zattrs); check the address");
    chooseVolume();
    findArray();
    ZarrArray array(array_path_);
    nameAxes(array);
    info.notes = std::move(notes_);
    info.format = multiscale_.is_null() ? "Zarr" : "OME-Zarr";
    if (options_.image) info.encoding = concat("image ", *options_.image);
    const std::array<std::size_t, 3> axes = spaceAxes();
    for (int axis = 0; axis < 3; ++axis) info.voxels[axis] = array.shape()[axes[axis]];
    checkVoxelCounts(path_, info.voxels);
    const Indices fixed = fixOthers(array, axes, info);
    info.named_channels = std::move(channels_);
    place(info, axes);
    info.voxel_type = array.stored().delivered();
    tidyGeometry(path_, info.geometry, info.voxels, info.notes);
    std::string identity = remote_ == nullptr ? ""
                           : zip_ != nullptr  ? path_ + ", " + zip_->identity()
                                              : remote_->identityOf(path_);
    return std::make_unique<ZarrSource>(std::move(info), std::move(array), axes, fixed,
                                        group_files_, std::move(identity), options_);
  }

 private:
  bool hasRemoteMetadata() const {
    constexpr std::array kNames = {"/zarr.json", "/.zarray", "/.zattrs", "/.zmetadata"};
    return std::ranges::any_of(kNames,
                               [&](const char* name) { return storeFileIsThere(path_ + name); });
  }

  // Of a group that is no image itself.
  void chooseVolume() {
    const std::string chosen = chooseZarrVolume(path_, options_.image);
    is_chosen_ = chosen != path_;
    path_ = chosen;
  }

  // The array, and the image that it is a level of.
  void findArray() {
    const Json attributes = zarrAttributes(path_);
    array_path_ = path_;
    if (chooseImage(multiscalesOf(attributes))) {
      takeGroup(path_, attributes);
      const Json& datasets = member(multiscale_, "datasets");
      if (!datasets.is_array() || datasets.empty())
        throw cannotUse(path_, "its image has no datasets");
      const std::size_t level = std::min(options_.store_level, datasets.size() - 1);
      dataset_ = datasets[level];
      is_coarser_ = level > 0;
      const std::string name = textOf(member(dataset_, "path"));
      if (!leadsDown(name))
        throw cannotUse(path_, "the name of its level, ", quotedText(name, 60),
                        ", leads out of the store");
      array_path_ = path_ + "/" + name;
      return;
    }
    if (options_.image && !is_chosen_)
      throw cannotUse(path_, "it is one array, and has no images to choose from");
    // An array that the folder above lists as a level of its image.
    const fs::path parent = fs::path(path_).parent_path();
    const std::string name = fs::path(path_).filename().string();
    if (parent.empty() || (remote_ == nullptr && !isZarrFolder(parent.string()))) return;
    const Json above = zarrAttributes(parent.string());
    for (const Json& multiscale : multiscalesOf(above)) {
      const Json& datasets = member(multiscale, "datasets");
      for (std::size_t i = 0; datasets.is_array() && i < datasets.size(); ++i)
        if (textOf(member(datasets[i], "path")) == name) {
          takeGroup(parent.string(), above);
          multiscale_ = multiscale;
          dataset_ = datasets[i];
          is_coarser_ = i > 0;
          return;
        }
    }
  }

  // Of the images that a group shows in one folder; false if there are none.
  bool chooseImage(const Json& images) {
    if (images.is_null()) return false;
    const std::int64_t number = is_chosen_ ? 0 : options_.image.value_or(0);
    if (static_cast<std::uint64_t>(number) >= images.size())
      throw cannotUse(path_, "it has ", images.size(), " images, and no image ", number,
                      " (counted from 0)");
    multiscale_ = images[static_cast<std::size_t>(number)];
    if (images.size() > 1 && !options_.image)
      notes_.push_back(concat("of ", images.size(), " images, the first was taken"));
    return true;
  }

  void takeGroup(const std::string& folder, const Json& attributes) {
    for (const char* name : {"/zarr.json", "/.zattrs"})
      if (zip_ == nullptr && storeFileIsThere(folder + name)) group_files_.push_back(folder + name);
    own_ = member(attributes, "isobrick");
    channels_ = namedChannelsOf(attributes);
  }

  // Axes by name, in the order of the array: those of the image, or of the array itself. Before
  // OME-Zarr 0.3 they were always t, c, z, y, x.
  void nameAxes(const ZarrArray& array) {
    const std::size_t count = array.shape().size();
    if (const Json& axes = member(multiscale_, "axes"); axes.is_array())
      for (const Json& axis : axes) {
        names_.push_back(axis.is_string() ? textOf(axis) : textOf(member(axis, "name")));
        units_.push_back(axis.is_object() ? textOf(member(axis, "unit")) : std::string());
        is_space_.push_back(textOf(member(axis, "type")) == "space");
      }
    else
      names_ = array.axisNames();
    if (names_.empty()) {
      const Json attributes = zarrAttributes(array_path_);
      for (const Json& name : member(attributes, "_ARRAY_DIMENSIONS"))
        names_.push_back(textOf(name));
    }
    const bool has_all =
        std::ranges::all_of(names_, [](const std::string& name) { return !name.empty(); });
    if (names_.empty() || !has_all) {
      static constexpr std::array kUsual = {"t", "c", "z", "y", "x"};
      names_.assign(kUsual.end() - static_cast<std::ptrdiff_t>(count), kUsual.end());
    }
    if (names_.size() != count)
      throw cannotUse(array_path_, "it has ", count, " axes and ", names_.size(),
                      " names for them");
    for (std::string& name : names_) {
      name = lowercase(name);
      if (name == "time") name = "t";
      if (name == "channel") name = "c";
    }
    units_.resize(count);
    is_space_.resize(count, false);
  }

  // Which axes x, y and z are: by name, or, of three others, by their order, z first.
  std::array<std::size_t, 3> spaceAxes() const {
    const auto isNamed = [&](const char* name) { return std::ranges::count(names_, name) == 1; };
    const auto axisNamed = [&](const char* name) {
      return static_cast<std::size_t>(std::ranges::find(names_, name) - names_.begin());
    };
    if (isNamed("x") && isNamed("y") && isNamed("z"))
      return {axisNamed("x"), axisNamed("y"), axisNamed("z")};
    const bool has_types = std::ranges::find(is_space_, true) != is_space_.end();
    std::vector<std::size_t> found;
    ListText list;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (has_types ? is_space_[i] : names_[i] != "t" && names_[i] != "c") found.push_back(i);
      list.add(quotedText(names_[i], 40));
    }
    if (found.size() != 3)
      throw cannotUse(array_path_,
                      "isobrick needs three axes of space, x, y and z, and it has the axes ",
                      list.text());
    return {found[2], found[1], found[0]};
  }

  // An index along every axis that is not of space.
  Indices fixOthers(const ZarrArray& array, const std::array<std::size_t, 3>& axes,
                    VolumeInfo& info) const {
    Indices fixed(names_.size(), 0);
    bool has_time = false, has_channel = false;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (std::ranges::find(axes, i) != axes.end()) {
        fixed[i] = -1;
        continue;
      }
      const bool is_time = names_[i] == "t";
      const std::int64_t count = array.shape()[i];
      if (std::exchange(is_time ? has_time : has_channel, true)) {
        if (count > 1)
          throw cannotUse(array_path_, "its axis ", quotedText(names_[i], 40), " has ", count,
                          " indices besides those of another axis, of which none can be chosen");
        continue;
      }
      const auto& wanted = is_time ? options_.time : options_.channel;
      const std::string kind = is_time ? "time step" : "channel";
      fixed[i] = wanted.value_or(0);
      if (fixed[i] < 0 || fixed[i] >= count)
        throw fileError(path_, "'", path_, "' has the ", kind, "s 0 to ", count - 1, ", and not ",
                        fixed[i], "; choose one of these");
      if (count > 1) (is_time ? info.time_step : info.channel) = OneOfSeveral{fixed[i], count};
      if (wanted || count > 1)
        info.encoding +=
            (info.encoding.empty() ? "" : "; ") + kind + " " + std::to_string(fixed[i]);
      if (!wanted && count > 1)
        info.notes.push_back(concat("of ", count, " ", kind, "s, the first was taken"));
    }
    // An axis that is not there has the index 0, as in other formats.
    refuseChoice(options_.time.value_or(0) != 0 && !has_time, "time step");
    refuseChoice(options_.channel.value_or(0) != 0 && !has_channel, "channel");
    return fixed;
  }

  void refuseChoice(bool is_idle, const std::string& kind) const {
    if (is_idle)
      throw unusable(path_, "it has no axis of ", kind, "s; leave out the choice of one");
  }

  void place(VolumeInfo& info, const std::array<std::size_t, 3>& axes) const {
    if (multiscale_.is_null()) {
      info.notes.push_back("a plain array has no spacing; 1 was used");
      return;
    }
    const Placement level =
        placementOf(path_, member(dataset_, "coordinateTransformations"), names_.size());
    const Placement all =
        placementOf(path_, member(multiscale_, "coordinateTransformations"), names_.size());
    std::array<std::string, 3> units;
    for (int axis = 0; axis < 3; ++axis) {
      const std::size_t i = axes[axis];
      info.geometry.spacing[axis] = level.scale[i] * all.scale[i];
      info.geometry.origin[axis] = level.translation[i] * all.scale[i] + all.translation[i];
      units[static_cast<std::size_t>(axis)] = units_[i];
    }
    takeLengthUnits(units, info);
    if (is_coarser_ && !level.has_translation && !all.has_translation && own_.is_null())
      info.notes.push_back(
          "the level says no translation; if its voxels are means of finer ones, " +
          std::string("they lie half a voxel of the finest further"));
    takeDirection(info);
  }

  // OME-Zarr 0.4 has no directions; isobrick keeps them beside.
  void takeDirection(VolumeInfo& info) const {
    const Json& columns = member(own_, "direction");
    if (!columns.is_array() || columns.size() != 3) return;
    glm::dmat3 direction(1.0);
    for (int axis = 0; axis < 3; ++axis) {
      const Json& column = columns[static_cast<std::size_t>(axis)];
      if (!column.is_array() || column.size() != 3) return;
      for (int row = 0; row < 3; ++row) {
        const Json& number = column[static_cast<std::size_t>(row)];
        if (!number.is_number()) return;
        direction[axis][row] = number.get<double>();
      }
    }
    info.geometry.direction = direction;
  }

  std::string path_;
  const OpenOptions& options_;
  std::shared_ptr<const ZipFile> zip_;   // null: the store is no zip file
  std::shared_ptr<RemoteStore> remote_;  // null: the store is of this machine
  std::string array_path_;
  Json multiscale_, dataset_, own_;
  bool is_chosen_ = false, is_coarser_ = false;
  std::vector<std::string> group_files_, names_, units_, notes_;
  std::vector<bool> is_space_;
  std::vector<VolumeChannel> channels_;
};

}  // namespace

bool isZarrFolder(const std::string& path) {
  if (isRemotePath(path)) return isRemoteVolume(path);
  for (const char* name : {"/zarr.json", "/.zarray", "/.zgroup", "/.zattrs"})
    if (isRegularFile(path + name) || isLink(path + name))
      return true;  // a link to nowhere too: opening it then fails
  return isZarrZip(path);
}

std::unique_ptr<VolumeSource> openZarrSource(const std::string& path, const OpenOptions& options) {
  return ZarrOpener(path, options).open();
}

}  // namespace isobrick
