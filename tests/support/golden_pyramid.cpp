#include "tests/support/golden_pyramid.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <iomanip>
#include <sstream>

#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/array_source.h"

namespace isobrick::test {
namespace {

// FNV-1a over 32-bit numbers, by bytes from the lowest.
class Hash {
 public:
  void add(std::uint32_t number) {
    for (int i = 0; i < 4; ++i) {
      state_ = (state_ ^ (number >> 8 * i & 255)) * 0x100000001b3;
    }
  }
  void add(float number) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &number, sizeof bits);
    add(bits);
  }
  std::uint64_t value() const { return state_; }

 private:
  std::uint64_t state_ = 0xcbf29ce484222325;
};

// Nine digits tell all floats apart, seventeen all doubles.
template <typename T>
std::string text(T number) {
  std::ostringstream out;
  out << std::setprecision(std::is_same_v<T, float> ? 9 : 17) << number;
  return out.str();
}
template <typename T>
std::string texts(const T& numbers) {
  std::string result;
  for (const auto& number : numbers) result.append(" ").append(text(number));
  return result;
}
std::array<std::int64_t, 3> indexOf(const Index3& v) { return {v.x, v.y, v.z}; }

constexpr std::size_t kMostValues = 128;  // that are written out

template <typename Values>
std::string elements(const char* what, const Values& values) {
  Hash hash;
  for (const auto value : values) hash.add(value);
  std::ostringstream out;
  out << "  " << what << ": " << values.size() << " hash " << std::hex << hash.value() << '\n';
  if (!values.empty() && values.size() <= kMostValues) out << "   " << texts(values) << '\n';
  return out.str();
}

// The facts of a brick that both readers know.
struct BrickValues {
  int level = 0;
  std::array<std::int64_t, 3> index{}, first_sample{}, count{};
  float least = 0, greatest = 0;
  std::vector<float> samples, ranges;
  std::vector<std::uint32_t> codes;
};

std::string dumpOfBrick(const BrickValues& brick, const std::string& parts) {
  return std::string("brick") + texts(brick.index) + " of level " + text(brick.level) + ": range " +
         text(brick.least) + " " + text(brick.greatest) + "; samples" + texts(brick.count) +
         " from" + texts(brick.first_sample) + "\n" + parts + elements("samples", brick.samples) +
         elements("tile ranges", brick.ranges) + elements("curvature", brick.codes);
}

// The header's numbers, one a line.
struct HeaderValues {
  std::uint32_t voxel_type = 0, filter = 0;
  std::int64_t brick_cells = 0, tile_cells = 0;
  bool has_curvature = false;
  std::array<std::int64_t, 3> dims{};
  std::array<double, 3> spacing{}, origin{};
  std::array<double, 9> direction{};
  std::uint32_t length_unit = 0;
  double value_min = 0, value_max = 0, curvature_epsilon = 0, noise = 0;
  ValueTransform values;
  std::vector<std::uint32_t> histogram;
  std::vector<float> gradients;
};

std::string dumpOfHeader(const HeaderValues& header) {
  std::ostringstream out;
  out << "voxel_type " << header.voxel_type << "\nfilter " << header.filter << "\nbrick_cells "
      << header.brick_cells << "\ntile_cells " << header.tile_cells << "\nhas_curvature "
      << header.has_curvature << "\ndims" << texts(header.dims) << "\nspacing"
      << texts(header.spacing) << "\norigin" << texts(header.origin) << "\ndirection"
      << texts(header.direction) << "\nlength_unit " << header.length_unit << "\nvalues "
      << text(header.value_min) << ' ' << text(header.value_max) << "\ncurvature_epsilon "
      << text(header.curvature_epsilon) << "\nnoise " << text(header.noise) << '\n';
  if (!header.values.isIdentity())
    out << "transform " << text(header.values.scale) << ' ' << text(header.values.offset) << '\n';
  out << elements("histogram", header.histogram) << elements("gradients", header.gradients);
  return out.str();
}

std::string dumpOfLevel(int level, const std::array<std::int64_t, 3>& samples,
                        const std::array<std::int64_t, 3>& bricks) {
  return "level " + text(level) + ": samples" + texts(samples) + ", bricks" + texts(bricks) + "\n";
}

std::string codecText(std::uint32_t codec) {
  static const char* const names[] = {"stored", "constant", "absent", "lz4", "zstd"};
  return codec < 5 ? names[codec] : "?";
}

