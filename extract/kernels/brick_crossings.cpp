#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/brick_crossings.cpp"
#include "isobrick/extract/kernels/brick_crossings.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <bit>
#include <cstring>
#include <limits>
#include <type_traits>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/storage/voxel_type.h"

// The corner of an edge in 32 bits: i, j and k in 9 bits each, the greatest being 256.
#ifndef ISOBRICK_EXTRACT_PACKED_CORNER
#define ISOBRICK_EXTRACT_PACKED_CORNER
namespace isobrick {
inline constexpr int kCornerBits = 9;
static_assert(kMaxBrickCells < (1 << kCornerBits));
inline std::uint32_t packCorner(std::int64_t i, std::int64_t j, std::int64_t k) {
  return static_cast<std::uint32_t>(i | j << kCornerBits | k << (2 * kCornerBits));
}
inline Index3 unpackCorner(std::uint32_t packed) {
  constexpr std::uint32_t kMask = (1u << kCornerBits) - 1;
  return Index3(packed & kMask, packed >> kCornerBits & kMask, packed >> (2 * kCornerBits));
}
}  // namespace isobrick
#endif

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using FloatTag = hn::ScalableTag<float>;
using IntTag = hn::RebindToSigned<FloatTag>;
using Floats = hn::Vec<FloatTag>;
using Ints = hn::Vec<IntTag>;
constexpr std::size_t kMostLanes = hn::MaxLanes(FloatTag());

// 32 bits of each lane from the byte offset in it.
HWY_INLINE Ints gatherBytes(const void* base, Ints byte_offsets) {
  const IntTag d;
#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
  return hn::GatherOffset(d, static_cast<const std::int32_t*>(base), byte_offsets);
#else
  HWY_ALIGN std::int32_t at[kMostLanes];
  HWY_ALIGN std::int32_t got[kMostLanes];
  hn::Store(byte_offsets, d, at);
  for (std::size_t i = 0; i < hn::Lanes(d); ++i)
    std::memcpy(&got[i], static_cast<const char*>(base) + at[i], 4);
  return hn::Load(d, got);
#endif
}

// Field `kIndex` of the fields of kBits bits in each lane, as an integer.
template <int kBits, int kIndex, bool kSigned>
HWY_INLINE Ints field(Ints words) {
  if constexpr (kBits * (kIndex + 1) == 32) {
    if constexpr (kSigned) {
      return hn::ShiftRight<32 - kBits>(words);
    } else {
      const hn::RebindToUnsigned<IntTag> du;
      return hn::BitCast(IntTag(), hn::ShiftRight<32 - kBits>(hn::BitCast(du, words)));
    }
  } else if constexpr (kSigned) {
    return hn::ShiftRight<32 - kBits>(hn::ShiftLeft<32 - kBits - kBits * kIndex>(words));
  } else {
    const auto mask = hn::Set(IntTag(), (1 << kBits) - 1);
    if constexpr (kIndex == 0) return hn::And(words, mask);
    return hn::And(hn::ShiftRight<kBits * kIndex>(words), mask);
  }
}

// Voxels around many places at once. Offsets are elements from the first sample. It reads only
// between the requested samples, or before them.
template <typename T>
struct VoxelLanes {
  using Values = Ints;
  static constexpr bool kSigned = std::is_signed_v<T>;
  static constexpr int kBits = 8 * sizeof(T);
  const T* data;

  static Floats toFloat(Values v) { return hn::ConvertTo(FloatTag(), v); }
  static Floats difference(Values a, Values b) { return toFloat(hn::Sub(a, b)); }
  HWY_INLINE Ints words(Ints offset) const {
    if constexpr (sizeof(T) == 2) offset = hn::ShiftLeft<1>(offset);
    return gatherBytes(data, offset);
  }
  static HWY_INLINE Ints plus(Ints offset, std::int32_t n) {
    return hn::Add(offset, hn::Set(IntTag(), n));
  }

