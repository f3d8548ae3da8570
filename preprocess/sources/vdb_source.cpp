// OpenVDB grids (.vdb), as Houdini, Blender and ParaView write them: the box of a grid's active
// voxels as a dense volume.
#include <malloc.h>
#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/tools/Dense.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <glm/geometric.hpp>
#include <istream>
#include <new>
#include <optional>
#include <streambuf>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/openvdb_library.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/vdb_slabs.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

using openvdb::GridBase;

// Text of a file or of OpenVDB, fit for a line of a message.
std::string quoted(const std::string& text) { return quotedText(text, 100); }

template <typename... Parts>
Error cannotUse(const std::string& path, const Parts&... reason) {
  return unusable(path, reason..., "; write it again, or convert it to .nrrd or .mhd");
}

template <typename... Grids>
bool isOneOf(const GridBase& grid) {
  return (grid.isType<Grids>() || ...);
}

// Masks and bools: voxels of 0 and 1.
template <typename Grid>
constexpr bool kHasBits =
    std::is_same_v<Grid, openvdb::BoolGrid> || std::is_same_v<Grid, openvdb::MaskGrid>;
bool isMask(const GridBase& grid) { return isOneOf<openvdb::BoolGrid, openvdb::MaskGrid>(grid); }

bool isScalar(const GridBase& grid) {
  return isMask(grid) ||
         isOneOf<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid, openvdb::Int64Grid>(
             grid);
}

// Calls f(grid) with the grid as its own type, one of the scalar types.
template <typename F>
void visitScalar(const GridBase::Ptr& grid, F&& f) {
  const auto callIf = [&](auto typed) {
    if (typed) f(typed);
  };
  callIf(openvdb::gridPtrCast<openvdb::FloatGrid>(grid));
  callIf(openvdb::gridPtrCast<openvdb::DoubleGrid>(grid));
  callIf(openvdb::gridPtrCast<openvdb::Int32Grid>(grid));
  callIf(openvdb::gridPtrCast<openvdb::Int64Grid>(grid));
  callIf(openvdb::gridPtrCast<openvdb::BoolGrid>(grid));
  callIf(openvdb::gridPtrCast<openvdb::MaskGrid>(grid));
}

openvdb::Coord coordOf(const Index3& at) {
  return {static_cast<std::int32_t>(at.x), static_cast<std::int32_t>(at.y),
          static_cast<std::int32_t>(at.z)};
}

// The values of `box`, x fastest, as voxels of T.
template <typename T, typename Grid>
void copyBox(const Grid& grid, const IndexBox& box, T* out) {
  using Dense = openvdb::tools::Dense<T, openvdb::tools::LayoutXYZ>;
  Dense dense(openvdb::CoordBBox(coordOf(box.first), coordOf(box.end() - Index3(1))), out);
  constexpr bool kSerial = true;  // the callers are parallel
  openvdb::tools::copyToDense(grid.tree(), dense, kSerial);
}
template <typename Grid>
void copyVoxels(const Grid& grid, const IndexBox& box, void* out) {
  if constexpr (kHasBits<Grid>)
    copyBox(grid, box, static_cast<std::uint8_t*>(out));
  else
    copyBox(grid, box, static_cast<typename Grid::ValueType*>(out));
}

// A .vdb file, read front to back. OpenVDB's own io::File goes on with the bytes in memory if a
// file ends too early; here the stream throws instead, and every byte is read at once rather than
// at the first access, which would be long after the check of the file.
class VdbFile : private openvdb::io::Archive {
 public:
  VdbFile(const std::string& path, const OpenOptions& options)
      : path_(path),
        input_(path),
        bytes_(input_.size()),
        options_(options),
        watched_(input_, options_),
        in_(&watched_) {
    in_.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
  }

  // Which grid to take, by the name or the number in options.grid; otherwise the first float grid,
  // or else the first of other numbers.
  void chooseGrid(std::vector<std::string>& notes) {
    guarded([&] {
      initializeOpenVdb();
      readHeaders();
      chosen_ = &scalarGrid();
      if (entries_.size() > 1 && options_.grid.empty())
        notes.push_back(concat("of ", entries_.size(), " grids, ", quoted(nameOf(*chosen_)),
                               " was taken; the others are ", namesText(chosen_)));
    });
  }

