#include "isobrick/preprocess/written_bricks.h"

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

template <typename T>
WrittenBricks<T>::WrittenBricks(const PyramidSpec& spec, const PyramidWriter& writer,
                                std::uint64_t budget_bytes)
    : layout_(spec.layout()), writer_(writer), kept_(budget_bytes) {
  std::uint64_t rows = 0;
  for (int level = 0; level < layout_.lattice().levels(); ++level) {
    first_rows_.push_back(rows);
    rows += static_cast<std::uint64_t>(elementCount(layout_.bricks(level)));
  }
}

template <typename T>
std::uint64_t WrittenBricks<T>::row(int level, const Index3& brick) const {
  return first_rows_[static_cast<std::size_t>(level)] +
         static_cast<std::uint64_t>(linearIndex(brick, layout_.bricks(level)));
}

template <typename T>
typename WrittenBricks<T>::Samples WrittenBricks<T>::samples(int level, const Index3& brick) {
  const std::uint64_t number = row(level, brick);
  if (Samples known = kept_.find(number)) return known;
  auto read = std::make_shared<std::vector<T>>(
      static_cast<std::size_t>(layout_.brickSampleBox(level, brick).size()));
  const std::size_t bytes = read->size() * sizeof(T);
  writer_.readPart(number, PartKind::kSamples, bytes, reinterpret_cast<std::byte*>(read->data()));
  kept_.add(number, read);
  return read;
}

template <typename T>
void WrittenBricks<T>::read(int level, const IndexBox& box, float* out) {
  const Index3 most = layout_.bricks(level) - Index3(1);
  const Index3 first = glm::min(box.first / layout_.brickCells(), most);
  const Index3 last = glm::min((box.end() - Index3(1)) / layout_.brickCells(), most);
  forEachIndex({first, last - first + Index3(1)}, [&](const Index3& brick) {
    const Samples from = samples(level, brick);
    const IndexBox has = layout_.brickSampleBox(level, brick);
    const IndexBox own = layout_.brickOwnSamples(level, brick);
    const Index3 begin = glm::max(box.first, own.first), end = glm::min(box.end(), own.end());
    copyBox(SampleBlock<T>::dense(from->data(), has), {begin, end - begin}, out, box);
  });
}

template <typename T>
std::vector<ValueRange> WrittenBricks<T>::tileRanges(int level, const Index3& brick) const {
  std::vector<T> pairs(
      static_cast<std::size_t>(2 * elementCount(layout_.brickTiles(level, brick))));
  writer_.readPart(row(level, brick), PartKind::kRanges, pairs.size() * sizeof(T),
                   reinterpret_cast<std::byte*>(pairs.data()));
  std::vector<ValueRange> ranges;
  for (std::size_t i = 0; i < pairs.size(); i += 2)
    ranges.push_back({static_cast<float>(pairs[i]), static_cast<float>(pairs[i + 1])});
  return ranges;
}

#define ISOBRICK_INSTANTIATE(T) template class WrittenBricks<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
