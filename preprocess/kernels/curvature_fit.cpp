// How a row of nodes is fitted, sixteen (or as many as a SIMD vector has lanes) side by side.
//
// Which samples. The eight cells of a node have 160 corners and midpoints of edges, but only 81
// places: 27 voxels and 54 midpoints. All cells agree on the value v at a place that they share,
// and raising p several times at one v, to k_1 .. k_n, is the same as raising it once, to the
// greatest of them. So each place takes the greatest curvature of its cells (up to eight at a
// voxel, four at a midpoint) and there are 81 updates.
//
// Derivatives. All of them are sums of two things computed once a node: differences along edges and
// mixed differences of faces. At a corner of a cell the derivatives are those of the corner's edges
// and faces. At the midpoint of an edge the derivative along it is the edge's difference, the two
// across are means of the parallel edges at its ends, the mixed ones with the edge's axis are those
// of its two faces, and the third is the mean of the two faces at its ends. Curvature does not
// change when all derivatives are doubled, so at midpoints sums stand for means.
//
// Rounding. Only + - * / min max and comparisons are used, each rounded once and in a fixed order
// (the build forbids contraction), so that every machine writes the same file. u = 2^-24.
// - The values are scaled by a power of two, which is exact, to a range W in [1/2, 1] (up to 8 for
//   ranges above 2^125, because the scale must be a normal number). A gradient that counts is at
//   least W * 2^-16, so its sixth power is at least 2^-102: nothing that matters underflows.
// - With t = v - low and u = high - v, each rounded once, the basis functions u^2, 2tu, t^2 have a
//   relative error of a few u even if they nearly vanish, and so have p and the update, which
//   add up positive terms only. They are W^2 times the Bernstein polynomials; coefficients get that
//   factor at the end, so no division by W is needed. At midpoints t and u are sums too.
// - k = (mean^2 + g2 s / 2) / g2^3 has mixed signs in mean and s; with h2 = fxy^2 + fxz^2 + fyz^2
//   the rounding of the numerator is at most 12 u g2^2 h2, since mean and s have terms of at
//   most g2 h and g2 h2. kSlack, twice 12 u, times the h2 of the sample is added to it, or rather
//   times 4 sum of the squared mixed differences of the cell's six faces, which is no less at any
//   of its samples, the doubled ones included.
// - Integer voxels have exact derivatives. Differences of others are rounded, which changes the
//   square root of k by some e of about 2^-22 (1 + h / |g|). With (s + e)^2 <= (1 + 2^-14) s^2 +
//   (1 + 2^14) e^2 this is covered by kMargin, kSlack and kInexactDifferences.
#include "isobrick/preprocess/kernels/curvature_fit.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstddef>
#include <limits>

#include "isobrick/storage/curvature_code.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/preprocess/kernels/curvature_fit.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#ifndef ISOBRICK_CURVATURE_FIT_ONCE
#define ISOBRICK_CURVATURE_FIT_ONCE
namespace isobrick {
namespace {

// Vectors are at most this wide.
constexpr std::size_t kMostLanes = 16;

// See "Rounding" above.
constexpr float kMargin = 1.0f + 1e-4f;
constexpr float kSlack = 0x1p-19f;
constexpr float kInexactDifferences = 0x1p-30f;
// A gradient counts when it is epsilon times the range or a rounding less.
constexpr double kEpsilonRounding = 1 - 1e-6;
// Below every threshold on scaled values, above 0: no sample without a gradient counts.
constexpr float kLeastGradientSquared = 0x1p-36f;

struct FitConstants {
  float epsilon;          // rounded down
  float absolute_margin;  // added to the coefficients
};

}  // namespace
}  // namespace isobrick
#endif

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::CappedTag<float, kMostLanes>;
using Ints = hn::RebindToSigned<Floats>;
using Vector = hn::Vec<Floats>;
constexpr Floats kFloats;
constexpr std::size_t kLanes = hn::MaxLanes(Floats());

Vector splat(float value) { return hn::Set(kFloats, value); }

// One vector for each voxel of the 3x3x3 block; element (x, y, z) at x + 3 y + 9 z.
class Block {
 public:
  Vector operator[](std::size_t i) const { return hn::Load(kFloats, values_ + i * kLanes); }
  void set(std::size_t i, Vector value) { hn::Store(value, kFloats, values_ + i * kLanes); }