struct GoldenGrid {
  VoxelType type;
  const char* name;
  Index3 voxels;
};
constexpr GoldenGrid kGrids[] = {{VoxelType::kUint8, "u8", Index3(19, 7, 5)},
                                 {VoxelType::kInt8, "i8", Index3(22, 2, 9)},
                                 {VoxelType::kUint16, "u16", Index3(18, 9, 3)},
                                 {VoxelType::kInt16, "i16", Index3(27, 3, 4)},
                                 {VoxelType::kFloat32, "f32", Index3(20, 5, 6)}};
constexpr std::pair<format::Codec, const char*> kGoldenCodecs[] = {
    {format::Codec::kStored, "none"}, {format::Codec::kLz4, "lz4"}, {format::Codec::kZstd, "zstd"}};

}  // namespace

std::vector<GoldenPyramid> goldenPyramids() {
  std::vector<GoldenPyramid> result;
  for (const GoldenGrid& grid : kGrids)
    for (const auto& [codec, codec_name] : kGoldenCodecs) {
      GoldenPyramid golden;
      golden.voxel_type = grid.type;
      golden.voxels = grid.voxels;
      golden.options.brick_cells = 8;
      golden.options.tile_cells = 2;
      golden.options.codec = codec;
      golden.options.with_curvature = result.size() % 2 == 0;
      const bool subsamples = result.size() % 5 == 4;
      if (subsamples) golden.options.filter = format::Filter::kSubsample;
      golden.options.tool_version = "golden";
      golden.name = std::string(grid.name) + "-" + codec_name;
      result.push_back(golden);
    }
  const std::size_t u8_none = 0, f32_zstd = 14;
  for (const auto& [of, values] : {std::pair{u8_none, ValueTransform{1, -1000}},
                                   std::pair{f32_zstd, ValueTransform{0.5, 101325}}}) {
    GoldenPyramid golden = result[of];
    golden.name = "around-" + golden.name;
    golden.values = values;
    result.push_back(golden);
  }
  return result;
}

void buildGoldenPyramid(const GoldenPyramid& golden, const std::string& path) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 0.75, 2};
  geometry.origin = {-10, 20.5, 1500};
  geometry.direction = glm::dmat3(glm::dvec3(0, 1, 0), glm::dvec3(-1, 0, 0), glm::dvec3(0, 0, 1));
  if (golden.voxel_type != VoxelType::kInt8) geometry.unit = LengthUnit::kMillimetre;
  visitVoxelType(golden.voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    // 0 .. 240, as every type holds it in its own way.
    const auto voxel = [](const Index3& p) {
      const std::int64_t x = std::min<std::int64_t>(std::max<std::int64_t>(p.x - 10, 0), 7);
      const std::int64_t v = x == 0 ? 0 : 3 * x * x + p.y * p.y / 2 + 4 * p.z;
      if constexpr (std::is_same_v<T, std::int8_t>) return static_cast<T>(v - 120);
      if constexpr (std::is_same_v<T, std::uint16_t>) return static_cast<T>(250 * v);
      if constexpr (std::is_same_v<T, std::int16_t>) return static_cast<T>(130 * v - 15000);
      if constexpr (std::is_same_v<T, float>) return static_cast<float>(v) / 4 - 7.5f;
      return static_cast<T>(v);
    };
    ArraySource<T> source(golden.voxels, arrayOfField<T>(golden.voxels, voxel), geometry);
    source.editInfo().values = golden.values;
    buildPyramid(source, path, golden.options);
  });
}