  HWY_INLINE Values one(Ints offset) const {
    constexpr int kBefore = 32 / kBits - 1;
    return field<kBits, kBefore, kSigned>(words(plus(offset, -kBefore)));
  }
  // offset, offset + 1
  HWY_INLINE void two(Ints offset, Values& a, Values& b) const {
    constexpr int kBefore = 32 / kBits - 2;
    const Ints w = words(kBefore == 0 ? offset : plus(offset, -kBefore));
    a = field<kBits, kBefore, kSigned>(w);
    b = field<kBits, kBefore + 1, kSigned>(w);
  }
  // offset - 1, offset, offset + 1
  HWY_INLINE void three(Ints offset, Values& a, Values& b, Values& c) const {
    if constexpr (sizeof(T) == 1) {
      const Ints w = words(plus(offset, -2));
      a = field<8, 1, kSigned>(w);
      b = field<8, 2, kSigned>(w);
      c = field<8, 3, kSigned>(w);
    } else {
      two(plus(offset, -1), a, b);
      c = one(plus(offset, 1));
    }
  }
  // offset - 1 .. offset + 2
  HWY_INLINE void four(Ints offset, Values& a, Values& b, Values& c, Values& d) const {
    if constexpr (sizeof(T) == 1) {
      const Ints w = words(plus(offset, -1));
      a = field<8, 0, kSigned>(w);
      b = field<8, 1, kSigned>(w);
      c = field<8, 2, kSigned>(w);
      d = field<8, 3, kSigned>(w);
    } else {
      two(plus(offset, -1), a, b);
      two(plus(offset, 1), c, d);
    }
  }
};

template <>
struct VoxelLanes<float> {
  using Values = Floats;
  const float* data;

  static Floats toFloat(Values v) { return v; }
  static Floats difference(Values a, Values b) { return hn::Sub(a, b); }
  static HWY_INLINE Ints plus(Ints offset, std::int32_t n) {
    return hn::Add(offset, hn::Set(IntTag(), n));
  }
  HWY_INLINE Values one(Ints offset) const {
    return hn::BitCast(FloatTag(), gatherBytes(data, hn::ShiftLeft<2>(offset)));
  }
  HWY_INLINE void two(Ints offset, Values& a, Values& b) const {
    a = one(offset);
    b = one(plus(offset, 1));
  }
  HWY_INLINE void three(Ints offset, Values& a, Values& b, Values& c) const {
    a = one(plus(offset, -1));
    two(offset, b, c);
  }
  HWY_INLINE void four(Ints offset, Values& a, Values& b, Values& c, Values& d) const {
    two(plus(offset, -1), a, b);
    two(plus(offset, 1), c, d);
  }
};

// x, y, z of every lane in turn.
HWY_INLINE void storeTriples(Floats x, Floats y, Floats z, float* out) {
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
  // 16 and more: from the second operand.
  alignas(64) static constexpr std::int32_t kXy[3][16] = {
      {0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5},
      {21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26},
      {0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0}};
  alignas(64) static constexpr std::int32_t kZ[3][16] = {
      {0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15},
      {0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15},
      {26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31}};
  for (int v = 0; v < 3; ++v) {
    const __m512 xy = _mm512_permutex2var_ps(x.raw, _mm512_load_si512(kXy[v]), y.raw);
    _mm512_storeu_ps(out + 16 * v, _mm512_permutex2var_ps(xy, _mm512_load_si512(kZ[v]), z.raw));
  }
#else
  hn::StoreInterleaved3(x, y, z, FloatTag(), out);
#endif
}