 private:
  alignas(4 * kMostLanes) float values_[27 * kLanes];
};
constexpr std::size_t kStride[3] = {1, 3, 9};

// The values that the samples of kLanes nodes are made of. Edges, faces and cells are at their
// lowest voxel; the elements of a block that have no edge, face or cell are not set.
struct NodeBlocks {
  Block t, u;      // the value above the range's low end and below its high one
  Block edge[3];   // difference along the axis
  Block mixed[3];  // mixed difference of the face across the axis
  Block slack;     // of the cell: see "Rounding"
};

// The polynomials of kLanes nodes.
struct Polynomial {
  Vector b0, b1, b2;

  // Makes p(v) >= k; t and u need not be of the unit that other samples have.
  void raise(Vector t, Vector u, Vector k) {
    const Vector basis0 = u * u, basis1 = (t + t) * u, basis2 = t * t;
    const Vector norm = (basis0 * basis0 + basis1 * basis1) + basis2 * basis2;
    // Not delta / norm: only terms that depend on p are in the chain from update to update.
    const Vector inverse = splat(1.0f) / norm;
    const Vector p = (b0 * basis0 + b1 * basis1) + b2 * basis2;
    const Vector step = hn::Max(k - p, hn::Zero(kFloats)) * inverse;
    b0 = b0 + step * basis0;
    b1 = b1 + step * basis1;
    b2 = b2 + step * basis2;
  }
};

struct Jet {
  Vector fx, fy, fz, fxy, fxz, fyz;
  Vector slack;  // at least kSlack * (fxy^2 + fxz^2 + fyz^2)
};

// Twice the total curvature; 0 if the squared gradient is below `least`.
HWY_INLINE Vector twiceCurvature(const Jet& j, Vector least) {
  const Vector g2 = j.fx * j.fx + (j.fy * j.fy + j.fz * j.fz);
  const Vector a = j.fx * j.fyz, b = j.fy * j.fxz, c = j.fz * j.fxy;
  const Vector mean = (j.fy * j.fz) * j.fyz + j.fx * (j.fy * j.fxy + j.fz * j.fxz);
  // a^2 + b^2 + c^2 - 2 (ab + ac + bc)
  const Vector e = (a + b) - c;
  const Vector s = e * e - splat(4.0f) * (a * b);
  const Vector numerator = (mean + mean) * mean + g2 * (s + g2 * j.slack);
  return hn::IfThenElseZero(hn::Ge(g2, least), numerator / ((g2 * g2) * g2));
}

// Along an axis, a node has two outer places, 0 and 2, each in one cell, and an inner one, 1, in
// both cells. The first of its cells is place / 2.
constexpr std::size_t firstPlace(bool inner) { return inner ? 1 : 0; }
constexpr std::size_t cellsAtPlace(bool inner) { return inner ? 2 : 1; }

// The voxels that are inner or outer ones along x, y and z by the arguments: so that the number of
// cells is known at compile time.
template <bool InnerX, bool InnerY, bool InnerZ>
HWY_INLINE void raiseAtVoxels(const NodeBlocks& n, Vector least, Polynomial& p) {
  for (std::size_t z = firstPlace(InnerZ); z < 3; z += 2)
    for (std::size_t y = firstPlace(InnerY); y < 3; y += 2)
      for (std::size_t x = firstPlace(InnerX); x < 3; x += 2) {
        Vector k = hn::Zero(kFloats);
        for (std::size_t cz = z / 2; cz < z / 2 + cellsAtPlace(InnerZ); ++cz)
          for (std::size_t cy = y / 2; cy < y / 2 + cellsAtPlace(InnerY); ++cy)
            for (std::size_t cx = x / 2; cx < x / 2 + cellsAtPlace(InnerX); ++cx) {
              const std::size_t xy = cx + 3 * cy + 9 * z, xz = cx + 3 * y + 9 * cz,
                                yz = x + 3 * cy + 9 * cz;
              const Jet jet = {n.edge[0][cx + 3 * y + 9 * z],
                               n.edge[1][x + 3 * cy + 9 * z],
                               n.edge[2][x + 3 * y + 9 * cz],
                               n.mixed[2][xy],
                               n.mixed[1][xz],
                               n.mixed[0][yz],
                               n.slack[cx + 3 * cy + 9 * cz]};
              k = hn::Max(k, twiceCurvature(jet, least));
            }
        const std::size_t voxel = x + 3 * y + 9 * z;
        p.raise(n.t[voxel], n.u[voxel], k);
      }
}

