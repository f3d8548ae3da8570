#include "isobrick/preprocess/phantoms/head_phantom.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <vector>

namespace isobrick {
namespace {

// A row of 3-D value noise: random values in [-1, 1] on a cubic lattice of `frequency` cells per
// unit length, interpolated with smoothsteps. The share of y and z is worked out once per row,
// so a sample costs one interpolation. at() depends on (seed, position) alone, not on the row.
class NoiseRow {
 public:
  // Covers x in [x_first, x_last], in the same units as y and z.
  NoiseRow(std::uint32_t seed, float frequency, float x_first, float x_last, float y, float z)
      : frequency_(frequency), first_cell_(cellOf(x_first * frequency)) {
    const std::int32_t last_cell = cellOf(x_last * frequency);
    const std::int32_t j = cellOf(y * frequency), k = cellOf(z * frequency);
    const float v = smoothstep(y * frequency - static_cast<float>(j));
    const float w = smoothstep(z * frequency - static_cast<float>(k));
    for (std::int32_t i = first_cell_; i <= last_cell + 1; ++i) {
      const float a = mix(corner(seed, i, j, k), corner(seed, i, j + 1, k), v);
      const float b = mix(corner(seed, i, j, k + 1), corner(seed, i, j + 1, k + 1), v);
      columns_.push_back(mix(a, b, w));
    }
  }

  float at(float x) const {
    const float scaled = x * frequency_;
    const std::int32_t i = cellOf(scaled);
    const float* column = columns_.data() + (i - first_cell_);
    return mix(column[0], column[1], smoothstep(scaled - static_cast<float>(i)));
  }

 private:
  // floor(), without the library call that plain x86-64 needs for it.
  static std::int32_t cellOf(float scaled) {
    const auto truncated = static_cast<std::int32_t>(scaled);
    return truncated - (scaled < static_cast<float>(truncated) ? 1 : 0);
  }
  static float smoothstep(float t) { return t * t * (3 - 2 * t); }
  static float mix(float a, float b, float t) { return a + (b - a) * t; }

  // Integer hash (after the finalizer of MurmurHash3) of a lattice point, as a value in [-1, 1].
  static float corner(std::uint32_t seed, std::int32_t i, std::int32_t j, std::int32_t k) {
    std::uint32_t h = seed + static_cast<std::uint32_t>(i) * 0x9e3779b1u +
                      static_cast<std::uint32_t>(j) * 0x85ebca77u +
                      static_cast<std::uint32_t>(k) * 0xc2b2ae3du;
    h ^= h >> 16;
    h *= 0x85ebca6bu;
    h ^= h >> 13;
    h *= 0xc2b2ae35u;
    h ^= h >> 16;
    return static_cast<float>(static_cast<std::int32_t>(h)) * 0x1p-31f;
  }

