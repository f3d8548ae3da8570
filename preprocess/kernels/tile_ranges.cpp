#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/preprocess/kernels/tile_ranges.cpp"
#include "isobrick/preprocess/kernels/tile_ranges.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <algorithm>
#include <limits>
#include <type_traits>
#include <vector>

#include "isobrick/storage/voxel_type.h"

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// min[x] and max[x] of `rows` rows, element by element; a row of `low` and one of `high` each.
template <typename T>
void minMaxOfRows(const T* low, const T* high, std::int64_t rows, std::int64_t stride,
                  std::int64_t count, T* min, T* max) {
  const hn::ScalableTag<T> d;
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(d));
  const auto vectorAt = [&](std::int64_t x) {
    auto least = hn::LoadU(d, low + x), greatest = hn::LoadU(d, high + x);
    for (std::int64_t r = 1; r < rows; ++r) {
      least = hn::Min(least, hn::LoadU(d, low + r * stride + x));
      greatest = hn::Max(greatest, hn::LoadU(d, high + r * stride + x));
    }
    hn::StoreU(least, d, min + x);
    hn::StoreU(greatest, d, max + x);
  };
  if (count >= lanes) {
    for (std::int64_t x = 0; x + lanes < count; x += lanes) vectorAt(x);
    vectorAt(count - lanes);  // overlaps the one before
    return;
  }
  for (std::int64_t x = 0; x < count; ++x) {
    T least = low[x], greatest = high[x];
    for (std::int64_t r = 1; r < rows; ++r) {
      least = std::min(least, low[r * stride + x]);
      greatest = std::max(greatest, high[r * stride + x]);
    }
    min[x] = least;
    max[x] = greatest;
  }
}

// Axis by axis: z, then y, then x, so that a sample is read little more than once.
template <typename T>
void includeCubes(const SampleBlock<T>& samples, const IndexBox& cells, std::int64_t edge,
                  CubeRanges<T>& ranges) {
  const SampleBlock<T> block = samples.part({cells.first, cells.count + Index3(1)});
  const std::int64_t width = cells.count.x + 1, height = cells.count.y + 1;
  thread_local std::vector<T> z_min, z_max, y_min, y_max;
  z_min.resize(static_cast<std::size_t>(width * height));
  z_max.resize(z_min.size());
  y_min.resize(static_cast<std::size_t>(width));
  y_max.resize(y_min.size());
  // Samples of the closed interval number `i` along an axis of `count` cells.
  const auto samplesOf = [&](std::int64_t i, std::int64_t count) {
    return std::min(edge, count - i * edge) + 1;
  };
  std::size_t cube = 0;
  for (std::int64_t tz = 0; tz < ranges.dims.z; ++tz) {
    for (std::int64_t y = 0; y < height; ++y) {
      const T* const row = block.data + tz * edge * block.slice_stride + y * block.row_stride;
      minMaxOfRows(row, row, samplesOf(tz, cells.count.z), block.slice_stride, width,
                   z_min.data() + y * width, z_max.data() + y * width);
    }
    for (std::int64_t ty = 0; ty < ranges.dims.y; ++ty) {
      minMaxOfRows(z_min.data() + ty * edge * width, z_max.data() + ty * edge * width,
                   samplesOf(ty, cells.count.y), width, width, y_min.data(), y_max.data());
      for (std::int64_t tx = 0; tx < ranges.dims.x; ++tx, ++cube) {
        const std::int64_t first = tx * edge, end = first + samplesOf(tx, cells.count.x);
        T least = ranges.min[cube], greatest = ranges.max[cube];
        for (std::int64_t x = first; x < end; ++x) {
          least = std::min(least, y_min[static_cast<std::size_t>(x)]);
          greatest = std::max(greatest, y_max[static_cast<std::size_t>(x)]);
        }
        ranges.min[cube] = least;
        ranges.max[cube] = greatest;
      }
    }
  }
}

