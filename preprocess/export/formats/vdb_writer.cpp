#include "isobrick/preprocess/export/formats/vdb_writer.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/openvdb.h>
#include <openvdb/util/logging.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/preprocess/export/formats/spooled_source.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;
using openvdb::Coord;

constexpr std::int64_t kLeafVoxels = 8;
// The node above leaves has 16^3 of them: read at a time, and, as it happens, a sixth of a brick
// more than two bricks along each axis.
constexpr std::int64_t kNodeVoxels = 128;
// A leaf without values with its entry in the node above, and what malloc adds.
constexpr std::uint64_t kBytesPerLeaf = 128;
// Voxels of a node, as they come and as floats.
constexpr std::uint64_t kNodeBufferBytes = std::uint64_t{20} << 20;

void initializeOpenVdb() {
  static const bool kDone = [] {
    openvdb::initialize();
    openvdb::logging::setLevel(openvdb::logging::Level::Fatal);
    return true;
  }();
  static_cast<void>(kDone);
}

// The property of a volume that came out of a VDB file.
std::string propertyOf(const VolumeInfo& info, const std::string& name) {
  const auto found = info.properties.find("vdb." + name);
  return found == info.properties.end() ? std::string() : found->second;
}

// The greatest multiple of `step` that is not above `index`.
std::int64_t floorTo(std::int64_t index, std::int64_t step) {
  return index >= 0 ? index / step * step : -((-index + step - 1) / step) * step;
}

Coord coordOf(const Index3& v) {
  return {static_cast<std::int32_t>(v.x), static_cast<std::int32_t>(v.y),
          static_cast<std::int32_t>(v.z)};
}

// Where a level's voxels go in its grid, and which of them are active.
struct GridPlan {
  std::string name;
  Index3 first{0};  // coordinate of voxel (0,0,0)
  float background = 0;
  float tolerance = 0;
  openvdb::GridClass grid_class = openvdb::GRID_UNKNOWN;
  bool saves_half = false;

  // What a voxel counts as: values within the tolerance are the background.
  float valueOf(float value) const {
    return grid_class != openvdb::GRID_LEVEL_SET && std::abs(value - background) <= tolerance
               ? background
               : value;
  }
  bool isActive(float value) const {
    return grid_class == openvdb::GRID_LEVEL_SET ? std::abs(value) < background
                                                 : value != background;
  }
};

std::optional<float> numberOf(const std::string& text) {
  float number = 0;
  const char* const end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, number);
  if (text.empty() || result.ec != std::errc() || result.ptr != end || !std::isfinite(number))
    return std::nullopt;
  return number;
}

// "i,j,k" within the coordinates that leave room on both sides.
std::optional<Index3> indexOf(const std::string& text) {
  Index3 index;
  const char* at = text.data();
  const char* const end = at + text.size();
  for (int axis = 0; axis < 3; ++axis) {
    if (axis > 0 && (at == end || *at++ != ',')) return std::nullopt;
    const auto result = std::from_chars(at, end, index[axis]);
    if (result.ec != std::errc() || std::abs(index[axis]) > std::int64_t{1} << 30)
      return std::nullopt;
    at = result.ptr;
  }
  if (at != end) return std::nullopt;
  return index;
}

GridPlan planGrid(const VolumeInfo& info, std::size_t level, const ExportOptions& options) {
  GridPlan plan;
  plan.name = propertyOf(info, "name");
  if (plan.name.empty()) plan.name = "density";
  if (level > 0) plan.name += "_level" + std::to_string(level);
  // Halves hold whole numbers up to 2048.
  plan.saves_half = options.vdb_half || voxelBytes(info.voxel_type) == 1;
  plan.tolerance = static_cast<float>(options.vdb_tolerance);
  if (options.vdb_background)
    plan.background = *options.vdb_background;
  else
    plan.background = numberOf(propertyOf(info, "background")).value_or(0.0f);
  const std::string grid_class = propertyOf(info, "class");
  if (grid_class == "level set" && plan.background > 0 && info.voxel_type == VoxelType::kFloat32)
    plan.grid_class = openvdb::GRID_LEVEL_SET;
  else if (grid_class == "fog volume")
    plan.grid_class = openvdb::GRID_FOG_VOLUME;
  if (level == 0) plan.first = indexOf(propertyOf(info, "first")).value_or(Index3(0));
  return plan;
}

