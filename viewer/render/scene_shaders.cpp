#include "isobrick/viewer/render/scene_shaders.h"

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

constexpr char kVersion[] = "#version 450 core\n";
constexpr char kWithWireframe[] = "#define WIREFRAME\n";
constexpr char kInShadow[] = "#define IN_SHADOW\n";
constexpr char kAsLayers[] = "#define AS_LAYERS\n";

// Eye coordinates: the eye at the origin, +x right, +y up, -z ahead. All light is linear.
constexpr char kProjection[] = R"(
uniform vec4 projection;  // x and y scale, depth scale and offset
uniform bool orthographic;
uniform vec4 clip_planes[6];
uniform int clip_count;
uniform vec2 half_picture;  // pixels
uniform vec2 port_middle;   // of the viewport, pixels from the middle of the picture
uniform float half_port;    // pixels, a power of two
out float gl_ClipDistance[6];

// A card keeps places to 1/256 of a pixel. They are rounded to that here, in the whole picture, so
// that every tile of it gets the same ones. Behind the eye, or far outside, there are none.
void project(vec3 place) {
  float w = orthographic ? 1.0 : -place.z;
  precise vec2 across = projection.xy * place.xy * half_picture;
  if (w > 0.0 && all(lessThan(abs(across), vec2(1048576.0 * w)))) {
    precise vec2 pixel = round(across / w * 256.0) / 256.0;
    gl_Position.xy = (pixel - port_middle) / half_port * w;
  } else {
    gl_Position.xy = (across - port_middle * w) / half_port;
  }
  gl_Position.zw = vec2(projection.z * place.z + projection.w, w);
  for (int i = 0; i < 6; ++i)
    gl_ClipDistance[i] = i < clip_count ? dot(clip_planes[i].xyz, place) + clip_planes[i].w : 1.0;
}
)";

// For fragments that go into lists (LayerPass) instead of into the picture. A layer is 6 words:
// the next one of the pixel and 5 bits, depth in the middle of the pixel, its steps to the next
// pixel in x and in y, colour and opacity as half floats.
constexpr char kLayerLists[] = R"(
layout(std430, binding = 1) buffer Heads { uint heads[]; };
layout(std430, binding = 2) buffer Layers {
  uint layer_count;
  uint padding;
  uint layers[];
};
uniform ivec2 list_corner;  // lower left
uniform ivec2 list_size;    // pixels
uniform uint list_capacity;
const uint kMeasuredBit = 16u;  // it has a depth for those who ask; the bits below it are samples
const float kLeastOpacity = 1.0 / 512.0;

// With several samples, llvmpipe also shades pixels beside the scissor box.
bool hasList() {
  ivec2 place = ivec2(gl_FragCoord.xy) - list_corner;
  return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, list_size));
}

uint headOfPixel() {
  ivec2 place = ivec2(gl_FragCoord.xy) - list_corner;
  return uint(place.y * list_size.x + place.x);
}
)";

constexpr char kKeepLayer[] = R"(
layout(early_fragment_tests) in;

void keepLayer(vec4 light, float opacity, bool is_measured) {
  vec3 plane = vec3(gl_FragCoord.z, dFdx(gl_FragCoord.z), dFdy(gl_FragCoord.z));
  if (gl_HelperInvocation || !(opacity >= kLeastOpacity) || !hasList()) return;
  uint layer = atomicAdd(layer_count, 1u);
  if (layer >= list_capacity) return;
  uint bits = (uint(gl_SampleMaskIn[0]) & 15u) | (is_measured ? kMeasuredBit : 0u);
  uint at = 6u * layer;
  layers[at + 1u] = floatBitsToUint(plane.x);
  layers[at + 2u] = floatBitsToUint(plane.y);
  layers[at + 3u] = floatBitsToUint(plane.z);
  layers[at + 4u] = packHalf2x16(light.rg);
  layers[at + 5u] = packHalf2x16(light.ba);
  layers[at] = (atomicExchange(heads[headOfPixel()], layer + 1u) << 5) | bits;
}
)";