// The midpoints of the edges along axis A that are inner or outer ones along U and V, the others.
template <std::size_t A, std::size_t U, std::size_t V, bool InnerU, bool InnerV>
HWY_INLINE void raiseAtMidpoints(const NodeBlocks& n, Vector least, Polynomial& p) {
  constexpr std::size_t a = kStride[A], u = kStride[U], v = kStride[V];
  const Vector least_doubled = splat(4.0f) * least;
  for (std::size_t at_v = firstPlace(InnerV); at_v < 3; at_v += 2)
    for (std::size_t at_u = firstPlace(InnerU); at_u < 3; at_u += 2)
      for (std::size_t at_a = 0; at_a < 2; ++at_a) {
        const std::size_t edge = at_a * a + at_u * u + at_v * v;
        const Vector along = n.edge[A][edge];
        Vector k = hn::Zero(kFloats);
        for (std::size_t cv = at_v / 2; cv < at_v / 2 + cellsAtPlace(InnerV); ++cv)
          for (std::size_t cu = at_u / 2; cu < at_u / 2 + cellsAtPlace(InnerU); ++cu) {
            const std::size_t au = at_a * a + cu * u + at_v * v, av = at_a * a + at_u * u + cv * v,
                              uv = at_a * a + cu * u + cv * v;
            const Vector mixed_au = n.mixed[V][au], mixed_av = n.mixed[U][av];
            const Jet jet = {along + along,
                             n.edge[U][au] + n.edge[U][au + a],
                             n.edge[V][av] + n.edge[V][av + a],
                             mixed_au + mixed_au,
                             mixed_av + mixed_av,
                             n.mixed[A][uv] + n.mixed[A][uv + a],
                             n.slack[uv]};
            k = hn::Max(k, twiceCurvature(jet, least_doubled));
          }
        // Sums for means again: the basis is of degree 2.
        p.raise(n.t[edge] + n.t[edge + a], n.u[edge] + n.u[edge + a], splat(4.0f) * k);
      }
}
template <std::size_t A, std::size_t U, std::size_t V>
void raiseAtMidpointsAlong(const NodeBlocks& n, Vector least, Polynomial& p) {
  raiseAtMidpoints<A, U, V, false, false>(n, least, p);
  raiseAtMidpoints<A, U, V, true, false>(n, least, p);
  raiseAtMidpoints<A, U, V, false, true>(n, least, p);
  raiseAtMidpoints<A, U, V, true, true>(n, least, p);
}

HWY_NOINLINE void raiseAtAllPlaces(const NodeBlocks& n, Vector least, Polynomial& p) {
  raiseAtVoxels<false, false, false>(n, least, p);
  raiseAtVoxels<true, false, false>(n, least, p);
  raiseAtVoxels<false, true, false>(n, least, p);
  raiseAtVoxels<true, true, false>(n, least, p);
  raiseAtVoxels<false, false, true>(n, least, p);
  raiseAtVoxels<true, false, true>(n, least, p);
  raiseAtVoxels<false, true, true>(n, least, p);
  raiseAtVoxels<true, true, true>(n, least, p);
  raiseAtMidpointsAlong<0, 1, 2>(n, least, p);
  raiseAtMidpointsAlong<1, 0, 2>(n, least, p);
  raiseAtMidpointsAlong<2, 0, 1>(n, least, p);
}