// What bounds the values of the level must not be rounded, nor taken for the background.
GridPlan planBeside(const GridPlan& level, const BesideVolume& beside) {
  GridPlan plan;
  plan.name = level.name + "_" + beside.name;
  plan.saves_half = voxelBytes(beside.volume->info().voxel_type) == 1;
  if (beside.has_values) plan.background = level.background;
  return plan;
}

// Coordinates become the source's world.
openvdb::math::Transform::Ptr transformOf(const GridGeometry& geometry, const Index3& first) {
  const glm::dmat3 steps = geometry.indexToWorldMatrix();
  const glm::dvec3 origin = geometry.origin - steps * glm::dvec3(first);
  openvdb::Mat4R matrix;  // of row vectors
  for (int axis = 0; axis < 3; ++axis)
    matrix.setRow(axis, {steps[axis].x, steps[axis].y, steps[axis].z, 0});
  matrix.setRow(3, {origin.x, origin.y, origin.z, 1});
  return openvdb::math::Transform::createLinearTransform(matrix);
}

// The voxels of a box as floats, where it reaches beyond the volume the background.
class NodeReader {
 public:
  NodeReader(VolumeSource& source, const GridPlan& plan) : source_(source), plan_(plan) {}

  // The node with its lowest corner at `corner`, in grid coordinates.
  void read(const Index3& corner) {
    corner_ = corner;
    const Index3 begin = glm::max(corner - plan_.first, Index3(0));
    const Index3 end = glm::min(corner - plan_.first + Index3(kNodeVoxels), source_.info().voxels);
    box_ = {begin, end - begin};
    values_.resize(static_cast<std::size_t>(box_.size()));
    const VoxelType type = source_.info().voxel_type;
    if (type == VoxelType::kFloat32) {
      source_.readBox(box_, values_.data());
    } else {
      stored_.resize(values_.size() * voxelBytes(type));
      source_.readBox(box_, stored_.data());
      visitVoxelType(type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        const T* const from = reinterpret_cast<const T*>(stored_.data());
        std::transform(from, from + values_.size(), values_.begin(),
                       [](T value) { return static_cast<float>(value); });
      });
    }
    for (float& value : values_) value = plan_.valueOf(value);
  }

  const Index3& corner() const { return corner_; }
  // Of the coordinates, those of the volume.
  bool reaches(const Index3& leaf) const {
    const Index3 low = leaf - plan_.first, high = low + Index3(kLeafVoxels);
    return glm::all(glm::lessThan(low, box_.end())) && glm::all(glm::greaterThan(high, box_.first));
  }

  // The values of a leaf in OpenVDB's order: z fastest.
  void copyLeaf(const Index3& leaf, float* out) const {
    const Index3 low = leaf - plan_.first;
    if (glm::all(glm::greaterThanEqual(low, box_.first)) &&
        glm::all(glm::lessThanEqual(low + Index3(kLeafVoxels), box_.end())))
      return copyWholeLeaf(low, out);
    std::fill_n(out, Leaf::SIZE, plan_.background);
    const Index3 begin = glm::max(low, box_.first);
    const Index3 end = glm::min(low + Index3(kLeafVoxels), box_.end());
    for (std::int64_t z = begin.z; z < end.z; ++z)
      for (std::int64_t y = begin.y; y < end.y; ++y)
        for (std::int64_t x = begin.x; x < end.x; ++x)
          out[((x - low.x) * kLeafVoxels + (y - low.y)) * kLeafVoxels + (z - low.z)] =
              values_[static_cast<std::size_t>(
                  linearIndex(Index3(x, y, z) - box_.first, box_.count))];
  }

 private:
  // Almost all leaves: loops of a known length, and the order in which they are written.
  void copyWholeLeaf(const Index3& low, float* out) const {
    const float* const from = values_.data() + linearIndex(low - box_.first, box_.count);
    const std::int64_t row = box_.count.x, slice = box_.count.x * box_.count.y;
    for (std::int64_t x = 0; x < kLeafVoxels; ++x)
      for (std::int64_t y = 0; y < kLeafVoxels; ++y)
        for (std::int64_t z = 0; z < kLeafVoxels; ++z) *out++ = from[z * slice + y * row + x];
  }

  VolumeSource& source_;
  const GridPlan& plan_;
  Index3 corner_{0};
  IndexBox box_;  // what values_ holds, in voxels of the source
  std::vector<std::byte> stored_;
  std::vector<float> values_;
};