  std::vector<std::string> gridNames() {
    std::vector<std::string> names;
    guarded([&] {
      initializeOpenVdb();
      readHeaders();
      for (const Entry& entry : entries_)
        if (isScalar(*entry.grid)) names.push_back(nameOf(entry));
    });
    return names;
  }

  // The grid with its voxels, or, if these take more than `memory_bytes`, its nodes alone. Then
  // slabsOf() reads the voxels.
  struct Loaded {
    GridBase::Ptr grid;
    bool has_voxels = true;
    std::uint64_t node_bytes = 0;  // without voxels
  };
  Loaded load(std::uint64_t memory_bytes) {
    Loaded loaded;
    guarded([&] {
      // Blosc packs no better than this.
      constexpr std::uint64_t kMostRatio = 40;
      // Bits lie within their leaves: leaving them out would save little.
      if (bytes_ > memory_bytes / kMostRatio && canSkipVoxels() && !isMask(*chosen_->grid)) {
        loaded.grid = emptyGrid();
        readNodes(loaded.grid);
        // Each leaf has its voxels, and 112 bytes around them.
        constexpr std::uint64_t kLeafBytes = 96 + 16;
        std::uint64_t leaves = 0, voxel_bytes = 0;
        visitScalar(loaded.grid, [&](const auto& grid) {
          using Leaf = typename std::decay_t<decltype(*grid)>::TreeType::LeafNodeType;
          leaves = grid->tree().leafCount();
          voxel_bytes = sizeof(typename Leaf::Buffer::ValueType) * Leaf::SIZE;
        });
        loaded.node_bytes = leaves * kLeafBytes;
        loaded.has_voxels = false;
        if (loaded.node_bytes + leaves * voxel_bytes > memory_bytes) return;
      }
      loaded = {};
      readVoxels(*chosen_);
      if (chosen_->descriptor.isInstance())
        chosen_->grid->setTree(loadedParent(*chosen_)->baseTreePtr());
      loaded.grid = chosen_->grid;
    });
    return loaded;
  }

  // Call it once, right after load() left the voxels out: finds those of each leaf. Goes through
  // all of them, and skips most.
  template <typename Tree>
  std::unique_ptr<VdbSlabs<Tree>> slabsOf(Tree& tree) {
    using Leaf = typename Tree::LeafNodeType;
    // A mask, how they are packed, and the values, which packing makes hardly larger.
    constexpr std::uint64_t kMostBytes =
        2 * sizeof(typename Leaf::Buffer::ValueType) * Leaf::SIZE + 1024;
    std::unique_ptr<VdbSlabs<Tree>> slabs;
    guarded([&] {
      std::vector<std::uint64_t> places;
      places.reserve(tree.leafCount() + 1);
      const auto here = [&] { return static_cast<std::uint64_t>(std::streamoff{in_.tellg()}); };
      places.push_back(here());
      for (auto leaf = tree.beginLeaf(); leaf; ++leaf) {
        leaf->readBuffers(in_, openvdb::CoordBBox(), stream_metadata_->halfFloat());
        const std::uint64_t end = here();
        if (end < places.back() || end - places.back() > kMostBytes)
          throw cannotUse(path_, "it is damaged at byte ", places.back());
        places.push_back(end);
      }
      slabs = std::make_unique<VdbSlabs<Tree>>(tree, std::move(places), *stream_metadata_, input_);
    });
    return slabs;
  }
  // The values of `box`, in coordinates of the grid.
  template <typename Tree>
  void readSlab(const VdbSlabs<Tree>& slabs, const IndexBox& box, typename Tree::ValueType* out) {
    guarded([&] { slabs.read(box, out, [&] { options_.checkCancel(); }); });
  }

  // The file is open: no caller waits for it any more.
  void stopReporting() { options_.progress = nullptr; }

 private:
  struct Entry {
    openvdb::io::GridDescriptor descriptor;
    GridBase::Ptr grid;
    bool is_loaded = false;
  };

  // Any failure in `work` becomes an Error that names the file.
  template <typename Work>
  void guarded(Work&& work) try {
    work();
  } catch (const Error&) {
    throw;
  } catch (const std::ios_base::failure&) {
    if (in_.bad())
      throw ResumableError("cannot read '" + path_ + "': the disk reports an error",
                           {.path = path_});
    throw cannotUse(path_, "it is cut short or damaged");
  } catch (const std::bad_alloc&) {
    throw cannotUse(path_, "its grid does not fit into memory, or the file is damaged");
  } catch (const std::exception& error) {  // openvdb::Exception is one
    throw cannotUse(path_, "OpenVDB reports ", quoted(error.what()));
  }