std::string dumpOf(const PlainPyramid& pyramid) {
  std::string result = dumpOfHeader({pyramid.voxel_type,
                                     pyramid.filter,
                                     pyramid.brick_cells,
                                     pyramid.tile_cells,
                                     pyramid.has_curvature,
                                     pyramid.dims,
                                     pyramid.spacing,
                                     pyramid.origin,
                                     pyramid.direction,
                                     pyramid.length_unit,
                                     pyramid.value_min,
                                     pyramid.value_max,
                                     pyramid.curvature_epsilon,
                                     pyramid.noise,
                                     {pyramid.value_scale, pyramid.value_offset},
                                     {pyramid.histogram.begin(), pyramid.histogram.end()},
                                     pyramid.gradients});
  for (std::size_t l = 0; l < pyramid.levels.size(); ++l)
    result += dumpOfLevel(static_cast<int>(l), pyramid.levels[l].samples, pyramid.levels[l].bricks);
  for (const PlainBrick& brick : pyramid.bricks) {
    std::string parts;
    static const char* const kNames[] = {"samples", "tile ranges", "curvature"};
    for (std::size_t i = 0; i < 3; ++i)
      parts += std::string("  part ") + kNames[i] + ": " + codecText(brick.parts[i].codec) + ", " +
               text(brick.parts[i].stored_bytes) + " bytes at " + text(brick.parts[i].offset) +
               "\n";
    BrickValues values{brick.level,
                       brick.index,
                       brick.first_sample,
                       brick.count,
                       brick.range.min,
                       brick.range.max,
                       brick.samples,
                       {},
                       {}};
    for (const PlainRange& range : brick.tile_ranges) {
      values.ranges.push_back(range.min);
      values.ranges.push_back(range.max);
    }
    values.codes.assign(brick.codes.begin(), brick.codes.end());
    result += dumpOfBrick(values, parts);
  }
  return result;
}

std::string dumpOf(const Pyramid& pyramid) {
  const PyramidSpec& spec = pyramid.spec();
  const GridGeometry& geometry = spec.geometry;
  HeaderValues header;
  header.voxel_type = static_cast<std::uint32_t>(spec.voxel_type);
  header.filter = static_cast<std::uint32_t>(spec.filter);
  header.brick_cells = spec.brick_cells;
  header.tile_cells = spec.tile_cells;
  header.has_curvature = spec.has_curvature;
  header.dims = indexOf(spec.voxels);
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(axis);
    header.spacing[at] = geometry.spacing[axis];
    header.origin[at] = geometry.origin[axis];
    for (int row = 0; row < 3; ++row)
      header.direction[3 * at + static_cast<std::size_t>(row)] = geometry.direction[axis][row];
  }
  header.length_unit = static_cast<std::uint32_t>(geometry.unit);
  header.value_min = static_cast<double>(pyramid.valueRange().min);
  header.value_max = static_cast<double>(pyramid.valueRange().max);
  header.curvature_epsilon = spec.curvature_epsilon;
  header.noise = pyramid.noise();
  header.values = spec.values;
  const VoxelHistogram histogram = pyramid.histogram();
  header.histogram.assign(histogram.counts().begin(), histogram.counts().end());
  if (const auto gradients = pyramid.parts().tables().gradients())
    header.gradients = elementsOf(*gradients);
  std::string result = dumpOfHeader(header);
  const BrickLayout& layout = pyramid.layout();
  const int levels = pyramid.lattice().levels();
  for (int level = 0; level < levels; ++level)
    result += dumpOfLevel(level, indexOf(pyramid.lattice().samples(level)),
                          indexOf(layout.bricks(level)));
  for (int level = 0; level < levels; ++level) {
    const Index3 bricks = layout.bricks(level);
    for (std::int64_t i = 0; i < elementCount(bricks); ++i) {
      const Index3 index(i % bricks.x, i / bricks.x % bricks.y, i / bricks.x / bricks.y);
      const ValueRange range = pyramid.brickRange(level, index);
      const BrickSamples samples = pyramid.samples(level, index);
      BrickValues values{level,
                         indexOf(index),
                         indexOf(samples.box.first),
                         indexOf(samples.box.count),
                         static_cast<float>(range.min),
                         static_cast<float>(range.max),
                         {},
                         {},
                         {}};
      visitVoxelType(spec.voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        for (std::int64_t s = 0; s < samples.box.size(); ++s)
          values.samples.push_back(static_cast<float>(samples.data<T>()[s]));
      });
      std::vector<ValueRange> ranges;
      pyramid.tileRanges(level, index, ranges);
      for (const ValueRange& tile : ranges) {
        values.ranges.push_back(static_cast<float>(tile.min));
        values.ranges.push_back(static_cast<float>(tile.max));
      }
      std::vector<std::uint8_t> codes;
      if (level == 0) pyramid.parts().curvature(index, codes);
      values.codes.assign(codes.begin(), codes.end());
      result += dumpOfBrick(values, "");
    }
  }
  return result;
}

std::string withoutParts(const std::string& dump) {
  std::istringstream in(dump);
  std::string result;
  for (std::string line; std::getline(in, line);)
    if (!line.starts_with("  part")) result += line + "\n";
  return result;
}

}  // namespace isobrick::test
