// OpenVDB grids (.vdb), as Houdini, Blender and ParaView write them: the box of a grid's active
// voxels as a dense volume. The only file that includes OpenVDB.
#include "isobrick/preprocess/sources/vdb_source.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/util/logging.h>

#include <algorithm>
#include <fstream>
#include <glm/geometric.hpp>
#include <new>
#include <utility>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

using openvdb::GridBase;

// Text of a file or of OpenVDB, fit for a line of a message.
std::string quoted(const std::string& text) { return quotedText(text, 100); }

Error cannotUse(const std::string& path, const std::string& reason) {
  return Error(
      "cannot use '" + path + "': " + reason + "; write it again, or convert it to .nrrd or .mhd",
      {.path = path});
}

// OpenVDB knows its grid types, and keeps to itself what it would print, from here on.
void initializeOpenVdb() {
  static const bool kDone = [] {
    openvdb::initialize();
    openvdb::logging::setLevel(openvdb::logging::Level::Fatal);
    return true;
  }();
  static_cast<void>(kDone);
}

template <typename... Grids>
bool isOneOf(const GridBase& grid) {
  return (grid.isType<Grids>() || ...);
}

bool isScalar(const GridBase& grid) {
  return isOneOf<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid, openvdb::Int64Grid>(
      grid);
}

// A file that says how far it was read, and stops where that is wished: what it throws comes out of
// OpenVDB's call through the stream.
class WatchedFile final : public std::filebuf {
 public:
  WatchedFile(const std::string& path, std::uint64_t bytes, const OpenOptions& options)
      : bytes_(bytes), options_(options) {
    open(path, std::ios::in | std::ios::binary);
  }

 protected:
  std::streamsize xsgetn(char* to, std::streamsize count) override {
    look(count);
    return std::filebuf::xsgetn(to, count);
  }
  int_type underflow() override {
    look(0);
    return std::filebuf::underflow();
  }

 private:
  void look(std::streamsize count) {
    options_.checkCancel();
    read_ += static_cast<std::uint64_t>(count);
    if (read_ - reported_ < kBytesPerReport) return;
    reported_ = read_;
    options_.report("loading grid",
                    static_cast<double>(std::min(read_, bytes_)) / static_cast<double>(bytes_));
  }

  static constexpr std::uint64_t kBytesPerReport = std::uint64_t{64} << 10;
  const std::uint64_t bytes_;
  const OpenOptions& options_;
  std::uint64_t read_ = 0, reported_ = 0;
};

// A .vdb file, read front to back. OpenVDB's own io::File goes on with whatever is in memory where
// a file ends too early; here the stream throws instead, and every byte is read at once rather than
// at the first access, which would be long after the file was found to be good.
class VdbFile : private openvdb::io::Archive {
 public:
  // `options` outlives it.
  VdbFile(const std::string& path, const OpenOptions& options)
      : path_(path),
        bytes_(InputFile(path).size()),
        file_(path, bytes_, options),
        in_(file_.is_open() ? &file_ : nullptr) {
    in_.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
  }

  // The first float grid, or else the first of other numbers, with its voxels.
  GridBase::Ptr readScalarGrid(std::vector<std::string>& notes) try {
    initializeOpenVdb();
    readHeaders();
    Entry& entry = chooseGrid();
    if (entries_.size() > 1)
      notes.push_back("of " + std::to_string(entries_.size()) + " grids, " +
                      quoted(entry.descriptor.gridName()) + " was taken");
    load(entry);
    if (entry.descriptor.isInstance()) entry.grid->setTree(loadedParent(entry)->baseTreePtr());
    return entry.grid;
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
    throw cannotUse(path_, "OpenVDB reports " + quoted(error.what()));
  }

 private:
  struct Entry {
    openvdb::io::GridDescriptor descriptor;
    GridBase::Ptr grid;
    bool is_loaded = false;
  };

  void readHeaders() {
    readHeader(in_);
    if (fileVersion() > openvdb::OPENVDB_FILE_VERSION)
      throw cannotUse(path_, "its format " + std::to_string(fileVersion()) +
                                 " is newer than the library's, " +
                                 std::to_string(openvdb::OPENVDB_FILE_VERSION));
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
        throw cannotUse(path_, "it is cut short or damaged: its grid " +
                                   quoted(entry.descriptor.gridName()) + " ends at byte " +
                                   std::to_string(end) + " of " + std::to_string(bytes_));
      entry.descriptor.seekToEnd(in_);
    } else {  // it was written to a pipe: the only way to the next grid is through this one
      readGrid(entry.grid, entry.descriptor, in_);
      entry.is_loaded = true;
    }
    entries_.push_back(std::move(entry));
  }

  Entry& chooseGrid() {
    const auto isFloat = [](const Entry& e) { return e.grid->isType<openvdb::FloatGrid>(); };
    auto chosen = std::find_if(entries_.begin(), entries_.end(), isFloat);
    if (chosen == entries_.end())
      chosen = std::find_if(entries_.begin(), entries_.end(),
                            [](const Entry& e) { return isScalar(*e.grid); });
    if (chosen != entries_.end()) return *chosen;
    if (entries_.empty()) throw cannotUse(path_, "it has no grids");
    const Entry& first = entries_.front();
    throw cannotUse(path_, "it has no grid of numbers (float, double, int32, int64); its " +
                               std::string(entries_.size() > 1 ? "first" : "only") + " grid, " +
                               quoted(first.descriptor.gridName()) + ", is of the type " +
                               quoted(first.grid->valueType()));
  }

  void load(Entry& entry) {
    if (entry.is_loaded) return;
    entry.descriptor.seekToGrid(in_);
    readGrid(entry.grid, entry.descriptor, in_);
    entry.is_loaded = true;
  }

  // Grids that share one tree are written with the voxels of the first only.
  GridBase::Ptr loadedParent(const Entry& child) {
    for (Entry& entry : entries_) {
      const auto& descriptor = entry.descriptor;
      if (descriptor.isInstance() ||
          descriptor.uniqueName() != child.descriptor.instanceParentName())
        continue;
      load(entry);
      return entry.grid;
    }
    throw cannotUse(path_, "the grid whose voxels " + quoted(child.descriptor.gridName()) +
                               " shares is missing");
  }

  std::string path_;
  std::uint64_t bytes_;
  // The stream refers to this very pointer.
  openvdb::io::StreamMetadata::Ptr stream_metadata_ =
      std::make_shared<openvdb::io::StreamMetadata>();
  WatchedFile file_;
  std::istream in_;
  std::vector<Entry> entries_;
};