// The block's differences, for which `values` are scaled.
template <std::size_t Axis>
void setDifferences(const Block& values, Block& result) {
  for (std::size_t z = 0; z < (Axis == 2 ? 2 : 3); ++z)
    for (std::size_t y = 0; y < (Axis == 1 ? 2 : 3); ++y)
      for (std::size_t x = 0; x < (Axis == 0 ? 2 : 3); ++x) {
        const std::size_t i = x + 3 * y + 9 * z;
        result.set(i, values[i + kStride[Axis]] - values[i]);
      }
}
// Faces across axis Across, which have V as their second axis; `edges` are along their first.
template <std::size_t Across, std::size_t V>
void setMixedDifferences(const Block& edges, Block& result) {
  for (std::size_t z = 0; z < (Across == 2 ? 3 : 2); ++z)
    for (std::size_t y = 0; y < (Across == 1 ? 3 : 2); ++y)
      for (std::size_t x = 0; x < (Across == 0 ? 3 : 2); ++x) {
        const std::size_t i = x + 3 * y + 9 * z;
        result.set(i, edges[i + kStride[V]] - edges[i]);
      }
}
void setSlack(NodeBlocks& n) {
  for (std::size_t z = 0; z < 2; ++z)
    for (std::size_t y = 0; y < 2; ++y)
      for (std::size_t x = 0; x < 2; ++x) {
        const std::size_t i = x + 3 * y + 9 * z;
        Vector sum = hn::Zero(kFloats);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const Vector lower = n.mixed[axis][i], upper = n.mixed[axis][i + kStride[axis]];
          sum = sum + (lower * lower + upper * upper);
        }
        n.slack.set(i, splat(4 * kSlack) * sum);
      }
}

void setDerivatives(const Block& voxels, NodeBlocks& n) {
  setDifferences<0>(voxels, n.edge[0]);
  setDifferences<1>(voxels, n.edge[1]);
  setDifferences<2>(voxels, n.edge[2]);
  setMixedDifferences<0, 2>(n.edge[1], n.mixed[0]);
  setMixedDifferences<1, 2>(n.edge[0], n.mixed[1]);
  setMixedDifferences<2, 1>(n.edge[0], n.mixed[2]);
  setSlack(n);
}

// Reads the voxels of the nodes from `first` on.
void loadVoxels(const CurvatureRow& row, std::size_t first, Block& voxels) {
  for (std::size_t i = 0; i < 9; ++i) {
    const float* from = row.voxels[i].data() + 2 * first;
    Vector left, middle, right, next_middle;
    hn::LoadInterleaved2(kFloats, from, left, middle);
    hn::LoadInterleaved2(kFloats, from + 2, right, next_middle);
    voxels.set(3 * i, left);
    voxels.set(3 * i + 1, middle);
    voxels.set(3 * i + 2, right);
  }
}

// The power of two that takes ranges to [1/2, 1], or 2^-126 if that is greater; `quarter` is a
// fourth of the range's width, which does not overflow.
Vector scaleOfRange(Vector quarter) {
  constexpr Ints ints;
  const auto exponent = hn::And(hn::BitCast(ints, quarter), hn::Set(ints, 0x7F800000));
  const auto clamped = hn::Min(exponent, hn::Set(ints, 250 << 23));
  return hn::BitCast(kFloats, hn::Set(ints, 251 << 23) - clamped);
}

void fitNodes(const FitConstants& constants, std::size_t first, CurvatureRow& row) {
  Block voxels;
  loadVoxels(row, first, voxels);
  Vector least_voxel = voxels[0], greatest_voxel = voxels[0];
  for (std::size_t i = 1; i < 27; ++i) {
    least_voxel = hn::Min(least_voxel, voxels[i]);
    greatest_voxel = hn::Max(greatest_voxel, voxels[i]);
  }
  const Vector low = hn::LoadU(kFloats, row.low.data() + first);
  const Vector high = hn::LoadU(kFloats, row.high.data() + first);
  const Vector quarter = splat(0.25f) * high - splat(0.25f) * low;
  const auto known = hn::And(hn::Ge(quarter, splat(kLeastCurvatureRange / 4)),
                             hn::Le(quarter, splat(std::numeric_limits<float>::max())));
  const Vector scale = hn::IfThenElseZero(known, scaleOfRange(quarter));

  NodeBlocks n;
  Vector sum = hn::Zero(kFloats);
  const Vector scaled_low = low * scale, scaled_high = high * scale;
  for (std::size_t i = 0; i < 27; ++i) {
    const Vector value = voxels[i] * scale;
    voxels.set(i, value);
    n.t.set(i, value - scaled_low);
    n.u.set(i, scaled_high - value);
    sum = sum + n.t[i];
  }
  // False for NaN and infinity, which no other value becomes.
  const auto finite = hn::Le(hn::Abs(sum), splat(0x1p100f));

  const Vector width = scaled_high - scaled_low;
  const Vector threshold = splat(constants.epsilon) * width;
  const Vector least = hn::Max(threshold * threshold, splat(kLeastGradientSquared));
  // No difference is greater than this, so no squared gradient than three times its square.
  const Vector reach = greatest_voxel * scale - least_voxel * scale;
  const Vector reach2 = reach * reach;
  const auto counts = hn::Ge(reach2 + (reach2 + reach2), least);

  Polynomial p = {hn::Zero(kFloats), hn::Zero(kFloats), hn::Zero(kFloats)};
  if (!hn::AllFalse(kFloats, counts)) {
    setDerivatives(voxels, n);
    raiseAtAllPlaces(n, least, p);
  }

  const Vector factor = (width * width) * splat(kMargin / 2);
  const Vector margin = hn::IfThenElseZero(counts, splat(constants.absolute_margin));
  const auto one_value = hn::Eq(least_voxel, greatest_voxel);
  const Vector infinity = splat(std::numeric_limits<float>::infinity());
  const auto finish = [&](Vector b, std::vector<float>& to) {
    b = hn::IfThenElse(known, b * factor + margin, infinity);
    b = hn::IfThenElse(finite, hn::IfThenZeroElse(one_value, b), infinity);
    hn::StoreU(b, kFloats, to.data() + first);
  };
  finish(p.b0, row.coefficients[0]);
  finish(p.b1, row.coefficients[1]);
  finish(p.b2, row.coefficients[2]);
}