// In the order of memory.
template <typename T>
void rangeOfRows(const SampleBlock<T>& samples, T& least, T& greatest) {
  const hn::ScalableTag<T> d;
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(d));
  const std::int64_t count = samples.box.count.x;
  least = greatest = *samples.data;
  auto min = hn::Set(d, least), max = min;
  for (std::int64_t z = 0; z < samples.box.count.z; ++z)
    for (std::int64_t y = 0; y < samples.box.count.y; ++y) {
      const T* const row = samples.data + z * samples.slice_stride + y * samples.row_stride;
      if (count < lanes) {
        for (std::int64_t x = 0; x < count; ++x) {
          least = std::min(least, row[x]);
          greatest = std::max(greatest, row[x]);
        }
        continue;
      }
      for (std::int64_t x = 0;; x = std::min(x + lanes, count - lanes)) {
        const auto v = hn::LoadU(d, row + x);
        min = hn::Min(min, v);
        max = hn::Max(max, v);
        if (x == count - lanes) break;  // which overlaps the one before
      }
    }
  std::vector<T> ends(2 * static_cast<std::size_t>(lanes));
  hn::StoreU(min, d, ends.data());
  hn::StoreU(max, d, ends.data() + lanes);
  least = std::min(least, *std::min_element(ends.begin(), ends.begin() + lanes));
  greatest = std::max(greatest, *std::max_element(ends.begin() + lanes, ends.end()));
}

// `samples` is a SampleBlock<T>, `range` two T.
void rangeOfType(VoxelType type, const void* samples, void* range) {
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    T* const ends = static_cast<T*>(range);
    rangeOfRows<T>(*static_cast<const SampleBlock<T>*>(samples), ends[0], ends[1]);
  });
}

// Highway dispatches functions, not templates, so this is one for all voxel types: `samples` is a
// SampleBlock<T>, `ranges` a CubeRanges<T>.
void includeCubesOfType(VoxelType type, const void* samples, const IndexBox& cells,
                        std::int64_t edge, void* ranges) {
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    includeCubes<T>(*static_cast<const SampleBlock<T>*>(samples), cells, edge,
                    *static_cast<CubeRanges<T>*>(ranges));
  });
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

template <typename T>
void CubeRanges<T>::reset(const Index3& new_dims) {
  dims = new_dims;
  const auto count = static_cast<std::size_t>(elementCount(dims));
  min.assign(count, std::numeric_limits<T>::max());
  max.assign(count, std::numeric_limits<T>::lowest());
}

HWY_EXPORT(includeCubesOfType);
HWY_EXPORT(rangeOfType);

template <typename T>
ValueRange rangeOfBlock(const SampleBlock<T>& samples) {
  T range[2];
  HWY_DYNAMIC_DISPATCH(rangeOfType)(voxelTypeOf<T>(), &samples, range);
  return {static_cast<float>(range[0]) + 0.0f, static_cast<float>(range[1]) + 0.0f};
}

namespace {

// Ends of a range are found one after the other, each with a number that cannot be it in the place
// of NaN.
void includeCubesWithMissing(const SampleBlock<float>& samples, const IndexBox& cells,
                             std::int64_t edge, CubeRanges<float>& ranges) {
  const IndexBox box{cells.first, cells.count + Index3(1)};
  std::vector<float> dense(static_cast<std::size_t>(box.size()));
  copyBox(samples, box, dense.data(), box);
  const bool is_any = std::any_of(dense.begin(), dense.end(), [](float v) { return v != v; });
  if (!is_any) return includeClosedCubes(samples, cells, edge, ranges);
  CubeRanges<float> ends = ranges;
  for (auto member : {&CubeRanges<float>::min, &CubeRanges<float>::max}) {
    const float neutral = member == &CubeRanges<float>::min ? std::numeric_limits<float>::max()
                                                            : std::numeric_limits<float>::lowest();
    copyBox(samples, box, dense.data(), box);
    std::replace_if(
        dense.begin(), dense.end(), [](float v) { return v != v; }, neutral);
    includeClosedCubes(SampleBlock<float>::dense(dense.data(), box), cells, edge, ends);
    ranges.*member = ends.*member;
    ends = ranges;
  }
}

}  // namespace

template <typename T>
void includeClosedCubes(const SampleBlock<T>& samples, const IndexBox& cells, std::int64_t edge,
                        CubeRanges<T>& ranges, bool has_missing) {
  if constexpr (std::is_same_v<T, float>)
    if (has_missing) return includeCubesWithMissing(samples, cells, edge, ranges);
  HWY_DYNAMIC_DISPATCH(includeCubesOfType)(voxelTypeOf<T>(), &samples, cells, edge, &ranges);
}

#define ISOBRICK_INSTANTIATE(T)                                                             \
  template struct CubeRanges<T>;                                                            \
  template ValueRange rangeOfBlock<T>(const SampleBlock<T>&);                               \
  template void includeClosedCubes<T>(const SampleBlock<T>&, const IndexBox&, std::int64_t, \
                                      CubeRanges<T>&, bool);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
#endif