// position + chunk_offset.xyz is one correctly rounded sum (see SnappedEye), so chunks that share a
// vertex give it the same bits from here on.
constexpr char kSurfaceVertexShader[] = R"(
#ifdef WIREFRAME
layout(std430, binding = 0) readonly buffer Chunk { uint words[]; };
out vec3 barycentric;
#else
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 normal_and_value;
#endif
layout(location = 2) in vec4 chunk_offset;  // w: 1 if coloured by value
layout(location = 3) in vec4 chunk_color;
layout(location = 4) in uvec2 chunk_words;  // places of the first index and of the first vertex
uniform vec3 eye_rest;  // in the lattice
uniform mat3 lattice_to_eye;
uniform mat3 world_to_eye;
out vec3 eye_position;
out vec3 eye_normal;
out float share;  // of the range of values; below 0: it has none
flat out vec4 surface_color;
flat out int takes_value;
flat out int component;  // the place of its colour; below 0: it has none

void main() {
#ifdef WIREFRAME
  uint first = chunk_words.y + 5u * words[chunk_words.x + uint(gl_VertexID)];
  vec3 position = uintBitsToFloat(uvec3(words[first], words[first + 1u], words[first + 2u]));
  vec4 normal_and_value =
      vec4(unpackSnorm2x16(words[first + 3u]), unpackSnorm2x16(words[first + 4u]));
  int corner = gl_VertexID % 3;
  barycentric = vec3(corner == 0, corner == 1, corner == 2);
#endif
  precise vec3 from_snapped_eye = position + chunk_offset.xyz;
  eye_position = lattice_to_eye * from_snapped_eye - lattice_to_eye * eye_rest;
  eye_normal = world_to_eye * normal_and_value.xyz;
  float value = round(normal_and_value.w * 32767.0);
  share = value < -32766.0 ? -1.0 : (value + 32766.0) / 65533.0;
  surface_color = chunk_color;
  takes_value = int(chunk_offset.w);
  component = int(value);
  project(eye_position);
}
)";

constexpr char kSurfaceFragmentShader[] = R"(
in vec3 eye_position;
in vec3 eye_normal;
in float share;
flat in vec4 surface_color;
flat in int takes_value;
flat in int component;
#ifdef WIREFRAME
in vec3 barycentric;
#endif
uniform bool orthographic;
uniform bool headlight;
uniform bool as_normals;
uniform mat3 world_to_eye;
uniform vec3 back_color;
uniform bool by_value;
uniform vec2 value_window;
uniform vec3 value_colors[17];
uniform vec2 value_opacity;
#ifdef IN_SHADOW
uniform mat3 shadow_rotation;
uniform vec3 shadow_offset;
uniform vec4 shadow_projection;
uniform float shadow_texel;
layout(binding = 3) uniform sampler2DShadow shadow_depths;
#endif
uniform bool by_plane;
uniform vec4 value_plane;
uniform bool by_component;
uniform vec3 component_colors[7];
#ifndef AS_LAYERS
out vec4 color;
#endif

uniform vec3 key_direction;
const vec3 kSkyLight = vec3(0.20, 0.22, 0.25);
const vec3 kGroundLight = vec3(0.09, 0.08, 0.07);

// With the surface's opacity.
vec4 frontColor() {
  if (by_component && takes_value != 0 && component >= 0 && component < 7)
    return vec4(component_colors[component], surface_color.a);
  if (!by_value || takes_value == 0 || (share < 0.0 && !by_plane)) return surface_color;
  float value = by_plane ? dot(value_plane, vec4(eye_position, 1.0)) : share;
  float span = max(value_window.y - value_window.x, 1e-30);
  float place = 16.0 * clamp((value - value_window.x) / span, 0.0, 1.0);
  int low = min(int(place), 15);
  return vec4(mix(value_colors[low], value_colors[low + 1], place - float(low)),
              surface_color.a * mix(value_opacity.x, value_opacity.y, place / 16.0));
}

#ifdef IN_SHADOW
// The share of the key light that reaches the point. It is asked for a little in front of the
// surface, so that no facet shades itself.
float keyLightAt(vec3 normal) {
  float slope = sqrt(max(0.0, 1.0 - dot(normal, key_direction) * dot(normal, key_direction)));
  vec3 point = eye_position + shadow_texel * (1.5 + 4.0 * slope) * normal;
  vec3 place = shadow_rotation * point + shadow_offset;
  vec3 there = vec3(0.5 + 0.5 * shadow_projection.xy * place.xy,
                    shadow_projection.z * place.z + shadow_projection.w);
  float step = 1.5 / float(textureSize(shadow_depths, 0).x);
  float open = 0.0;
  for (int y = -2; y <= 2; ++y)
    for (int x = -2; x <= 2; ++x) open += texture(shadow_depths, there + vec3(vec2(x, y) * step, 0));
  return open / 25.0;
}
#endif