// Appends base + i for every set bit i of a word; may write up to 64 elements from `out` on.
HWY_INLINE std::uint32_t* appendBits(std::uint64_t bits, std::uint32_t base, std::uint32_t* out) {
#if HWY_TARGET == HWY_AVX3_DL
  alignas(64) static constexpr std::uint8_t kIota[64] = {
      0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21,
      22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40, 41, 42, 43,
      44, 45, 46, 47, 48, 49, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60, 61, 62, 63};
  const __m512i indices = _mm512_maskz_compress_epi8(bits, _mm512_load_si512(kIota));
  const __m512i bases = _mm512_set1_epi32(static_cast<int>(base));
  const int count = std::popcount(bits);
  _mm512_storeu_si512(
      out, _mm512_add_epi32(bases, _mm512_cvtepu8_epi32(_mm512_castsi512_si128(indices))));
  if (HWY_UNLIKELY(count > 16)) {
    _mm512_storeu_si512(
        out + 16,
        _mm512_add_epi32(bases, _mm512_cvtepu8_epi32(_mm512_extracti32x4_epi32(indices, 1))));
    _mm512_storeu_si512(
        out + 32,
        _mm512_add_epi32(bases, _mm512_cvtepu8_epi32(_mm512_extracti32x4_epi32(indices, 2))));
    _mm512_storeu_si512(
        out + 48,
        _mm512_add_epi32(bases, _mm512_cvtepu8_epi32(_mm512_extracti32x4_epi32(indices, 3))));
  }
  return out + count;
#else
  for (; bits != 0; bits &= bits - 1)
    *out++ = base + static_cast<std::uint32_t>(std::countr_zero(bits));
  return out;
#endif
}

// Makes the crossings of one axis, as many at once as a vector has lanes.
template <typename T, int kAxis>
class CrossingMaker {
 public:
  CrossingMaker(const BrickGrid<T>& grid, const BrickRows& rows, const CornerSpacing& spacing,
                const WorldFrame& frame, float isovalue)
      : grid_(grid), rows_(rows), spacing_(spacing), frame_(frame), isovalue_(isovalue) {
    lanes_.data = grid.data;
    stride_[0] = 1;
    stride_[1] = static_cast<std::int32_t>(grid.stored.x);
    stride_[2] = static_cast<std::int32_t>(grid.stored.x * grid.stored.y);
    first_offset_ = static_cast<std::int32_t>(
        (grid.inset.z * grid.stored.y + grid.inset.y) * grid.stored.x + grid.inset.x);
    // A difference over two steps; for integers it is part of the matrix, which changes no bit.
    const float step = 0.5f / spacing.voxels;
    difference_factor_ = std::is_floating_point_v<T> ? step : 1.0f;
    for (int i = 0; i < 9; ++i)
      matrix_[i] =
          std::is_floating_point_v<T> ? frame.normalMatrix()[i] : frame.normalMatrix()[i] * step;
    has_irregular_ = false;
    lanes_usable_ = true;
    for (int axis = 0; axis < 3; ++axis) {
      low_[axis] = static_cast<std::int32_t>(spacing.regular_first[axis]);
      high_[axis] = static_cast<std::int32_t>(spacing.regular_end[axis]) - (axis == kAxis ? 1 : 0);
      has_irregular_ = has_irregular_ || spacing.regular_first[axis] > 0 ||
                       spacing.regular_end[axis] <= rows.cells[axis];
      lanes_usable_ = lanes_usable_ && high_[axis] > low_[axis] && grid.stored[axis] >= 4;
    }
    safe_offset_ = first_offset_ + low_[0] + low_[1] * stride_[1] + low_[2] * stride_[2];
  }