  void readHeaders() {
    readHeader(in_);
    if (fileVersion() > openvdb::OPENVDB_FILE_VERSION)
      throw cannotUse(path_, "its format ", fileVersion(), " is newer than the library's, ",
                      openvdb::OPENVDB_FILE_VERSION);
    stream_metadata_->setSeekable(inputHasGridOffsets());
    openvdb::io::setStreamMetadataPtr(in_, stream_metadata_, false);
    setFormatVersion(in_);
    setLibraryVersion(in_);
    setDataCompression(in_);
    openvdb::MetaMap().readMeta(in_);
    const std::int32_t count = readGridCount(in_);
    for (std::int32_t i = 0; i < count; ++i) readEntry();
  }

  void readEntry() {
    Entry entry;
    entry.grid = entry.descriptor.read(in_);
    if (inputHasGridOffsets()) {
      const std::int64_t end = entry.descriptor.getEndPos();
      // Never backwards: a damaged file would be read in circles.
      if (end < std::int64_t{in_.tellg()} || static_cast<std::uint64_t>(end) > bytes_)
        throw cannotUse(path_, "it is cut short or damaged: its grid ",
                        quoted(entry.descriptor.gridName()), " ends at byte ", end, " of ", bytes_);
      entry.descriptor.seekToEnd(in_);
    } else {  // it was written to a pipe: the only way to the next grid is through this one
      readGrid(entry.grid, entry.descriptor, in_);
      entry.is_loaded = true;
    }
    entries_.push_back(std::move(entry));
  }

  std::string namesText(const Entry* except) const {
    ListText names;
    for (const Entry& entry : entries_)
      if (&entry != except) names.add(quoted(nameOf(entry)), " (", entry.grid->valueType(), ")");
    return names.text();
  }

  // "density"; of several with one name, "density[1]" is the second.
  std::string nameOf(const Entry& entry) const {
    const std::string name = entry.descriptor.gridName();
    std::size_t same = 0, before = 0;
    for (const Entry& other : entries_) {
      if (other.descriptor.gridName() != name) continue;
      if (&other < &entry) ++before;
      ++same;
    }
    return same == 1 ? name : name + "[" + std::to_string(before) + "]";
  }

  Entry& scalarGrid() {
    if (entries_.empty()) throw cannotUse(path_, "it has no grids");
    if (const std::string& wanted = options_.grid; !wanted.empty()) {
      auto named = std::ranges::find_if(
          entries_, [&](const Entry& e) { return e.descriptor.gridName() == wanted; });
      if (named == entries_.end())
        named = std::ranges::find_if(entries_, [&](const Entry& e) { return nameOf(e) == wanted; });
      if (const auto number = numberIn<std::size_t>(wanted);
          named == entries_.end() && number && *number < entries_.size())
        named = entries_.begin() + static_cast<std::ptrdiff_t>(*number);
      if (named == entries_.end())
        throw fileError(path_, "'", path_, "' has no grid ", quoted(wanted), "; it has ",
                        namesText(nullptr));
      if (isScalar(*named->grid)) return *named;
      throw cannotUse(path_, "its grid ", quoted(wanted), " is of the type ",
                      quoted(named->grid->valueType()), ", which is no number");
    }
    const auto isFloat = [](const Entry& e) { return e.grid->isType<openvdb::FloatGrid>(); };
    auto chosen = std::ranges::find_if(entries_, isFloat);
    if (chosen == entries_.end())
      chosen = std::ranges::find_if(entries_, [](const Entry& e) { return isScalar(*e.grid); });
    if (chosen != entries_.end()) return *chosen;
    const Entry& first = entries_.front();
    throw cannotUse(
        path_, "it has no grid of numbers (float, double, int32, int64, bool, mask); its ",
        entries_.size() > 1 ? "first" : "only", " grid, ", quoted(first.descriptor.gridName()),
        ", is of the type ", quoted(first.grid->valueType()));
  }

  void readVoxels(Entry& entry) {
    if (entry.is_loaded) return;
    entry.descriptor.seekToGrid(in_);
    readGrid(entry.grid, entry.descriptor, in_);
    entry.is_loaded = true;
  }

  // Files of older versions, and grids that share another's tree, are read as wholes.
  bool canSkipVoxels() const {
    return inputHasGridOffsets() && fileVersion() >= openvdb::OPENVDB_FILE_VERSION_BOOST_UUID &&
           !chosen_->descriptor.isInstance();
  }