#ifdef WIREFRAME
// 1 on an edge of the triangle and 0 away from it, with a soft flank of one pixel.
float edgeCoverage() {
  vec3 step_x = dFdx(barycentric), step_y = dFdy(barycentric);
  // A barycentric coordinate grows from 0 to 1 over the triangle's height, so the length of its
  // gradient is 1 / height in pixels, and dividing by it gives the distance to the edge in pixels.
  vec3 per_pixel = max(sqrt(step_x * step_x + step_y * step_y), 1e-6);
  vec3 distances = barycentric / per_pixel;
  float nearest = min(distances.x, min(distances.y, distances.z));
  float least_height = 1.0 / max(per_pixel.x, max(per_pixel.y, per_pixel.z));
  float fade = clamp((least_height - 0.5) / 7.0, 0.12, 1.0);
  return fade * clamp(1.1 - nearest, 0.0, 1.0);
}
#endif

#ifdef AS_LAYERS
void give(vec4 light, float opacity) { keepLayer(light, opacity, true); }
#else
void give(vec4 light, float opacity) { color = light; }
#endif

void main() {
  vec3 to_eye = orthographic ? vec3(0.0, 0.0, 1.0) : normalize(-eye_position);
  float length_of_normal = length(eye_normal);
  vec3 normal = length_of_normal > 1e-6 ? eye_normal / length_of_normal : to_eye;
  if (as_normals) {
    give(vec4(transpose(world_to_eye) * normal, 1.0), frontColor().a);
    return;
  }
  // Back faces are lit as seen, whichever way their normals point; front faces with inward normals
  // stay dark, and are found out.
  if (!gl_FrontFacing && dot(normal, to_eye) < 0.0) normal = -normal;

  vec4 front = frontColor();
  vec3 surface = gl_FrontFacing ? front.rgb : back_color;
  float head = max(dot(normal, to_eye), 0.0);
  float key = max(dot(normal, key_direction), 0.0);
#ifdef IN_SHADOW
  if (key > 0.0) key *= keyLightAt(normal);
#endif
  vec3 light = headlight ? vec3(0.08 + 0.92 * head)
                         : mix(kGroundLight, kSkyLight, 0.5 + 0.5 * normal.y) + 0.24 * head +
                               vec3(0.70, 0.68, 0.64) * key;
  vec3 shaded = surface * light;
  if (gl_FrontFacing) {
    float gloss = pow(max(dot(normal, normalize(key_direction + to_eye)), 0.0), 48.0);
    shaded += 0.10 * gloss * key;
  } else {
    shaded *= 0.6;
  }
#ifdef WIREFRAME
  shaded = mix(shaded, 0.10 * surface, 0.85 * edgeCoverage());
#endif
  give(vec4(shaded, front.a), front.a);
}
)";

constexpr char kDepthFragmentShader[] = R"(
void main() {}
)";

// One triangle that covers the picture.
constexpr char kBackgroundVertexShader[] = R"(
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  gl_Position = vec4(corner, 0.0, 1.0);
}
)";

constexpr char kBackgroundFragmentShader[] = R"(
uniform vec3 top;
uniform vec3 bottom;
uniform float first_row;  // of those that are drawn, from below
uniform float picture_height;
out vec4 color;

void main() {
  float height = (gl_FragCoord.y + first_row) / picture_height;
  vec3 root = mix(sqrt(bottom), sqrt(top), height);  // close to steps that look even
  color = vec4(root * root, 1.0);
}
)";

constexpr char kLineVertexShader[] = R"(
layout(location = 0) in vec4 place;  // x and y; pixels from the middle; depth
out float pixels_from_middle;

void main() {
  pixels_from_middle = place.z;
  gl_Position = vec4(place.xy, place.w, 1.0);
}
)";

// Nothing is left of the casing kLineReach pixels outside.
constexpr char kLineFragmentShader[] = R"(in float pixels_from_middle;
uniform vec3 line_color;
uniform float half_width;
uniform float casing;
out vec4 color;

void main() {
  float outside = abs(pixels_from_middle) - half_width;
  float line = clamp(0.5 - outside, 0.0, 1.0);
  float dark = casing * clamp(2.0 - outside, 0.0, 1.0);  // dark, so that bright grounds show it too
  color = vec4(line_color * line, 1.0 - (1.0 - line) * (1.0 - dark));  // premultiplied
}
)";