void fitRow(const FitConstants& constants, CurvatureRow& row) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(row.nodes); i += kLanes)
    fitNodes(constants, i, row);
}

// CurvatureCode::encodeUp, by the bits of the coefficients.
hn::Vec<Ints> encodeUp(Vector coefficient) {
  constexpr Ints ints;
  const auto bits = hn::BitCast(ints, coefficient);
  const auto mantissa = hn::And(bits, hn::Set(ints, 0x7FFFFF));
  const auto exponent = hn::ShiftRight<23>(bits) - hn::Set(ints, 127);
  auto code = hn::ShiftLeft<3>(exponent) + hn::Set(ints, CurvatureCode::kCodeOfOne);
  for (const float step : CurvatureCode::kOctave) {
    const auto threshold = hn::Set(ints, std::bit_cast<std::int32_t>(step) & 0x7FFFFF);
    code = code - hn::VecFromMask(ints, hn::Gt(mantissa, threshold));
  }
  code = hn::Min(hn::Max(code, hn::Set(ints, 1)), hn::Set(ints, 255));
  return hn::IfThenElseZero(hn::Gt(bits, hn::Zero(ints)), code);
}

void encodeRow(const CurvatureRow& row, std::uint8_t* codes) {
  static_assert(CurvatureCode::kStepsPerOctave == 8);
  const auto nodes = static_cast<std::size_t>(row.nodes);
  for (std::size_t first = 0; first < nodes; first += kLanes) {
    alignas(4 * kMostLanes) std::int32_t part[3][kLanes];
    for (std::size_t j = 0; j < 3; ++j)
      hn::Store(encodeUp(hn::LoadU(kFloats, row.coefficients[j].data() + first)), Ints(), part[j]);
    const std::size_t count = std::min(kLanes, nodes - first);
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t j = 0; j < 3; ++j) *codes++ = static_cast<std::uint8_t>(part[j][i]);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {
namespace {

HWY_EXPORT(fitRow);
HWY_EXPORT(encodeRow);

}  // namespace

CurvatureRow::CurvatureRow(std::int64_t node_count) : nodes(node_count) {
  const std::size_t padded =
      (static_cast<std::size_t>(nodes) + kMostLanes - 1) / kMostLanes * kMostLanes;
  // The right voxels are loaded together with the middle ones of the next nodes.
  for (std::vector<float>& v : voxels) v.resize(2 * padded + 2);
  low.resize(padded);
  high.resize(padded);
  for (std::vector<float>& b : coefficients) b.resize(padded);
}

void fitCurvature(const CurvatureFitOptions& options, CurvatureRow& row) {
  assert(options.epsilon >= kLeastCurvatureEpsilon);
  HWY_DYNAMIC_DISPATCH(fitRow)
  ({static_cast<float>(options.epsilon * kEpsilonRounding),
    options.small_integers ? 0.0f : kInexactDifferences},
   row);
}

void encodeCurvature(const CurvatureRow& row, std::uint8_t* codes) {
  HWY_DYNAMIC_DISPATCH(encodeRow)(row, codes);
}

}  // namespace isobrick
#endif