  GridBase::Ptr emptyGrid() const {
    GridBase::Ptr grid = GridBase::createGrid(chosen_->descriptor.gridType());
    grid->setSaveFloatAsHalf(chosen_->descriptor.saveFloatAsHalf());
    return grid;
  }

  // As OpenVDB reads a grid, up to the values of its leaves.
  void readNodes(const GridBase::Ptr& grid) {
    chosen_->descriptor.seekToGrid(in_);
    readGridCompression(in_);
    stream_metadata_->setHalfFloat(grid->saveFloatAsHalf());
    openvdb::io::setGridClass(in_, openvdb::GRID_UNKNOWN);
    openvdb::io::setGridBackgroundValuePtr(in_, nullptr);
    grid->readMeta(in_);
    openvdb::io::setGridClass(in_, grid->getGridClass());
    grid->readTransform(in_);
    grid->readTopology(in_);
  }

  // Grids that share one tree are written with the voxels of the first only.
  GridBase::Ptr loadedParent(const Entry& child) {
    for (Entry& entry : entries_) {
      const auto& descriptor = entry.descriptor;
      if (descriptor.isInstance() ||
          descriptor.uniqueName() != child.descriptor.instanceParentName())
        continue;
      readVoxels(entry);
      return entry.grid;
    }
    throw cannotUse(path_, "the grid whose voxels ", quoted(child.descriptor.gridName()),
                    " shares is missing");
  }

  std::string path_;
  InputFile input_;
  std::uint64_t bytes_;
  OpenOptions options_;
  Entry* chosen_ = nullptr;  // in entries_
  // The stream refers to this very pointer.
  openvdb::io::StreamMetadata::Ptr stream_metadata_ =
      std::make_shared<openvdb::io::StreamMetadata>();
  WatchedFile watched_;
  std::istream in_;
  std::vector<Entry> entries_;
};

struct VoxelBox {
  Index3 first, count;
};

// The box that isobrick wrote the grid from, if the file states one that holds all active voxels.
// Other programs need not state it, and only dimensions follow from it.
std::optional<VoxelBox> boxOfMetadata(const GridBase& grid, const openvdb::CoordBBox& active) {
  const auto vectorOf = [&](const char* key) -> std::optional<Index3> {
    const auto meta = grid.getMetadata<openvdb::Vec3IMetadata>(key);
    if (!meta) return std::nullopt;
    return Index3(meta->value().x(), meta->value().y(), meta->value().z());
  };
  const auto first = vectorOf("isobrick:first"), count = vectorOf("isobrick:voxels");
  if (!first || !count) return std::nullopt;
  for (int axis = 0; axis < 3; ++axis) {
    constexpr std::int64_t kFurthest = std::int64_t{1} << 30;
    if ((*count)[axis] < 2 || (*count)[axis] > kMaxVoxelsPerAxis ||
        std::abs((*first)[axis]) > kFurthest)
      return std::nullopt;
    if (!active.empty() && (active.min()[axis] < (*first)[axis] ||
                            active.max()[axis] >= (*first)[axis] + (*count)[axis]))
      return std::nullopt;
  }
  return VoxelBox{*first, *count};
}

// The active voxels with one more on each side: there the background closes the surface.
VoxelBox grownActiveBox(const std::string& path, const GridBase& grid) {
  const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
  if (const auto said = boxOfMetadata(grid, box)) return *said;
  if (box.empty())
    throw unusable(path, "its grid ", quoted(grid.getName()),
                   " has no active voxels; choose a grid that is not empty");
  VoxelBox result;
  for (int axis = 0; axis < 3; ++axis) {
    // 64-bit: the box may reach over all 32-bit coordinates.
    result.first[axis] = std::int64_t{box.min()[axis]} - 1;
    result.count[axis] = std::int64_t{box.max()[axis]} + 2 - result.first[axis];
  }
  checkVoxelCounts(path, result.count);
  for (int axis = 0; axis < 3; ++axis)
    if (box.min()[axis] == openvdb::Coord::min()[axis] ||
        box.max()[axis] == openvdb::Coord::max()[axis])
      throw cannotUse(path, "its voxels lie at the end of the 32-bit coordinates");
  return result;
}