  float frequency_;
  std::int32_t first_cell_;
  std::vector<float> columns_;
};

constexpr float kSolid = -std::numeric_limits<float>::infinity();

// A layer of material around an ellipsoid: where inner <= distance <= outer, with the distance to
// the ellipsoid's surface positive outside. Layers are painted one over the other.
struct Layer {
  float center[3];
  float radii[3];
  float outer, inner;      // distances; kSolid as `inner` fills the ellipsoid
  float value;             // HU + 1024
  float texture = 0;       // amplitude of coarse noise added to the value
  float displacement = 0;  // amplitude of low noise added to the distance (folds of the brain)
  float front = 9;         // only where y < front ...
  float below = 9;         // ... and z < below
};

void addEllipsoid(std::vector<Layer>& layers, float x, float y, float z, float a, float b, float c,
                  float value, float texture = 0) {
  layers.push_back({{x, y, z}, {a, b, c}, 0, kSolid, value, texture});
}

// A cavity filled with air behind a wall of `thickness` (0.0078 is a voxel at 256^3).
void addCavity(std::vector<Layer>& layers, float x, float y, float z, float a, float b, float c,
               float thickness) {
  addEllipsoid(layers, x, y, z, a + thickness, b + thickness, c + thickness, 1750);
  addEllipsoid(layers, x, y, z, a, b, c, 12);
}

void addSkull(std::vector<Layer>& layers) {
  const auto shell = [&](float outer, float inner, float value, float texture = 0,
                         float displacement = 0) {
    layers.push_back(
        {{0, 0.04f, 0.14f}, {0.68f, 0.84f, 0.74f}, outer, inner, value, texture, displacement});
  };
  shell(0, kSolid, 1080);                  // skin
  shell(-0.016f, kSolid, 930, 20);         // fat under it
  shell(-0.034f, kSolid, 1075, 10);        // muscle and scalp
  shell(-0.046f, kSolid, 2350, 60);        // outer table: 1.5 voxels at 256^3
  shell(-0.058f, kSolid, 1520, 260);       // diploe
  shell(-0.084f, kSolid, 2250, 60);        // inner table: 1.3 voxels
  shell(-0.094f, kSolid, 1034);            // fluid
  shell(-0.106f, kSolid, 1064, 4, 0.02f);  // grey matter, folded
  shell(-0.145f, kSolid, 1052, 4, 0.03f);  // white matter
  // The falx: a thin sheet between the halves of the brain.
  addEllipsoid(layers, 0, 0.02f, 0.46f, 0.007f, 0.66f, 0.3f, 1085);
  for (const float side : {-1.0f, 1.0f}) {
    addEllipsoid(layers, side * 0.10f, -0.02f, 0.26f, 0.05f, 0.26f, 0.09f, 1032);  // ventricles
    addEllipsoid(layers, side * 0.17f, 0.18f, 0.17f, 0.05f, 0.12f, 0.08f, 1032);
    addEllipsoid(layers, side * 0.18f, -0.05f, 0.12f, 0.08f, 0.12f, 0.08f, 1066, 3);  // nuclei
    addEllipsoid(layers, side * 0.22f, 0.45f, -0.18f, 0.22f, 0.2f, 0.13f, 1062, 6);   // cerebellum
  }
}

void addFace(std::vector<Layer>& layers) {
  addEllipsoid(layers, 0, -0.16f, -0.44f, 0.465f, 0.645f, 0.495f, 1070, 12);  // face
  addEllipsoid(layers, 0, 0.16f, -0.80f, 0.40f, 0.42f, 0.55f, 1068, 12);      // neck
  addEllipsoid(layers, 0, -0.79f, -0.28f, 0.11f, 0.13f, 0.15f, 1060, 6);      // nose
  for (const float side : {-1.0f, 1.0f}) {
    addEllipsoid(layers, side * 0.66f, 0.08f, -0.10f, 0.05f, 0.12f, 0.16f, 1050, 6);    // ears
    addEllipsoid(layers, side * 0.36f, -0.42f, -0.30f, 0.13f, 0.10f, 0.06f, 1900, 90);  // cheeks
    // Petrous bone with air cells, mastoid.
    addEllipsoid(layers, side * 0.42f, 0.16f, -0.22f, 0.14f, 0.12f, 0.14f, 2100, 200);
    for (int i = 0; i < 12; ++i) {
      const float angle = 2.4f * static_cast<float>(i);
      const float reach = 0.028f * std::sqrt(static_cast<float>(i));
      addEllipsoid(layers, side * (0.47f + reach * std::cos(angle)),
                   0.18f + reach * std::sin(angle), -0.26f + 0.012f * static_cast<float>(i % 5),
                   0.018f, 0.018f, 0.022f, 20);
    }
    // Orbit: bone, fat, eye, lens, nerve.
    addEllipsoid(layers, side * 0.27f, -0.50f, -0.06f, 0.190f, 0.23f, 0.170f, 2000, 80);
    addEllipsoid(layers, side * 0.27f, -0.52f, -0.06f, 0.178f, 0.24f, 0.158f, 925, 10);
    addEllipsoid(layers, side * 0.27f, -0.60f, -0.06f, 0.115f, 0.115f, 0.115f, 1060);
    addEllipsoid(layers, side * 0.27f, -0.60f, -0.06f, 0.107f, 0.107f, 0.107f, 1035);
    addEllipsoid(layers, side * 0.27f, -0.685f, -0.06f, 0.045f, 0.02f, 0.045f, 1120);
    addEllipsoid(layers, side * 0.20f, -0.40f, -0.06f, 0.022f, 0.14f, 0.022f, 1065);
    // Maxillary and frontal sinuses behind walls of one to three voxels.
    addCavity(layers, side * 0.27f, -0.50f, -0.36f, 0.13f, 0.15f, 0.13f, 0.012f);
    addCavity(layers, side * 0.10f, -0.70f, 0.16f, 0.08f, 0.05f, 0.10f, 0.022f);
    // Ethmoid cells: thin-walled chambers between the orbits.
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 2; ++j)
        addCavity(layers, side * 0.045f, -0.62f + 0.085f * static_cast<float>(i),
                  -0.10f + 0.085f * static_cast<float>(j), 0.036f, 0.037f, 0.037f, 0.007f);
  }
  addCavity(layers, 0, -0.24f, -0.16f, 0.10f, 0.10f, 0.08f, 0.010f);  // sphenoid sinus
  // Nasal passage with septum and turbinates, throat, windpipe.
  addCavity(layers, 0, -0.52f, -0.34f, 0.11f, 0.26f, 0.12f, 0.009f);
  addEllipsoid(layers, 0, -0.26f, -0.52f, 0.08f, 0.07f, 0.30f, 14);
  addEllipsoid(layers, 0, -0.18f, -0.90f, 0.09f, 0.09f, 0.30f, 14);
  addEllipsoid(layers, 0, -0.52f, -0.34f, 0.007f, 0.25f, 0.12f, 1700);
  for (const float side : {-1.0f, 1.0f})
    for (int i = 0; i < 3; ++i)
      layers.push_back({{side * 0.055f, -0.50f, -0.27f - 0.055f * static_cast<float>(i)},
                        {0.030f, 0.16f, 0.022f},
                        0,
                        -0.009f,
                        1500,
                        60});
}

// Two arcs of teeth in a palate and a jaw.
void addJaws(std::vector<Layer>& layers) {
  // Jaw: a shell of cortical bone around marrow, open to the back and the top.
  for (const auto& [outer, inner, value, texture] :
       {std::array{0.0f, -0.075f, 2300.0f, 60.0f}, std::array{-0.014f, -0.061f, 1420.0f, 180.0f}})
    layers.push_back({{0, -0.22f, -0.56f},
                      {0.38f, 0.50f, 0.30f},
                      outer,
                      inner,
                      value,
                      texture,
                      0,
                      -0.08f,
                      -0.60f});
  addEllipsoid(layers, 0, -0.46f, -0.475f, 0.27f, 0.27f, 0.028f, 2000, 80);  // palate
  addEllipsoid(layers, 0, -0.42f, -0.62f, 0.17f, 0.24f, 0.10f, 1072, 14);    // tongue
  constexpr int kTeethPerArc = 14;
  for (int i = 0; i < kTeethPerArc; ++i) {
    const float angle = std::numbers::pi_v<float> * (static_cast<float>(i) + 0.5f) / kTeethPerArc;
    const float x = 0.25f * std::cos(angle);
    const float y = -0.40f - 0.30f * std::sin(angle);
    const float width = 0.024f + 0.010f * std::abs(std::cos(angle));
    for (const float z : {-0.535f, -0.635f}) {
      addEllipsoid(layers, x, y, z, width, width, 0.055f, 3150, 60);                    // enamel
      addEllipsoid(layers, x, y, z, width - 0.009f, width - 0.009f, 0.046f, 2500, 40);  // dentin
      addEllipsoid(layers, x, y, z, width - 0.020f, width - 0.020f, 0.030f, 1060);      // pulp
    }
  }
}

void addSpine(std::vector<Layer>& layers) {
  for (int i = 0; i < 4; ++i) {
    const float z = -0.46f - 0.16f * static_cast<float>(i);
    addEllipsoid(layers, 0, 0.20f, z, 0.15f, 0.12f, 0.068f, 2050, 60);
    addEllipsoid(layers, 0, 0.20f, z, 0.138f, 0.108f, 0.056f, 1380, 160);
    addEllipsoid(layers, 0, 0.40f, z, 0.14f, 0.10f, 0.05f, 1950, 80);
    addEllipsoid(layers, 0, 0.47f, z - 0.03f, 0.03f, 0.11f, 0.03f, 1850, 80);
  }
  addEllipsoid(layers, 0, 0.37f, -0.70f, 0.085f, 0.07f, 0.60f, 1034);  // canal
  addEllipsoid(layers, 0, 0.37f, -0.70f, 0.052f, 0.042f, 0.60f, 1060);
  addEllipsoid(layers, 0, 0.36f, -0.30f, 0.10f, 0.10f, 0.20f, 1060);  // brain stem
}

std::vector<Layer> makeLayers() {
  std::vector<Layer> layers;
  // The neck and the face come first: the skull covers their tops.
  addEllipsoid(layers, 0, 0.16f, -0.80f, 0.415f, 0.435f, 0.57f, 1080);
  addEllipsoid(layers, 0, -0.16f, -0.44f, 0.48f, 0.66f, 0.51f, 1080);
  addSkull(layers);
  addFace(layers);
  addSpine(layers);
  addJaws(layers);
  return layers;
}

// How much of the material a voxel at `distance` from its surface holds, 0 .. 1.
inline float coverage(float distance, float inverse_width) {
  return std::clamp(0.5f - distance * inverse_width, 0.0f, 1.0f);
}

// Where a layer can matter in a row: the x range of the ellipsoid grown by its reach, or none.
struct Reach {
  float first = 0, last = -1;
};

Reach reachOf(const Layer& layer, float qy, float qz, float margin) {
  // The distance below is (q - 1) / (2 sqrt(g)) with q / most^2 <= g <= q / least^2, so that
  // distance < d implies sqrt(q) < m + sqrt(m^2 + 1) with m = d over the least (d > 0) or the
  // greatest radius.
  const float d = layer.outer + margin;
  const float radius = d > 0 ? std::min({layer.radii[0], layer.radii[1], layer.radii[2]})
                             : std::max({layer.radii[0], layer.radii[1], layer.radii[2]});
  const float m = d / radius;
  const float most = m + std::sqrt(m * m + 1);
  const float rest = most * most - qy - qz;
  if (rest <= 0) return {};
  const float half = layer.radii[0] * std::sqrt(rest);
  return {layer.center[0] - half, layer.center[0] + half};
}

// Blends the layer into values[begin, end). The distance to the ellipsoid is that of the first
// order: (q - 1) / |grad q| with q = sum of ((x - center) / radius)^2, exact at the surface.
void paint(const Layer& layer, const float* x, const float* coarse, const float* folds, float y,
           float z, float inverse_width, std::size_t begin, std::size_t end, float* values) {
  const float ty = (y - layer.center[1]) / layer.radii[1];
  const float tz = (z - layer.center[2]) / layer.radii[2];
  const float q_rest = ty * ty + tz * tz - 1;
  const float gy = ty / layer.radii[1], gz = tz / layer.radii[2];
  const float g_rest = gy * gy + gz * gz;
  const float inverse_radius = 1 / layer.radii[0];
  // Near the centre the gradient vanishes; the distance there is at least that of the axes.
  constexpr float kLeastGradient = 1e-3f;
  for (std::size_t i = begin; i < end; ++i) {
    const float tx = (x[i] - layer.center[0]) * inverse_radius;
    const float gx = tx * inverse_radius;
    const float gradient = 2 * std::sqrt(gx * gx + g_rest);
    const float distance =
        (tx * tx + q_rest) / std::max(gradient, kLeastGradient) + layer.displacement * folds[i];
    const float share = coverage(distance - layer.outer, inverse_width) *
                        coverage(layer.inner - distance, inverse_width);
    values[i] += share * (layer.value + layer.texture * coarse[i] - values[i]);
  }
}

}  // namespace