// All boxes of `step` voxels, aligned to it, that touch [begin, end).
template <typename F>
void forEachCorner(const Index3& begin, const Index3& end, std::int64_t step, F&& f) {
  for (std::int64_t z = floorTo(begin.z, step); z < end.z; z += step)
    for (std::int64_t y = floorTo(begin.y, step); y < end.y; y += step)
      for (std::int64_t x = floorTo(begin.x, step); x < end.x; x += step) f(Index3(x, y, z));
}

// One level: its tree without values, and its leaves when they are wanted.
class LevelGrid {
 public:
  using Tick = std::function<void(double)>;

  LevelGrid(VolumeSource& source, GridPlan plan, const std::string& path,
            const ExportOptions& options)
      : source_(source), plan_(std::move(plan)), path_(path), options_(options) {}

  const openvdb::FloatGrid& grid() const { return *grid_; }
  const GridPlan& plan() const { return plan_; }

  // The first pass. `leaf_budget`: how many leaves may be held; what is left of it afterwards.
  void makeTree(std::uint64_t& leaf_budget, std::size_t level, const Tick& tick) {
    const VolumeInfo& info = source_.info();
    grid_ = openvdb::FloatGrid::create(plan_.background);
    grid_->setName(plan_.name);
    grid_->setGridClass(plan_.grid_class);
    grid_->setSaveFloatAsHalf(plan_.saves_half);
    grid_->setTransform(transformOf(info.geometry, plan_.first));
    putMetadata(info, level);
    NodeReader reader(source_, plan_);
    const Index3 end = plan_.first + info.voxels;
    std::vector<float> values(Leaf::SIZE);
    const Index3 nodes = (end - floorEach(plan_.first) + Index3(kNodeVoxels - 1)) / kNodeVoxels;
    std::int64_t done = 0;
    forEachCorner(plan_.first, end, kNodeVoxels, [&](const Index3& node) {
      checkCancel(options_);
      reader.read(node);
      forEachCorner(node, node + Index3(kNodeVoxels), kLeafVoxels, [&](const Index3& leaf) {
        if (reader.reaches(leaf)) addLeaf(reader, leaf, values, leaf_budget);
      });
      tick(static_cast<double>(++done) / static_cast<double>(elementCount(nodes)));
    });
  }

  // The second pass: the values of all leaves in the order of the tree.
  void writeLeaves(std::ostream& out, const Tick& tick) {
    NodeReader reader(source_, plan_);
    bool has_node = false;
    const auto leaves = static_cast<double>(grid_->tree().leafCount());
    std::int64_t done = 0;
    for (auto leaf = grid_->tree().beginLeaf(); leaf; ++leaf, ++done) {
      const Coord at = leaf->origin();
      const Index3 corner(at.x(), at.y(), at.z());
      const Index3 node = floorEach(corner);
      if (!has_node || node != reader.corner()) {
        checkCancel(options_);
        reader.read(node);
        has_node = true;
        tick(static_cast<double>(done) / leaves);
      }
      leaf->allocate();
      reader.copyLeaf(corner, leaf->buffer().data());
      leaf->writeBuffers(out, plan_.saves_half);
      Leaf::Buffer none(openvdb::PartialCreate(), plan_.background);
      leaf->swap(none);  // its values go with `none`
    }
  }