constexpr char kSliceVertexShader[] = R"(
uniform vec3 corner;
uniform vec3 across;
uniform vec3 along;
out vec2 place;

void main() {
  place = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  project(corner + place.x * across + place.y * along);
}
)";

// The outermost values lie on the border itself.
constexpr char kSliceFragmentShader[] = R"(
in vec2 place;
layout(binding = 0) uniform sampler2D values;
uniform vec2 window;
uniform float least_value;
uniform float below_value;
uniform float opacity;
#ifndef AS_LAYERS
out vec4 color;
#endif

void main() {
  vec2 size = vec2(textureSize(values, 0));
  float value = texture(values, (place * (size - 1.0) + 0.5) / size).r;
  // Nor where there is no value, by the bits of NaN: a driver may compare as if there were none.
  bool is_known = (floatBitsToUint(value) & 0x7fffffffu) <= 0x7f800000u;
  bool is_shown = is_known && (value >= least_value || value < below_value);
  float grey = clamp((value - window.x) / max(window.y - window.x, 1e-30), 0.0, 1.0);
  vec4 shown = vec4(pow(vec3(grey), vec3(2.0, 2.1, 2.3)), opacity);  // warm, unlike every surface
#ifdef AS_LAYERS
  keepLayer(shown, is_shown ? opacity : 0.0, false);
#else
  if (!is_shown) discard;
  color = shown;
#endif
}
)";

constexpr char kSphereVertexShader[] = R"(
uniform vec3 center;
uniform float radius;
out vec3 eye_position;
out vec3 eye_normal;

void main() {
  const vec2 kCorners[6] = vec2[](vec2(0, 0), vec2(1, 0), vec2(1, 1), vec2(0, 0), vec2(1, 1),
                                  vec2(0, 1));
  int cell = gl_VertexID / 6;
  vec2 place = (vec2(cell % 64, cell / 64) + kCorners[gl_VertexID % 6]) / vec2(64.0, 32.0);
  float azimuth = 6.28318530718 * place.x, polar = 3.14159265359 * place.y;
  eye_normal = vec3(sin(polar) * cos(azimuth), sin(polar) * sin(azimuth), cos(polar));
  eye_position = center + radius * eye_normal;
  project(eye_position);
}
)";

constexpr char kSphereFragmentShader[] = R"(
in vec3 eye_position;
in vec3 eye_normal;
uniform bool orthographic;
uniform vec3 color;
out vec4 light;

void main() {
  vec3 to_eye = orthographic ? vec3(0.0, 0.0, 1.0) : normalize(-eye_position);
  float facing = abs(dot(normalize(eye_normal), to_eye));
  float alpha = mix(0.10, 0.015, facing);  // denser towards its rim
  light = vec4(color * alpha, alpha);
}
)";

// For depths: the places of pixels in eye coordinates. A pixel counts from the lower left corner of
// what is drawn, which may be a tile of the picture.
constexpr char kPlacesOfPixels[] = R"(
layout(binding = 0) uniform sampler2D depths;
uniform ivec2 first_pixel;   // that is drawn, from the lower left corner of the picture
uniform vec2 picture_size;  // pixels
uniform vec4 projection;
uniform bool orthographic;
uniform float reach;

// Along the view.
float distanceOf(float depth) {
  return orthographic ? (projection.w - depth) / projection.z
                      : projection.w / (depth + projection.z);
}

// Below 0: there is nothing but background.
float distanceAt(ivec2 pixel) {
  if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, textureSize(depths, 0))))
    return -1.0;
  float depth = texelFetch(depths, pixel, 0).r;
  if (depth <= 0.0) return -1.0;
  return distanceOf(depth);
}

vec3 placeAt(ivec2 pixel, float distance) {
  vec2 place = 2.0 * (vec2(pixel + first_pixel) + 0.5) / picture_size - 1.0;
  return vec3(place / projection.xy * (orthographic ? 1.0 : distance), -distance);
}

// `reach` at this distance, in eye coordinates.
float radiusAt(float distance) {
  return 2.0 * reach / (projection.y * picture_size.y) * (orthographic ? 1.0 : distance);
}
)";