void headPhantomRow(std::span<const float> x, float y, float z, float voxel, float* out) {
  static const std::vector<Layer> layers = makeLayers();
  // Cells per unit length: grain of two voxels at 256^3, marrow, and the folds of the brain.
  constexpr float kGrainFrequency = 64, kCoarseFrequency = 26, kFoldFrequency = 9;
  const std::size_t n = x.size();
  const NoiseRow grain_noise(0x1234567u, kGrainFrequency, x.front(), x.back(), y, z);
  const NoiseRow coarse_noise(0x89abcdeu, kCoarseFrequency, x.front(), x.back(), y, z);
  const NoiseRow fold_noise(0xf012345u, kFoldFrequency, x.front(), x.back(), y, z);
  // One buffer per thread: rows are made by the hundred thousand.
  thread_local std::vector<float> noise;
  noise.resize(2 * n);
  float* const coarse = noise.data();
  float* const folds = noise.data() + n;
  for (std::size_t i = 0; i < n; ++i) {
    coarse[i] = coarse_noise.at(x[i]);
    folds[i] = fold_noise.at(x[i]);
  }

  constexpr float kAir = 12;
  std::fill(out, out + n, kAir);
  const float inverse_width = 1 / (1.5f * voxel);
  for (const Layer& layer : layers) {
    if (y > layer.front || z > layer.below) continue;
    const float ty = (y - layer.center[1]) / layer.radii[1];
    const float tz = (z - layer.center[2]) / layer.radii[2];
    const Reach reach = reachOf(layer, ty * ty, tz * tz, voxel + layer.displacement);
    if (reach.first > reach.last) continue;
    const auto begin = std::lower_bound(x.begin(), x.end(), reach.first) - x.begin();
    const auto end = std::upper_bound(x.begin(), x.end(), reach.last) - x.begin();
    paint(layer, x.data(), coarse, folds, y, z, inverse_width, static_cast<std::size_t>(begin),
          static_cast<std::size_t>(end), out);
  }
  // Noise is stronger in tissue than in air, where a scanner's values are cut at 0.
  for (std::size_t i = 0; i < n; ++i) {
    const float amplitude = 12 + 24 * std::min(1.0f, out[i] * 0.001f);
    out[i] += amplitude * grain_noise.at(x[i]);
  }
}

}  // namespace isobrick