  // Returns the ends of the written elements.
  void run(float*& positions, float*& normals) {
    positions_ = positions;
    normals_ = normals;
    const std::int64_t slice = rows_.rowsPerSlice(), words = rows_.words_per_row;
    const bool own_first = kAxis != 0 && (rows_.foreign_sides & 1) == 0;
    for (const std::uint32_t r : rows_.crossed_rows[kAxis].list()) {
      const std::int64_t k = r / slice, j = r % slice;
      if (rows_.isForeign(kAxis, j, k)) continue;
      if constexpr (kAxis != 0)
        if (own_first) append(rows_.crossed_first[kAxis - 1][r], packCorner(0, j, k));
      const std::uint64_t* crossed = rows_.crossed[kAxis].data() + r * words;
      for (std::int64_t w = 0; w < words; ++w)
        append(crossed[w], packCorner(64 * w + (kAxis == 0 ? 0 : 1), j, k));
      if (waiting_ >= kFlushAt) flush();
    }
    finish();
    positions = positions_;
    normals = normals_;
  }

 private:
  static constexpr std::size_t kFlushAt = 512;

  HWY_INLINE void append(std::uint64_t bits, std::uint32_t base) {
    waiting_ = static_cast<std::size_t>(appendBits(bits, base, queue_ + waiting_) - queue_);
  }

  // Makes whole vectors of the waiting edges and moves the rest to the front.
  HWY_NOINLINE void flush() {
    const std::size_t lanes = hn::Lanes(FloatTag());
    std::size_t done = 0;
    for (; done + lanes <= waiting_; done += lanes) {
      makeVector(queue_ + done, positions_, normals_);
      positions_ += 3 * lanes;
      normals_ += 3 * lanes;
    }
    waiting_ -= done;
    std::memmove(queue_, queue_ + done, 4 * waiting_);
  }
  // The last ones, fewer than a vector: made as a whole one, aside.
  void finish() {
    flush();
    const std::size_t count = waiting_;
    if (count == 0) return;
    HWY_ALIGN float positions[3 * kMostLanes];
    HWY_ALIGN float normals[3 * kMostLanes];
    float* const to_positions = positions_;
    float* const to_normals = normals_;
    positions_ = positions;
    normals_ = normals;
    while (waiting_ < hn::Lanes(FloatTag())) queue_[waiting_++] = queue_[0];
    flush();
    std::memcpy(to_positions, positions, 12 * count);
    std::memcpy(to_normals, normals, 12 * count);
    positions_ = to_positions + 3 * count;
    normals_ = to_normals + 3 * count;
  }