void takeTransform(const std::string& path, const GridBase& grid, const VoxelBox& box,
                   VolumeInfo& info) {
  if (!grid.transform().isLinear())
    throw cannotUse(path, "its grid ", quoted(grid.getName()),
                    " has a perspective (frustum) transform, and only linear ones are read");
  const auto map = grid.transform().baseMap()->getAffineMap();
  const auto toGlm = [](const openvdb::Vec3d& v) { return glm::dvec3(v.x(), v.y(), v.z()); };
  GridGeometry& geometry = info.geometry;
  for (int axis = 0; axis < 3; ++axis) {
    openvdb::Vec3d step(0.0);
    step[axis] = 1;
    const glm::dvec3 column = toGlm(map->applyJacobian(step));
    geometry.spacing[axis] = glm::length(column);
    if (geometry.spacing[axis] > 0) geometry.direction[axis] = column / geometry.spacing[axis];
  }
  const glm::dvec3 index(box.first);
  geometry.origin = toGlm(map->applyMap({index.x, index.y, index.z}));
  // The format has no unit; this is isobrick's own.
  const auto unit = grid.getMetadata<openvdb::StringMetadata>("isobrick:length_unit");
  if (unit && unit->value() != lengthUnitName(LengthUnit::kUnknown))
    takeLengthUnits({unit->value(), unit->value(), unit->value()}, info);
  tidyGeometry(path, geometry, box.count, info.notes);
}

// The common part of both sources.
class VdbSourceBase : public VolumeSource {
 public:
  const VolumeInfo& info() const final { return info_; }
  std::vector<std::string> files() const final { return {info_.source}; }

 protected:
  VdbSourceBase(VolumeInfo info, const Index3& first) : info_(std::move(info)), first_(first) {}

  VolumeInfo info_;
  Index3 first_;  // coordinate of voxel (0,0,0)
};

// A grid in memory.
template <typename Grid>
class VdbSource final : public VdbSourceBase {
 public:
  VdbSource(VolumeInfo info, typename Grid::ConstPtr grid, const Index3& first)
      : VdbSourceBase(std::move(info), first), grid_(std::move(grid)) {}

  bool readsBoxes() const override { return true; }
  std::uint64_t bufferBytes() const override { return grid_->memUsage(); }

  // Only reads the tree, all of which is in memory: any number of threads.
  void readBox(const IndexBox& box, void* out) const override {
    copyVoxels(*grid_, {first_ + box.first, box.count}, out);
  }

 private:
  typename Grid::ConstPtr grid_;
};

// A grid that does not fit into memory: holds the places of its leaves, and the voxels of some
// slices.
template <typename Tree>
class VdbSlabSource final : public VdbSourceBase {
  using Value = typename Tree::ValueType;

 public:
  VdbSlabSource(VolumeInfo info, std::unique_ptr<VdbFile> file,
                std::unique_ptr<VdbSlabs<Tree>> slabs, const Index3& first,
                std::uint64_t node_bytes, std::uint64_t memory_bytes)
      : VdbSourceBase(std::move(info), first), file_(std::move(file)), slabs_(std::move(slabs)) {
    const auto slice_bytes =
        static_cast<std::uint64_t>(info_.voxels.x * info_.voxels.y) * sizeof(Value);
    // A thread's leaves.
    constexpr std::uint64_t kThreadBytes = std::uint64_t{1} << 20;
    const auto threads =
        static_cast<std::uint64_t>(std::max(1, tbb::this_task_arena::max_concurrency()));
    const std::uint64_t held = slabs_->bytes() + kThreadBytes * threads;
    const std::uint64_t left = memory_bytes > held ? memory_bytes - held : 0;
    slices_ = std::clamp(static_cast<std::int64_t>(left / slice_bytes), std::int64_t{1},
                         info_.voxels.z + kLeafSlices);
    // Whole layers of leaves, if they fit, so that none is read twice.
    if (slices_ >= kLeafSlices) slices_ -= slices_ % kLeafSlices;
    // While the file was opened, the nodes took most.
    buffer_bytes_ = std::max(node_bytes, held + static_cast<std::uint64_t>(slices_) * slice_bytes);
  }

