#include "isobrick/preprocess/hand_over.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

namespace isobrick {
namespace {

void addBox(const ScratchVolume& volume, ByteSequenceWriter& bytes) {
  std::vector<std::byte> elements(static_cast<std::size_t>(volume.box().size()) *
                                  volume.elementBytes());
  volume.read(volume.box(), elements.data());
  bytes.add(std::span<const std::byte>(elements));
}

// False if the bytes are not so many finite numbers.
template <typename T>
bool takeBox(ByteSequenceReader& bytes, const IndexBox& box, ScratchVolume& volume) {
  const auto elements = bytes.take<std::byte>();
  if (!bytes.isSound() || elements.size() != static_cast<std::size_t>(box.size()) * sizeof(T))
    return false;
  if constexpr (std::is_same_v<T, float>) {
    const auto* const values = reinterpret_cast<const float*>(elements.data());
    if (!std::all_of(values, values + box.size(), [](float v) { return std::isfinite(v); }))
      return false;
  }
  volume.write(box, elements.data());
  return true;
}

}  // namespace

std::vector<std::byte> handOverOf(const HandOverFacts& facts, const LevelStore& passed_on,
                                  const VoxelStatistics& statistics) {
  ByteSequenceWriter bytes;
  const auto codec = static_cast<std::uint32_t>(facts.codec);
  const float range[] = {facts.voxel_range.min, facts.voxel_range.max};
  bytes.add(std::span<const std::uint32_t>(&codec, 1));
  bytes.add(std::span<const float>(range));
  addBox(passed_on.samples, bytes);
  addBox(passed_on.finer_tiles, bytes);
  statistics.writeTo(bytes);
  return bytes.take();
}

template <typename T>
bool takeHandOver(std::span<const std::byte> all, const PyramidSpec& spec,
                  const BuildRegion& region, HandOverFacts& facts, LevelStore& store,
                  VoxelStatistics& statistics) {
  ByteSequenceReader bytes(all);
  const auto codec = bytes.take<std::uint32_t>();
  const auto range = bytes.take<float>();
  if (!bytes.isSound() || codec.size() != 1 || range.size() != 2 || !(range[0] <= range[1]) ||
      !std::isfinite(range[0]) || !std::isfinite(range[1]))
    return false;
  facts.codec = static_cast<format::Codec>(codec[0]);
  if (facts.codec != format::Codec::kStored && facts.codec != format::Codec::kLz4 &&
      facts.codec != format::Codec::kZstd)
    return false;
  const auto isVoxel = [](float value) {
    using Limits = std::numeric_limits<T>;
    return value >= static_cast<float>(Limits::lowest()) &&
           value <= static_cast<float>(Limits::max()) &&
           static_cast<float>(static_cast<T>(value)) == value;
  };
  if (!isVoxel(range[0]) || !isVoxel(range[1])) return false;
  facts.voxel_range = {range[0], range[1]};
  const int last = region.endLevel() - 1;
  return takeBox<T>(bytes, region.passedSamples(last), store.samples) &&
         takeBox<T>(bytes, tilePairs(region.passedTiles(last)), store.finer_tiles) &&
         statistics.include(spec.voxel_type, bytes) && bytes.isAtEnd();
}

#define ISOBRICK_INSTANTIATE(T)                                                  \
  template bool takeHandOver<T>(std::span<const std::byte>, const PyramidSpec&,  \
                                const BuildRegion&, HandOverFacts&, LevelStore&, \
                                VoxelStatistics&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