  HWY_INLINE void makeVector(const std::uint32_t* corners, float* positions, float* normals) {
    const std::size_t lanes = hn::Lanes(FloatTag());
    if (HWY_UNLIKELY(!lanes_usable_)) {
      for (std::size_t i = 0; i < lanes; ++i)
        makeOne(corners[i], positions + 3 * i, normals + 3 * i);
      return;
    }
    const FloatTag df;
    const IntTag di;
    const hn::RebindToUnsigned<IntTag> du;
    const auto packed = hn::LoadU(du, corners);
    const auto mask = hn::Set(di, (1 << kCornerBits) - 1);
    const Ints x = hn::And(hn::BitCast(di, packed), mask);
    const Ints y = hn::And(hn::BitCast(di, hn::ShiftRight<kCornerBits>(packed)), mask);
    const Ints z = hn::BitCast(di, hn::ShiftRight<2 * kCornerBits>(packed));
    Ints at =
        hn::Add(hn::Add(x, hn::Set(di, first_offset_)),
                hn::Add(hn::Mul(y, hn::Set(di, stride_[1])), hn::Mul(z, hn::Set(di, stride_[2]))));
    auto bad = hn::MaskFromVec(hn::Zero(df));
    if (has_irregular_) {
      const auto beyond = [&](Ints v, int axis) {
        return hn::Or(hn::Lt(v, hn::Set(di, low_[axis])), hn::Gt(v, hn::Set(di, high_[axis] - 1)));
      };
      const auto irregular = hn::Or(hn::Or(beyond(x, 0), beyond(y, 1)), beyond(z, 2));
      at = hn::IfThenElse(irregular, hn::Set(di, safe_offset_), at);
      bad = hn::RebindMask(df, irregular);
    }

    using V = typename VoxelLanes<T>::Values;
    const auto diff = [](V a, V b) { return VoxelLanes<T>::difference(a, b); };
    const auto offset = [&](std::int32_t n) { return hn::Add(at, hn::Set(di, n)); };
    Floats gl[3], gh[3];  // differences at the low and the high end
    V low, high;
    if constexpr (kAxis == 0) {
      V before, after;
      lanes_.four(at, before, low, high, after);
      gl[0] = diff(high, before);
      gh[0] = diff(after, low);
      for (int axis = 1; axis < 3; ++axis) {
        V up0, up1, down0, down1;
        lanes_.two(offset(stride_[axis]), up0, up1);
        lanes_.two(offset(-stride_[axis]), down0, down1);
        gl[axis] = diff(up0, down0);
        gh[axis] = diff(up1, down1);
      }
    } else {
      constexpr int kOther = 3 - kAxis;
      const std::int32_t along = stride_[kAxis], other = stride_[kOther];
      V left, right;
      lanes_.three(at, left, low, right);
      gl[0] = diff(right, left);
      lanes_.three(offset(along), left, high, right);
      gh[0] = diff(right, left);
      gl[kAxis] = diff(high, lanes_.one(offset(-along)));
      gh[kAxis] = diff(lanes_.one(offset(2 * along)), low);
      gl[kOther] = diff(lanes_.one(offset(other)), lanes_.one(offset(-other)));
      gh[kOther] = diff(lanes_.one(offset(along + other)), lanes_.one(offset(along - other)));
    }

    // crossingParameter()
    const Floats a = VoxelLanes<T>::toFloat(low), b = VoxelLanes<T>::toFloat(high);
    const auto one = hn::Set(df, 1.0f);
    const Floats across = hn::Sub(b, a);
    Floats t = hn::Div(hn::Sub(hn::Set(df, isovalue_), a), across);
    if constexpr (std::is_floating_point_v<T>)  // crossingParameter() halves the values
      bad = hn::Or(bad, hn::Gt(hn::Abs(across), hn::Set(df, std::numeric_limits<float>::max())));
    const auto least = hn::Set(df, kLeastCrossing), most = hn::Set(df, 1.0f - kLeastCrossing);
    t = hn::IfThenElse(hn::Gt(t, least), t, least);
    t = hn::IfThenElse(hn::Lt(t, most), t, most);
    const auto rounder = hn::Set(df, kCrossingRounder);
    t = hn::Sub(hn::Add(t, rounder), rounder);
    const Floats s = hn::Sub(one, t);

    // crossingCoordinate()
    const Ints corner[3] = {x, y, z};
    Floats p[3];
    const auto voxels = hn::Set(df, spacing_.voxels);
    for (int axis = 0; axis < 3; ++axis) {
      const float first = spacing_.first_coordinate[static_cast<std::size_t>(axis)] +
                          (axis == kAxis ? spacing_.voxels : 0.0f);
      p[axis] = hn::Add(hn::Mul(hn::ConvertTo(df, corner[axis]), voxels), hn::Set(df, first));
    }
    p[kAxis] = hn::Sub(p[kAxis], hn::Mul(s, voxels));
    storeTriples(p[0], p[1], p[2], positions);

    // gradientAt() and WorldFrame::normal()
    Floats g[3];
    for (int axis = 0; axis < 3; ++axis) {
      if constexpr (std::is_floating_point_v<T>) {
        const auto factor = hn::Set(df, difference_factor_);
        gl[axis] = hn::Mul(gl[axis], factor);
        gh[axis] = hn::Mul(gh[axis], factor);
      }
      g[axis] = hn::Add(hn::Mul(gl[axis], s), hn::Mul(gh[axis], t));
    }
    Floats n[3];
    for (int row = 0; row < 3; ++row) {
      if (frame_.isDiagonal()) {
        n[row] = hn::Mul(hn::Set(df, matrix_[4 * row]), g[row]);
      } else {
        n[row] = hn::Add(hn::Add(hn::Mul(hn::Set(df, matrix_[3 * row]), g[0]),
                                 hn::Mul(hn::Set(df, matrix_[3 * row + 1]), g[1])),
                         hn::Mul(hn::Set(df, matrix_[3 * row + 2]), g[2]));
      }
    }
    const Floats square =
        hn::Add(hn::Add(hn::Mul(n[0], n[0]), hn::Mul(n[1], n[1])), hn::Mul(n[2], n[2]));
    const Floats factor = hn::Div(hn::Set(df, -1.0f), hn::Sqrt(square));
    storeTriples(hn::Mul(n[0], factor), hn::Mul(n[1], factor), hn::Mul(n[2], factor), normals);

    const auto good = hn::And(hn::Ge(square, hn::Set(df, WorldFrame::kLeastSquare)),
                              hn::Lt(square, hn::Set(df, std::numeric_limits<float>::infinity())));
    bad = hn::Or(bad, hn::Not(good));
    if (HWY_UNLIKELY(!hn::AllFalse(df, bad))) {
      std::uint8_t bits[8] = {};
      hn::StoreMaskBits(df, bad, bits);
      std::uint32_t rest = bits[0] | static_cast<std::uint32_t>(bits[1] << 8);
      rest &= static_cast<std::uint32_t>(lowBits(static_cast<std::int64_t>(lanes)));
      for (; rest != 0; rest &= rest - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(rest));
        makeOne(corners[i], positions + 3 * i, normals + 3 * i);
      }
    }
  }

  HWY_NOINLINE void makeOne(std::uint32_t packed, float* position, float* normal) const {
    const Crossing made =
        makeCrossing(grid_, spacing_, frame_, isovalue_, kAxis, unpackCorner(packed));
    std::memcpy(position, &made.position, 12);
    std::memcpy(normal, &made.normal, 12);
  }

  const BrickGrid<T>& grid_;
  const BrickRows& rows_;
  const CornerSpacing& spacing_;
  const WorldFrame& frame_;
  const float isovalue_;
  VoxelLanes<T> lanes_;
  std::int32_t stride_[3];
  std::int32_t first_offset_, safe_offset_;
  std::int32_t low_[3], high_[3];  // regular corners of this axis' edges
  float difference_factor_;
  float matrix_[9];
  bool has_irregular_, lanes_usable_;
  float* positions_ = nullptr;
  float* normals_ = nullptr;
  std::size_t waiting_ = 0;
  HWY_ALIGN std::uint32_t queue_[kFlushAt + kMaxBrickCells + 2 * 64];
};