// Surfaces that rise over the plane of a pixel shade it, the more the nearer it is. The sampled
// places turn from pixel to pixel, so that 4 x 4 pixels cover as much as 256 places.
constexpr char kOcclusionFragmentShader[] = R"(
layout(binding = 2) uniform sampler2D coarse_depths;
uniform bool has_coarse;
uniform ivec2 first_coarse;
uniform vec2 coarse_size;  // of the picture, in its pixels
out float open;

// What is seen around a pixel; false: there is nothing but background.
bool surfaceAt(ivec2 pixel, out vec3 place) {
  if (!has_coarse) {
    float distance = distanceAt(pixel);
    place = placeAt(pixel, distance);
    return distance >= 0.0;
  }
  ivec2 whole = ivec2(floor((vec2(pixel + first_pixel) + 0.5) * coarse_size / picture_size));
  ivec2 coarse = whole - first_coarse;
  if (any(lessThan(coarse, ivec2(0))) ||
      any(greaterThanEqual(coarse, textureSize(coarse_depths, 0))))
    return false;
  float depth = texelFetch(coarse_depths, coarse, 0).r;
  if (depth <= 0.0) return false;
  float distance = distanceOf(depth);
  vec2 at = 2.0 * (vec2(whole) + 0.5) / coarse_size - 1.0;
  place = vec3(at / projection.xy * (orthographic ? 1.0 : distance), -distance);
  return true;
}

// To the neighbour that is on the same surface, more likely than the one on the other side.
vec3 stepAlong(ivec2 pixel, vec3 place, ivec2 along) {
  float before = distanceAt(pixel - along), after = distanceAt(pixel + along);
  bool forward = before < 0.0 || (after >= 0.0 && abs(after + place.z) < abs(before + place.z));
  if (forward && after < 0.0) return vec3(along, 0.0);
  return forward ? placeAt(pixel + along, after) - place : place - placeAt(pixel - along, before);
}

void main() {
  const int kPlaces = 16;
  const float kRise = 0.05;  // of the radius, which triangles reach over each other's planes
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float distance = distanceAt(pixel);
  open = 1.0;
  if (distance < 0.0) return;
  vec3 place = placeAt(pixel, distance);
  vec3 normal = normalize(cross(stepAlong(pixel, place, ivec2(1, 0)),
                                stepAlong(pixel, place, ivec2(0, 1))));
  float radius = radiusAt(distance);
  ivec2 seen = pixel + first_pixel;
  float turn = 6.28318530718 / 16.0 * float((seen.x & 3) * 4 + (((seen.y & 3) + seen.x) & 3));
  float sum = 0.0;
  for (int i = 0; i < kPlaces; ++i) {
    float away = max(1.0, reach * sqrt((float(i) + 0.5) / float(kPlaces)));
    float angle = turn + 2.39996323 * float(i);
    ivec2 other = pixel + ivec2(round(away * vec2(cos(angle), sin(angle))));
    vec3 there;
    if (!surfaceAt(other, there)) continue;
    vec3 arm = (there - place) / radius;
    float square = dot(arm, arm);
    float near = max(0.0, 1.0 - square);
    sum += near * near * near * max(0.0, dot(arm, normal) - kRise) / (square + 0.01);
  }
  const float kStrength = 10.0;
  open = clamp(1.0 - kStrength / float(kPlaces) * sum, 0.0, 1.0);
}
)";

constexpr char kShadeFragmentShader[] = R"(
layout(binding = 1) uniform sampler2D openness;
out vec4 color;

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float distance = distanceAt(pixel);
  float radius = radiusAt(distance);
  float sum = 0.0, weights = 0.0;
  for (int y = -2; y < 2; ++y) {
    for (int x = -2; x < 2; ++x) {
      float there = distanceAt(pixel + ivec2(x, y));
      // A point behind or before it is another surface's.
      float weight = there < 0.0 ? 0.0 : max(0.0, 1.0 - 2.0 * abs(there - distance) / radius);
      sum += weight * texelFetch(openness, pixel + ivec2(x, y), 0).r;
      weights += weight;
    }
  }
  color = vec4(vec3(weights > 0.0 && distance >= 0.0 ? sum / weights : 1.0), 1.0);
}
)";

constexpr char kScreenFragmentShader[] = R"(
layout(binding = 0) uniform sampler2D picture;
uniform vec2 corner;  // of the picture in the window
out vec4 color;

void main() {
  vec3 light = clamp(texelFetch(picture, ivec2(gl_FragCoord.xy - corner), 0).rgb, 0.0, 1.0);
  vec3 high = 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055;
  color = vec4(mix(high, 12.92 * light, lessThanEqual(light, vec3(0.0031308))), 1.0);
}
)";

