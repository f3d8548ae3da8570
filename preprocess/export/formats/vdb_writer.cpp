#include <openvdb/io/Archive.h>
#include <openvdb/io/Compression.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>

#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/formats/vdb_tree.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/openvdb_library.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

// The property of a volume that came out of a VDB file.
std::string propertyOf(const VolumeInfo& info, const std::string& name) {
  const auto found = info.properties.find("vdb." + name);
  return found == info.properties.end() ? std::string() : found->second;
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

// Rather than a level of a pyramid.
bool isOwnGrid(const VolumeInfo& info) { return info.format == "OpenVDB"; }

VdbGridPlan planGrid(const VolumeInfo& info, std::size_t number, const ExportOptions& options) {
  VdbGridPlan plan;
  if (const std::string nodes = propertyOf(info, "nodes"); !nodes.empty()) {
    // Bounds are neither rounded nor taken for the background.
    const std::string of_level = propertyOf(info, "level");
    plan.name = nodes + (of_level == "0" ? "" : "_level" + of_level);
    plan.level = numberIn<int>(of_level).value_or(0);
    plan.saves_half = voxelBytes(info.voxel_type) == 1;
    return plan;
  }
  const std::size_t level = isOwnGrid(info) ? 0 : number;
  plan.level = static_cast<int>(level);
  plan.name = propertyOf(info, "name");
  if (plan.name.empty()) plan.name = "density";
  if (level > 0) plan.name += concat("_level", level);
  // Halves hold whole numbers up to 2048.
  plan.saves_half = options.vdb_half || voxelBytes(info.voxel_type) == 1;
  plan.tolerance = static_cast<float>(options.vdb_tolerance);
  if (options.vdb_background)
    plan.background = *options.vdb_background;
  else
    plan.background = numberIn<float>(propertyOf(info, "background")).value_or(0.0f);
  if (!std::isfinite(plan.background)) plan.background = 0;
  const std::string grid_class = propertyOf(info, "class");
  if (grid_class == "level set" && plan.background > 0 && info.voxel_type == VoxelType::kFloat32)
    plan.grid_class = openvdb::GRID_LEVEL_SET;
  else if (grid_class == "fog volume")
    plan.grid_class = openvdb::GRID_FOG_VOLUME;
  if (level == 0) plan.first = indexOf(propertyOf(info, "first")).value_or(Index3(0));
  return plan;
}

// The coordinates of a file.
struct VdbUnit {
  double per_unit = 1;  // of it in one of the source's
  std::string name;
};

// OpenVDB takes grids of a few nanometres in millimetres for singular ones.
VdbUnit unitFor(const GridGeometry& finest, const std::string& path) {
  // The limit of a voxel; a thousand times OpenVDB's limit.
  constexpr double kLeastVolume = 3e-12;
  const auto fits = [&](double scale) {
    return finest.spacing.x * scale * finest.spacing.y * scale * finest.spacing.z * scale >=
           kLeastVolume;
  };
  if (finest.unit == LengthUnit::kUnknown && fits(1)) return {1, "unknown"};
  static constexpr std::pair<double, std::string_view> kMetric[] = {
      {1, lengthUnitName(LengthUnit::kMillimetre)},
      {1e3, "micrometres"},
      {1e6, "nanometres"},
      {1e9, "picometres"}};
  if (finest.unit == LengthUnit::kMillimetre)
    for (const auto& [scale, name] : kMetric)
      if (fits(scale)) return {scale, std::string(name)};
  throw unwritable(path, "its spacing is too small for OpenVDB; write .nrrd instead");
}

// Coordinates become the source's world.
openvdb::math::Transform::Ptr transformOf(const GridGeometry& geometry, const Index3& first,
                                          const VdbUnit& unit) {
  const glm::dmat3 steps = geometry.indexToWorldMatrix() * unit.per_unit;
  const glm::dvec3 origin = geometry.origin * unit.per_unit - steps * glm::dvec3(first);
  openvdb::Mat4R matrix;  // of row vectors
  for (int axis = 0; axis < 3; ++axis)
    matrix.setRow(axis, {steps[axis].x, steps[axis].y, steps[axis].z, 0});
  matrix.setRow(3, {origin.x, origin.y, origin.z, 1});
  return openvdb::math::Transform::createLinearTransform(matrix);
}

void putMetadata(const VolumeInfo& info, const VdbGridPlan& plan, const VdbUnit& unit,
                 openvdb::GridBase& grid) {
  const auto put = [&](const char* key, const std::string& text) {
    grid.insertMeta(key, openvdb::StringMetadata(text));
  };
  const auto vectorOf = [](const Index3& v) {
    return openvdb::Vec3IMetadata(
        {static_cast<int>(v.x), static_cast<int>(v.y), static_cast<int>(v.z)});
  };
  put("creator", "isobrick");
  put("isobrick:space", "LPS");
  put("isobrick:length_unit", unit.name);
  put("isobrick:source", info.source);
  put("isobrick:type", std::string(voxelTypeName(info.voxel_type)));
  if (const auto filter = info.properties.find("pyramid.filter"); filter != info.properties.end())
    put("isobrick:filter", filter->second);
  grid.insertMeta("isobrick:level", openvdb::Int32Metadata(plan.level));
  // All of the volume, its inactive rim too, so that it comes back with the same dimensions.
  grid.insertMeta("isobrick:first", vectorOf(plan.first));
  grid.insertMeta("isobrick:voxels", vectorOf(info.voxels));
}

openvdb::FloatGrid::Ptr gridWithoutVoxels(const VolumeInfo& info, const VdbGridPlan& plan,
                                          const VdbUnit& unit) {
  auto grid = openvdb::FloatGrid::create(plan.background);
  grid->setName(plan.name);
  grid->setGridClass(plan.grid_class);
  grid->setSaveFloatAsHalf(plan.saves_half);
  grid->setTransform(transformOf(info.geometry, plan.first, unit));
  putMetadata(info, plan, unit, *grid);
  return grid;
}

// Writes the file as OpenVDB's own archives do, but takes the leaves as they were packed.
class VdbArchive : private openvdb::io::Archive {
 public:
  VdbArchive(std::ostream& out, const std::string& codec) : out_(out) {
    using namespace openvdb::io;
    // Whatever packs the values, those of voxels that are not active are left out.
    if (codec == "blosc") setCompression(COMPRESS_ACTIVE_MASK | COMPRESS_BLOSC);
    if (codec == "zip") setCompression(COMPRESS_ACTIVE_MASK | COMPRESS_ZIP);
    if (codec == "none") setCompression(COMPRESS_ACTIVE_MASK);
  }

  void writeHead(std::size_t grids) {
    writeHeader(out_, true);
    openvdb::MetaMap().writeMeta(out_);
    const auto count = static_cast<std::int32_t>(grids);
    out_.write(reinterpret_cast<const char*>(&count), sizeof count);
  }

  // How leaves of the grid have to be packed.
  std::uint32_t compressionOf(const openvdb::GridBase& grid) const {
    std::ostringstream nowhere;
    setGridCompression(nowhere, grid);
    return openvdb::io::getDataCompression(nowhere);
  }

  // `writeLeaves` writes the contents of all leaves. Of grids with one name, OpenVDB counts those
  // from the second on in a suffix that it does not show.
  void writeGrid(const openvdb::FloatGrid& grid, const std::function<void()>& writeLeaves) {
    std::string name = grid.getName();
    if (const int before = names_[name]++; before > 0)
      name = openvdb::io::GridDescriptor::addSuffix(name, before);
    openvdb::io::GridDescriptor descriptor(name, grid.type(), grid.saveFloatAsHalf());
    descriptor.writeHeader(out_);
    const auto places = out_.tellp();
    descriptor.writeStreamPos(out_);
    descriptor.setGridPos(out_.tellp());
    setGridCompression(out_, grid);
    grid.writeMeta(out_);
    grid.writeTransform(out_);
    grid.writeTopology(out_);
    descriptor.setBlockPos(out_.tellp());
    writeLeaves();
    descriptor.setEndPos(out_.tellp());
    out_.seekp(places);
    descriptor.writeStreamPos(out_);
    out_.seekp(descriptor.getEndPos());
  }

 private:
  std::ostream& out_;
  std::map<std::string, int> names_;  // how many grids have each so far
};

// What becomes of values, a line each.
std::vector<std::string> lostValues(VoxelType type, const ExportOptions& options) {
  std::vector<std::string> lost;
  if (type != VoxelType::kFloat32)
    lost.push_back(std::string(voxelTypeName(type)) + " voxels became floats of the same values" +
                   (options.vdb_half && voxelBytes(type) == 2
                        ? ", and those beyond 2048 were rounded to half precision"
                        : ""));
  else if (options.vdb_half)
    lost.push_back("values were rounded to half precision");
  if (options.vdb_tolerance > 0)
    lost.push_back("values within the tolerance of the background became the background");
  return lost;
}

}  // namespace