// The active voxels with one more on each side: there the background closes the surface.
struct VoxelBox {
  Index3 first, count;
};
VoxelBox grownActiveBox(const std::string& path, const GridBase& grid) {
  const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
  if (box.empty())
    throw Error("cannot use '" + path + "': its grid " + quoted(grid.getName()) +
                    " has no active voxels; choose a grid that is not empty",
                {.path = path});
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

GridGeometry geometryOf(const std::string& path, const GridBase& grid, const Index3& first,
                        std::vector<std::string>& notes) {
  if (!grid.transform().isLinear())
    throw cannotUse(path, "its grid " + quoted(grid.getName()) +
                              " has a perspective (frustum) transform, and only linear ones are "
                              "read");
  const auto map = grid.transform().baseMap()->getAffineMap();
  const auto toGlm = [](const openvdb::Vec3d& v) { return glm::dvec3(v.x(), v.y(), v.z()); };
  GridGeometry geometry;
  for (int axis = 0; axis < 3; ++axis) {
    openvdb::Vec3d step(0.0);
    step[axis] = 1;
    const glm::dvec3 column = toGlm(map->applyJacobian(step));
    geometry.spacing[axis] = glm::length(column);
    if (geometry.spacing[axis] > 0) geometry.direction[axis] = column / geometry.spacing[axis];
  }
  const glm::dvec3 index(first);
  geometry.origin = toGlm(map->applyMap({index.x, index.y, index.z}));
  tidyGeometry(path, geometry, notes);
  return geometry;
}

template <typename Grid>
class VdbSource final : public VolumeSource {
 public:
  VdbSource(VolumeInfo info, typename Grid::ConstPtr grid, const Index3& first)
      : info_(std::move(info)), grid_(std::move(grid)), first_(first) {}

  const VolumeInfo& info() const override { return info_; }
  bool readsBoxes() const override { return true; }
  std::vector<std::string> files() const override { return {info_.source}; }
  std::string identity() const override { return {}; }
  std::uint64_t bufferBytes() const override { return grid_->memUsage(); }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const Index3& voxels = info_.voxels;
    auto* to = static_cast<float*>(out);
    while (count > 0) {
      const std::int64_t y = first % voxels.y;
      const std::int64_t rows = std::min(count, voxels.y - y);
      readBox({Index3(0, y, first / voxels.y), Index3(voxels.x, rows, 1)}, to);
      to += rows * voxels.x;
      first += rows;
      count -= rows;
    }
  }

  // Only reads the tree, all of which is in memory: any number of threads.
  void readBox(const IndexBox& box, void* out) const override {
    using Dense = openvdb::tools::Dense<float, openvdb::tools::LayoutXYZ>;
    Dense dense(openvdb::CoordBBox(coord(box.first), coord(box.end() - Index3(1))),
                static_cast<float*>(out));
    constexpr bool kSerial = true;  // the callers are parallel
    openvdb::tools::copyToDense(grid_->tree(), dense, kSerial);
  }

 private:
  openvdb::Coord coord(const Index3& index) const {
    const Index3 at = first_ + index;
    return {static_cast<std::int32_t>(at.x), static_cast<std::int32_t>(at.y),
            static_cast<std::int32_t>(at.z)};
  }

  VolumeInfo info_;
  typename Grid::ConstPtr grid_;
  Index3 first_;
};

template <typename... Grids>
std::unique_ptr<VolumeSource> makeSource(VolumeInfo info, const GridBase::Ptr& grid,
                                         const Index3& first) {
  std::unique_ptr<VolumeSource> source;
  const auto makeIf = [&]<typename Grid>(typename Grid::Ptr typed) {
    if (typed) source = std::make_unique<VdbSource<Grid>>(std::move(info), std::move(typed), first);
  };
  (makeIf.template operator()<Grids>(openvdb::gridPtrCast<Grids>(grid)), ...);
  return source;
}

}  // namespace

std::unique_ptr<VolumeSource> openVdbSource(const std::string& path, const OpenOptions& options) {
  VolumeInfo info;
  info.source = path;
  info.format = "OpenVDB";
  info.voxel_type = VoxelType::kFloat32;
  const GridBase::Ptr grid = VdbFile(path, options).readScalarGrid(info.notes);
  const VoxelBox box = grownActiveBox(path, *grid);
  info.voxels = box.count;
  info.geometry = geometryOf(path, *grid, box.first, info.notes);
  if (!grid->isType<openvdb::FloatGrid>())
    info.notes.push_back(grid->valueType() + " voxels were converted to float32");
  if (grid->getGridClass() == openvdb::GRID_LEVEL_SET)
    info.notes.push_back("a level set: its distances are negative inside; the surface is at 0");
  return makeSource<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                    openvdb::Int64Grid>(std::move(info), grid, box.first);
}

}  // namespace isobrick