// Fragments of a sample from front to back, four with every walk through the list. Those of one
// depth are in the order of their colours, so that the picture does not depend on the order in
// which they came. Branches cost as much as both their sides on a processor, so there are few
// loads.
constexpr char kLayersFragmentShader[] = R"(
layout(binding = 0) uniform sampler2DMS depths;  // of what is opaque
uniform vec2 sample_places[4];                   // from the middle of a pixel
out vec4 light;                                  // premultiplied

struct Layer {
  float depth;
  uint key;     // of its colour
  uint number;  // 0: none
};

bool isBehind(Layer a, Layer b) {
  return a.depth < b.depth ||
         (a.depth == b.depth && (a.key < b.key || (a.key == b.key && a.number < b.number)));
}

void sortTwo(inout Layer front, inout Layer back) {
  if (isBehind(front, back)) {
    Layer nearer = back;
    back = front;
    front = nearer;
  }
}

const float kLeastThrough = 1.0 / 1024.0;
float through = 1.0, front = 0.0;
vec3 sum = vec3(0.0);

void add(Layer layer) {
  if (layer.number == 0u || through <= kLeastThrough) return;
  uint at = 6u * (layer.number - 1u);
  vec4 color = vec4(unpackHalf2x16(layers[at + 4u]), unpackHalf2x16(layers[at + 5u]));
  sum += through * color.a * color.rgb;
  through *= 1.0 - color.a;
  if (front == 0.0 && (layers[at] & kMeasuredBit) != 0u) front = layer.depth;
}

void main() {
  if (!hasList()) discard;
  uint head = heads[headOfPixel()];
  if (head == 0u) discard;
  float opaque = texelFetch(depths, ivec2(gl_FragCoord.xy), gl_SampleID).r;
  vec2 place = sample_places[gl_SampleID];
  uint sample_bit = 1u << uint(gl_SampleID);
  Layer none = Layer(opaque, 0u, 0u);
  Layer last = Layer(2.0, 0u, 0u);  // before everything
  bool has_more = head != 0u;
  while (has_more && through > kLeastThrough) {
    Layer a = none, b = none, c = none, d = none;
    for (uint number = head; number != 0u;) {
      uint at = 6u * (number - 1u);
      uint word = layers[at];
      vec3 plane = uintBitsToFloat(uvec3(layers[at + 1u], layers[at + 2u], layers[at + 3u]));
      Layer layer = Layer(plane.x + dot(plane.yz, place),
                          layers[at + 4u] * 2654435761u + layers[at + 5u], number);
      if ((word & sample_bit) != 0u && layer.depth > opaque && isBehind(layer, last) &&
          isBehind(d, layer)) {
        d = layer;
        sortTwo(c, d);
        sortTwo(b, c);
        sortTwo(a, b);
      }
      number = word >> 5;
    }
    add(a);
    add(b);
    add(c);
    add(d);
    last = d;
    has_more = d.number != 0u;
  }
  if (through == 1.0) discard;
  light = vec4(sum, 1.0 - through);
  gl_FragDepth = max(opaque, front);
}
)";

using Sources = std::array<const char*, 6>;

GLuint compileShader(GLenum stage, const Sources& sources) {
  const GLuint shader = glCreateShader(stage);
  const auto end = std::find(sources.begin(), sources.end(), nullptr);
  glShaderSource(shader, static_cast<GLsizei>(end - sources.begin()), sources.data(), nullptr);
  glCompileShader(shader);
  return shader;
}

GlProgram linkProgram(const Sources& vertex_sources, const Sources& fragment_sources) {
  const GLuint vertex = compileShader(GL_VERTEX_SHADER, vertex_sources);
  const GLuint fragment = compileShader(GL_FRAGMENT_SHADER, fragment_sources);
  GlProgram program(glCreateProgram());
  glAttachShader(*program, vertex);
  glAttachShader(*program, fragment);
  glLinkProgram(*program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  GLint linked = GL_FALSE;
  glGetProgramiv(*program, GL_LINK_STATUS, &linked);
  if (linked != GL_TRUE) {
    std::array<char, 512> log{};
    glGetProgramInfoLog(*program, static_cast<GLsizei>(log.size()), nullptr, log.data());
    std::replace(log.begin(), log.end(), '\n', ' ');
    throw Error(std::string("cannot render: the OpenGL driver refused a shader (") + log.data() +
                "); update the graphics driver or Mesa");
  }
  return program;
}

// A fragment shader that draws, or one that keeps layers.
Sources withFragments(bool as_layers, const char* define, const char* shader) {
  if (!as_layers) return {kVersion, define, shader};
  return {kVersion, define, kAsLayers, kLayerLists, kKeepLayer, shader};
}

GLint place(const GlProgram& program, const char* name) {
  return glGetUniformLocation(*program, name);
}

}  // namespace