template <typename T>
void makeAll(const BrickGrid<T>& grid, const BrickRows& rows, const CornerSpacing& spacing,
             const WorldFrame& frame, float isovalue, float* positions, float* normals) {
  CrossingMaker<T, 0>(grid, rows, spacing, frame, isovalue).run(positions, normals);
  CrossingMaker<T, 1>(grid, rows, spacing, frame, isovalue).run(positions, normals);
  CrossingMaker<T, 2>(grid, rows, spacing, frame, isovalue).run(positions, normals);
}

// Highway dispatches functions, not templates, so this is one for all voxel types: `grid` is a
// BrickGrid<T>.
void makeCrossingsOfType(VoxelType type, const void* grid, const BrickRows& rows,
                         const CornerSpacing& spacing, const WorldFrame& frame, float isovalue,
                         float* positions, float* normals) {
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    makeAll(*static_cast<const BrickGrid<T>*>(grid), rows, spacing, frame, isovalue, positions,
            normals);
  });
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

void CornerSpacing::set(const Lattice& lattice, int level, const IndexBox& cells,
                        const IndexBox& samples) {
  const std::int64_t step = std::int64_t{1} << level;
  voxels = static_cast<float>(step);
  origin = brickOrigin(lattice, level, cells);
  for (int axis = 0; axis < 3; ++axis) {
    const auto position = [&](std::int64_t i) { return lattice.position(level, axis, i); };
    auto& all = corners[static_cast<std::size_t>(axis)];
    all.resize(static_cast<std::size_t>(cells.count[axis]) + 1);
    first_coordinate[static_cast<std::size_t>(axis)] =
        static_cast<float>(cells.first[axis] * step - origin[axis]);
    regular_first[axis] = regular_end[axis] = 0;
    for (std::int64_t i = 0; i <= cells.count[axis]; ++i) {
      const std::int64_t sample = cells.first[axis] + i;
      const std::int64_t low = sample > samples.first[axis] ? -1 : 0;
      const std::int64_t high = sample + 1 < samples.first[axis] + samples.count[axis] ? 1 : 0;
      const std::int64_t distance = position(sample + high) - position(sample + low);
      all[static_cast<std::size_t>(i)] = {
          static_cast<float>(position(sample) - origin[axis]), static_cast<float>(distance),
          static_cast<std::int8_t>(low), static_cast<std::int8_t>(high)};
      if (low < 0 && high > 0 && distance == 2 * step) {
        if (regular_end[axis] == 0) regular_first[axis] = i;
        regular_end[axis] = i + 1;
      }
    }
  }
}