 private:
  static Index3 floorEach(const Index3& v) {
    return {floorTo(v.x, kNodeVoxels), floorTo(v.y, kNodeVoxels), floorTo(v.z, kNodeVoxels)};
  }

  void putMetadata(const VolumeInfo& info, std::size_t level) {
    const auto put = [&](const char* key, const std::string& text) {
      grid_->insertMeta(key, openvdb::StringMetadata(text));
    };
    put("creator", "isobrick");
    put("isobrick:space", "LPS");
    put("isobrick:source", info.source);
    put("isobrick:type", std::string(voxelTypeName(info.voxel_type)));
    grid_->insertMeta("isobrick:level", openvdb::Int32Metadata(static_cast<int>(level)));
    // All of the volume, its inactive rim too, so that it comes back with the same dimensions.
    grid_->insertMeta("isobrick:first", openvdb::Vec3IMetadata({static_cast<int>(plan_.first.x),
                                                                static_cast<int>(plan_.first.y),
                                                                static_cast<int>(plan_.first.z)}));
    grid_->insertMeta("isobrick:voxels", openvdb::Vec3IMetadata({static_cast<int>(info.voxels.x),
                                                                 static_cast<int>(info.voxels.y),
                                                                 static_cast<int>(info.voxels.z)}));
  }

  void addLeaf(const NodeReader& reader, const Index3& corner, std::vector<float>& values,
               std::uint64_t& leaf_budget) {
    reader.copyLeaf(corner, values.data());
    const float first = values.front();
    if (std::all_of(values.begin(), values.end(), [&](float v) { return v == first; })) {
      // Nothing but a tile in the node above; the background is not even that.
      if (first != plan_.background)
        grid_->tree().addTile(1, coordOf(corner), first, plan_.isActive(first));
      return;
    }
    if (leaf_budget == 0) throw tooManyLeaves();
    --leaf_budget;
    auto* const leaf = new Leaf(openvdb::PartialCreate(), coordOf(corner), plan_.background, false);
    Leaf::NodeMaskType mask;
    for (openvdb::Index i = 0; i < Leaf::SIZE; ++i)
      if (plan_.isActive(values[i])) mask.setOn(i);
    leaf->setValueMask(mask);
    grid_->tree().addLeaf(leaf);
  }

  Error tooManyLeaves() const {
    const Index3 leaves =
        source_.info().voxels / kLeafVoxels + Index3(2);  // some reach over both ends
    const std::uint64_t most =
        (static_cast<std::uint64_t>(elementCount(leaves)) * kBytesPerLeaf * 8 / 7 +
         kNodeBufferBytes + source_.bufferBytes()) >>
        20;
    return Error("cannot write '" + path_ + "': the nodes of its tree take up to " +
                     std::to_string(most + 1) + " MiB, which is more than is allowed; write a " +
                     "coarser level or a box, or store less with a background and a tolerance",
                 {.path = path_}, {Remedy::kAllowMoreMemory});
  }

  VolumeSource& source_;
  GridPlan plan_;
  std::string path_;
  const ExportOptions& options_;
  openvdb::FloatGrid::Ptr grid_;
};

// Writes the file as OpenVDB's own archives do, but takes the leaves one by one.
class VdbArchive : private openvdb::io::Archive {
 public:
  void write(std::ostream& out, std::vector<LevelGrid>& grids,
             const std::function<LevelGrid::Tick(std::size_t)>& tickOf) {
    writeHeader(out, true);
    openvdb::MetaMap().writeMeta(out);
    const auto count = static_cast<std::int32_t>(grids.size());
    out.write(reinterpret_cast<const char*>(&count), sizeof count);
    for (std::size_t i = 0; i < grids.size(); ++i) writeOne(out, grids[i], tickOf(i));
  }