GlProgram makeSurfaceProgram(const SurfaceProgramKind& kind) {
  const std::string defines =
      std::string(kind.wireframe ? kWithWireframe : "") + (kind.in_shadow ? kInShadow : "");
  return linkProgram({kVersion, defines.c_str(), kProjection, kSurfaceVertexShader},
                     withFragments(kind.as_layers, defines.c_str(), kSurfaceFragmentShader));
}

GlProgram makeDepthProgram() {
  return linkProgram({kVersion, "", kProjection, kSurfaceVertexShader},
                     {kVersion, "", "", kDepthFragmentShader});
}

GlProgram makeLayersProgram() {
  return linkProgram({kVersion, kBackgroundVertexShader},
                     {kVersion, kLayerLists, kLayersFragmentShader});
}

// Over the viewer's left shoulder.
glm::vec3 keyLightDirection() { return glm::normalize(glm::vec3(-0.55f, 0.75f, 0.60f)); }

GlProgram makeBackgroundProgram() {
  return linkProgram({kVersion, "", "", kBackgroundVertexShader},
                     {kVersion, "", "", kBackgroundFragmentShader});
}

GlProgram makeLineProgram() {
  return linkProgram({kVersion, "", "", kLineVertexShader},
                     {kVersion, "", "", kLineFragmentShader});
}

GlProgram makeSliceProgram(bool as_layers) {
  return linkProgram({kVersion, "", kProjection, kSliceVertexShader},
                     withFragments(as_layers, "", kSliceFragmentShader));
}

GlProgram makeSphereProgram() {
  return linkProgram({kVersion, "", kProjection, kSphereVertexShader},
                     {kVersion, "", "", kSphereFragmentShader});
}

GlProgram makeOcclusionProgram() {
  return linkProgram({kVersion, "", "", kBackgroundVertexShader},
                     {kVersion, "", kPlacesOfPixels, kOcclusionFragmentShader});
}

GlProgram makeShadeProgram() {
  return linkProgram({kVersion, "", "", kBackgroundVertexShader},
                     {kVersion, "", kPlacesOfPixels, kShadeFragmentShader});
}

GlProgram makeScreenProgram() {
  return linkProgram({kVersion, "", "", kBackgroundVertexShader},
                     {kVersion, "", "", kScreenFragmentShader});
}

void setUniform(const GlProgram& program, const char* name, const glm::vec2& value) {
  glProgramUniform2fv(*program, place(program, name), 1, &value[0]);
}
void setUniform(const GlProgram& program, const char* name, const glm::vec3& value) {
  glProgramUniform3fv(*program, place(program, name), 1, &value[0]);
}
void setUniform(const GlProgram& program, const char* name, const glm::vec4& value) {
  glProgramUniform4fv(*program, place(program, name), 1, &value[0]);
}
void setUniform(const GlProgram& program, const char* name, const glm::mat3& value) {
  glProgramUniformMatrix3fv(*program, place(program, name), 1, GL_FALSE, &value[0][0]);
}
void setUniform(const GlProgram& program, const char* name,
                const std::array<glm::vec3, kColorMapPlaces>& values) {
  glProgramUniform3fv(*program, place(program, name), static_cast<GLsizei>(values.size()),
                      &values[0][0]);
}
void setUniform(const GlProgram& program, const char* name, float value) {
  glProgramUniform1f(*program, place(program, name), value);
}
void setUniform(const GlProgram& program, const char* name, int value) {
  glProgramUniform1i(*program, place(program, name), value);
}
void setUniform(const GlProgram& program, const char* name, const glm::ivec2& value) {
  glProgramUniform2iv(*program, place(program, name), 1, &value[0]);
}
void setUniform(const GlProgram& program, const char* name, unsigned value) {
  glProgramUniform1ui(*program, place(program, name), value);
}

}  // namespace isobrick