  std::uint64_t bufferBytes() const override { return buffer_bytes_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const Index3& voxels = info_.voxels;
    auto* to = static_cast<Value*>(out);
    while (count > 0) {
      const std::int64_t y = first % voxels.y, z = first / voxels.y;
      if (z >= slab_begin_ + slab_slices_) loadSlab(z);
      const std::int64_t rows = std::min(count, (slab_begin_ + slab_slices_ - z) * voxels.y - y);
      to = std::copy_n(slab_.data() + ((z - slab_begin_) * voxels.y + y) * voxels.x,
                       rows * voxels.x, to);
      first += rows;
      count -= rows;
    }
  }

 private:
  static constexpr std::int64_t kLeafSlices = VdbSlabs<Tree>::kLeafVoxels;

  void loadSlab(std::int64_t z) {
    const std::int64_t low = first_.z + z;
    const std::int64_t end =
        (slices_ < kLeafSlices ? low : low & ~(kLeafSlices - 1)) + slices_ - first_.z;
    slab_begin_ = z;
    slab_slices_ = std::min(end, info_.voxels.z) - z;
    const Index3& voxels = info_.voxels;
    slab_.resize(static_cast<std::size_t>(voxels.x * voxels.y * std::min(slices_, voxels.z)));
    file_->readSlab(*slabs_, {first_ + Index3(0, 0, z), Index3(voxels.x, voxels.y, slab_slices_)},
                    slab_.data());
  }

  std::unique_ptr<VdbFile> file_;
  std::unique_ptr<VdbSlabs<Tree>> slabs_;
  std::int64_t slices_ = 0;  // of a slab
  std::uint64_t buffer_bytes_ = 0;
  std::vector<Value> slab_;
  std::int64_t slab_begin_ = 0, slab_slices_ = 0;  // its contents
};

// The properties that the writer of .vdb needs again.
void takeProperties(VolumeInfo& info, const GridBase::Ptr& grid, const Index3& first) {
  info.properties["vdb.name"] = grid->getName();
  info.properties["vdb.class"] = GridBase::gridClassToString(grid->getGridClass());
  info.properties["vdb.first"] = indexText(first);
  visitScalar(grid, [&](const auto& typed) {
    std::array<char, 32> text;
    const auto background = static_cast<float>(static_cast<double>(typed->background()));
    const auto end = std::to_chars(text.data(), text.data() + text.size(), background).ptr;
    info.properties["vdb.background"] = std::string(text.data(), end);
  });
}

}  // namespace

std::vector<std::string> vdbGridNames(const std::string& path, const OpenOptions& options) {
  return VdbFile(path, options).gridNames();
}

std::unique_ptr<VolumeSource> openVdbSource(const std::string& path, const OpenOptions& options) {
  VolumeInfo info;
  info.source = path;
  info.format = "OpenVDB";
  auto file = std::make_unique<VdbFile>(path, options);
  file->chooseGrid(info.notes);
  const VdbFile::Loaded loaded = file->load(options.memory_bytes);
  const GridBase::Ptr grid = loaded.grid;
  const VoxelBox box = grownActiveBox(path, *grid);
  info.voxels = box.count;
  takeTransform(path, *grid, box, info);
  if (!options.grid.empty()) info.encoding = "grid " + quoted(options.grid);
  info.voxel_type = VoxelType::kUint8;
  if (isMask(*grid)) info.notes.push_back(grid->valueType() + " voxels became 0 and 1");
  visitScalar(grid, [&](const auto& typed) {
    using Grid = std::decay_t<decltype(*typed)>;
    if constexpr (!kHasBits<Grid>) info.voxel_type = voxelTypeOf<typename Grid::ValueType>();
  });
  if (grid->getGridClass() == openvdb::GRID_LEVEL_SET)
    info.notes.push_back("a level set: its distances are negative inside; the surface is at 0");
  takeProperties(info, grid, box.first);
  std::unique_ptr<VolumeSource> source;
  visitScalar(grid, [&](const auto& typed) {
    using Grid = std::decay_t<decltype(*typed)>;
    if (loaded.has_voxels)
      source = std::make_unique<VdbSource<Grid>>(std::move(info), typed, box.first);
    else if constexpr (!kHasBits<Grid>) {
      using Tree = typename Grid::TreeType;
      auto slabs = file->slabsOf(typed->tree());
      file->stopReporting();
      typed->newTree();  // its leaves are not needed any more
      malloc_trim(0);    // a million small pieces, which would stay with the process
      source =
          std::make_unique<VdbSlabSource<Tree>>(std::move(info), std::move(file), std::move(slabs),
                                                box.first, loaded.node_bytes, options.memory_bytes);
    }
  });
  return source;
}

}  // namespace isobrick