 private:
  void writeOne(std::ostream& out, LevelGrid& level, const LevelGrid::Tick& tick) {
    const openvdb::FloatGrid& grid = level.grid();
    openvdb::io::GridDescriptor descriptor(level.plan().name, grid.type(), level.plan().saves_half);
    descriptor.writeHeader(out);
    const auto places = out.tellp();
    descriptor.writeStreamPos(out);
    descriptor.setGridPos(out.tellp());
    setGridCompression(out, grid);
    grid.writeMeta(out);
    grid.writeTransform(out);
    grid.writeTopology(out);
    descriptor.setBlockPos(out.tellp());
    level.writeLeaves(out, tick);
    descriptor.setEndPos(out.tellp());
    out.seekp(places);
    descriptor.writeStreamPos(out);
    out.seekp(descriptor.getEndPos());
  }
};

std::string folderOf(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

}  // namespace

VolumeWriteReport writeVdb(VolumeLevels& levels, const std::string& path,
                           const ExportOptions& options) {
  initializeOpenVdb();
  VolumeWriteReport report;
  report.space = "LPS";
  const VoxelType type = levels.front()->info().voxel_type;
  if (type != VoxelType::kFloat32)
    report.lost.push_back(std::string(voxelTypeName(type)) +
                          " voxels became floats of the same values" +
                          (options.vdb_half && voxelBytes(type) == 2
                               ? ", and those beyond 2048 were rounded to half precision"
                               : ""));
  else if (options.vdb_half)
    report.lost.push_back("values were rounded to half precision");
  if (options.vdb_tolerance > 0)
    report.lost.push_back("values within the tolerance of the background became the background");
  AtomicFile file(path);

  std::vector<BesideVolume> none;
  std::vector<BesideVolume>& beside = options.vdb_beside == nullptr ? none : *options.vdb_beside;
  std::vector<VolumeSource*> sources;  // of all grids, in the order of the file
  for (auto& level : levels) {
    if (!level->readsBoxes()) level = makeSpooledSource(std::move(level), folderOf(path), options);
    sources.push_back(level.get());
  }
  for (const BesideVolume& one : beside) sources.push_back(one.volume.get());

  // Each pass over each of them is a share of the work, as large as it is.
  double total = 0, before = 0;
  for (const VolumeSource* source : sources)
    total += 2 * static_cast<double>(volumeBytes(source->info()));
  const auto tickOf = [&](std::size_t i) -> LevelGrid::Tick {
    const double begin = before, share = static_cast<double>(volumeBytes(sources[i]->info()));
    before += share;
    return [begin, share, total, &options](double done) {
      if (options.progress) options.progress((begin + share * done) / total);
    };
  };
  std::uint64_t leaf_budget =
      options.memory_bytes > kNodeBufferBytes
          ? (options.memory_bytes - kNodeBufferBytes) / kBytesPerLeaf * 7 / 8  // nodes above
          : 0;
  std::vector<LevelGrid> grids;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    const bool is_level = i < levels.size();
    const BesideVolume* const one = is_level ? nullptr : &beside[i - levels.size()];
    grids.emplace_back(*sources[i],
                       is_level ? planGrid(sources[i]->info(), i, options)
                                : planBeside(grids[one->level].plan(), *one),
                       path, options);
    grids.back().makeTree(leaf_budget, is_level ? i : one->level, tickOf(i));
  }

  std::ofstream out(file.temporaryPath(), std::ios::binary | std::ios::in | std::ios::out);
  out.exceptions(std::ios::failbit | std::ios::badbit);
  try {
    VdbArchive().write(out, grids, tickOf);
    report.bytes = static_cast<std::uint64_t>(out.tellp());
    out.close();
  } catch (const std::ios_base::failure&) {
    throw ResumableError("cannot write '" + path + "': the disk is full or fails; free some " +
                             "space or choose another folder with -o",
                         {.path = path});
  }
  if (options.before_publishing) options.before_publishing();
  file.commit(options.cancel);
  return report;
}

}  // namespace isobrick