VolumeWriteReport writeVdb(VolumeLevels& levels, const std::string& path,
                           const ExportOptions& options) {
  initializeOpenVdb();
  VolumeWriteReport report;
  report.space = "LPS";
  report.lost = lostValues(levels.front()->info().voxel_type, options);
  for (std::size_t i = 0; i < levels.size(); ++i)
    if (const VdbGridPlan plan = planGrid(levels[i]->info(), i, options); plan.saves_half)
      plan.refuseBeyondHalf(plan.background, path);
  if (options.vdb_codec == "blosc" && !openvdb::io::Archive::hasBloscCompression())
    throw unwritable(path, "this OpenVDB was built without Blosc; choose another codec");
  const VdbUnit unit = unitFor(levels.front()->info().geometry, path);
  if (unit.per_unit != 1)
    report.lost.push_back("lengths are in " + unit.name + ", as OpenVDB takes no grid that is so " +
                          "small in millimetres; isobrick makes millimetres of them again");
  AtomicFile file(path);

  // Each grid is a share of the work, as large as it is, most of which is to pack its leaves.
  constexpr double kPacking = 0.9;
  double total = 0, before = 0;
  for (auto& level : levels) {
    makeReadBoxes(level, folderOf(path), options);
    total += static_cast<double>(volumeBytes(level->info()));
  }

  std::ofstream out(file.temporaryPath(), std::ios::binary | std::ios::in | std::ios::out);
  out.exceptions(std::ios::failbit | std::ios::badbit);
  try {
    VdbArchive archive(out, options.vdb_codec);
    archive.writeHead(levels.size());
    for (std::size_t i = 0; i < levels.size(); ++i) {
      const VolumeInfo& info = levels[i]->info();
      const VdbGridPlan plan = planGrid(info, i, options);
      const double share = static_cast<double>(volumeBytes(info));
      const auto tick = [&](double done) {
        if (options.progress) options.progress((before + share * done) / total);
      };
      // OpenVDB has loops of its own, also when a tree is destroyed.
      isolatedFor(0, 1, [&](int) {
        const auto grid =
            gridWithoutVoxels(info, plan, isOwnGrid(info) ? unitFor(info.geometry, path) : unit);
        VdbPackedLeaves leaves(folderOf(path));
        makeVdbTree(
            *levels[i], plan, archive.compressionOf(*grid), path, options,
            [&](double done) { tick(kPacking * done); }, *grid, leaves);
        grid->addStatsMetadata();  // by which other programs say what the file holds
        archive.writeGrid(*grid, [&] {
          leaves.appendTo(out, grid->tree(), options,
                          [&](double done) { tick(kPacking + (1 - kPacking) * done); });
        });
      });
      before += share;
    }
    report.bytes = static_cast<std::uint64_t>(out.tellp());
    out.close();
  } catch (const std::ios_base::failure&) {
    throw ResumableError("cannot write '" + path + "': the disk is full or fails; free some " +
                             "space or choose another folder",
                         {.path = path});
  }
  publish(file, options);
  return report;
}

}  // namespace isobrick