template <typename T>
Crossing makeCrossing(const BrickGrid<T>& grid, const CornerSpacing& spacing,
                      const WorldFrame& frame, float isovalue, int axis, const Index3& corner) {
  const std::int64_t stride[3] = {1, grid.stored.x, grid.stored.x * grid.stored.y};
  const T* at = grid.row(corner.y, corner.z) + corner.x;
  const auto cornerOf = [&](int a, std::int64_t i) -> const CornerSpacing::Corner& {
    return spacing.corners[static_cast<std::size_t>(a)][static_cast<std::size_t>(i)];
  };
  const auto gradient = [&](const T* sample, const Index3& of) {
    glm::vec3 g;
    for (int a = 0; a < 3; ++a) {
      const CornerSpacing::Corner& c = cornerOf(a, of[a]);
      g[a] = (static_cast<float>(sample[c.high * stride[a]]) -
              static_cast<float>(sample[c.low * stride[a]])) /
             c.distance;
    }
    return g;
  };
  Index3 next = corner;
  ++next[axis];
  const auto low = static_cast<float>(*at);
  const auto high = static_cast<float>(at[stride[axis]]);
  const float t = crossingParameter(isovalue, low, high);
  Crossing made;
  for (int a = 0; a < 3; ++a) made.position[a] = cornerOf(a, corner[a]).coordinate;
  const float end = cornerOf(axis, next[axis]).coordinate;
  made.position[axis] = crossingCoordinate(end, end - made.position[axis], t);
  made.normal = frame.normal(gradientAt(gradient(at, corner), gradient(at + stride[axis], next), t),
                             axis, low >= isovalue);
  return made;
}

HWY_EXPORT(makeCrossingsOfType);

template <typename T>
void makeCrossings(const BrickGrid<T>& grid, const BrickRows& rows, const CornerSpacing& spacing,
                   const WorldFrame& frame, float isovalue, float* positions, float* normals) {
  HWY_DYNAMIC_DISPATCH(makeCrossingsOfType)
  (voxelTypeOf<T>(), &grid, rows, spacing, frame, isovalue, positions, normals);
}

#define ISOBRICK_INSTANTIATE(T)                                                                   \
  template Crossing makeCrossing<T>(const BrickGrid<T>&, const CornerSpacing&, const WorldFrame&, \
                                    float, int, const Index3&);                                   \
  template void makeCrossings<T>(const BrickGrid<T>&, const BrickRows&, const CornerSpacing&,     \
                                 const WorldFrame&, float, float*, float*);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
#endif
