// The renderer's programs: lighting, as GLSL 4.50. They belong to the context that is current when
// they are made. Each function throws Error with the driver's words if it refuses the GLSL. All
// colours, in and out, are linear light; depth is reversed (1 near, 0 far).
#pragma once

#include <epoxy/gl.h>

#include <array>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "isobrick/extract/color_map.h"
#include "isobrick/viewer/render/gl_handle.h"

namespace isobrick {

// See makeSurfaceProgram().
struct SurfaceProgramKind {
  bool wireframe = false, as_layers = false, in_shadow = false;
};

// Lit triangles, with front and back in different colours.
// Attributes: 0 vec3 position from the chunk's origin, 1 vec4 outward normal in world axes and
// SurfaceVertex::value; of a chunk 2 vec4 its origin's place and 1 if values colour it, 3 vec4 its
// colour, 4 uvec2 the places of its first index and first vertex in the buffer, in 4 bytes. With
// `wireframe` 0 and 1 are missing: vertices and indices are read from the buffer at binding 0, and
// 3 vertices a triangle are drawn.
// Uniforms: vec3 eye_rest; mat3 lattice_to_eye, world_to_eye; vec4 projection (x and y scale, depth
// scale and offset); bool orthographic, headlight; vec4 clip_planes[6] (eye coordinates); int
// clip_count; vec3 back_color; bool as_normals (the colour is the normal, world); bool by_value;
// vec2 value_window (shares of the range, or distances `by_plane`, for the ends of value_colors, 17
// of them); vec2 value_opacity (of those ends); bool by_plane; vec4 value_plane (eye coordinates);
// bool by_component, and if so vec3 component_colors[7], which values are the places of;
// vec3 key_direction; `in_shadow` mat3 shadow_rotation, vec3 shadow_offset, vec4 shadow_projection,
// float shadow_texel (ShadowView), sampler2DShadow at unit 3. A frame without a shadow has a
// program without that sampler: one that finds no depths is undefined, even if it is never asked.
//
// `as_layers`: the fragments go into lists instead of into the picture, for makeLayersProgram();
// that takes the buffers of it, and its uniforms of the lists.
GlProgram makeSurfaceProgram(const SurfaceProgramKind& kind);

// The depths of surfaces alone, without colours. Attributes and uniforms of places as above.
GlProgram makeDepthProgram();

// To the key light of the surface program, in eye coordinates, unit.
glm::vec3 keyLightDirection();

// The ground of the picture, from top to bottom. Draw 3 vertices without attributes.
// Uniforms: vec3 top, bottom; float first_row (of those drawn, from below), picture_height.
GlProgram makeBackgroundProgram();

// What is seen through, over what is opaque: the layers of each sample from front to back, to be
// blended as premultiplied colours. Writes the depth of the nearest surface. Draw 3 vertices.
// Buffers: at binding 1 a word for each pixel of the rows, the number of its last layer (0: none);
// at binding 2 kLayerHeadBytes, of which the first word counts the layers, then kLayerBytes each.
// Uniforms: ivec2 list_corner, list_size (pixels); uint list_capacity (layers);
// sampler2DMS depths at unit 0, of what is opaque; vec2 sample_places[4] (from a pixel's middle).
GlProgram makeLayersProgram();
constexpr GLsizeiptr kLayerHeadBytes = 8, kLayerBytes = 24;

// Anti-aliased lines with a dark casing, to be blended as premultiplied colours. A line is drawn as
// triangles that reach kLineReach pixels past its half width.
// Attribute: 0 vec4, x and y in the viewport's coordinates (-1 .. 1), z in pixels from the middle,
// w depth. Uniforms: vec3 line_color; float half_width (pixels), casing (0 .. 1).
GlProgram makeLineProgram();
constexpr double kLineReach = 2.0;

// A parallelogram of values, as grey from black to white. Draw 4 vertices as a strip.
// Uniforms: vec3 corner, across, along (eye coordinates); vec4 projection; bool orthographic;
// vec4 clip_planes[6]; int clip_count; sampler2D values at unit 0; vec2 window (black, white);
// float least_value, below_value (values of at least the one or below the other are drawn),
// opacity. `as_layers`: as of surfaces; a slice has no depth there.
GlProgram makeSliceProgram(bool as_layers);

// A translucent sphere, to be blended as premultiplied colours. Draw kSphereVertices vertices
// without attributes. Uniforms: vec3 center (eye coordinates); float radius; vec4 projection; bool
// orthographic; vec3 color.
GlProgram makeSphereProgram();
constexpr GLsizei kSphereVertices = 6 * 32 * 64;

// The share of the light from all around that reaches the surface at a pixel, by the depths around
// it: 1 is all. Draw 3 vertices. Uniforms: sampler2D depths at unit 0; those of
// setPlacesOfPixels(); float reach (pixels around each, within which things shade each other); bool
// has_coarse, and if so coarser depths in place of those around: sampler2D coarse_depths at unit 2,
// ivec2 first_coarse (its first pixel), vec2 coarse_size (of the picture of them).
GlProgram makeOcclusionProgram();

// The same without its grain, as colours to be multiplied with the picture's, at depth 0. Draw 3
// vertices. Uniforms: as above, and sampler2D openness at unit 1.
GlProgram makeShadeProgram();

// The picture to a screen: linear light to sRGB. Draw 3 vertices. Uniform: sampler2D picture.
GlProgram makeScreenProgram();

// Set a uniform of a program; one that the driver left out is passed over.
void setUniform(const GlProgram& program, const char* name, const glm::vec2& value);
void setUniform(const GlProgram& program, const char* name, const glm::vec3& value);
void setUniform(const GlProgram& program, const char* name, const glm::vec4& value);
void setUniform(const GlProgram& program, const char* name, const glm::mat3& value);
void setUniform(const GlProgram& program, const char* name,
                const std::array<glm::vec3, kColorMapPlaces>& values);
void setUniform(const GlProgram& program, const char* name, float value);
void setUniform(const GlProgram& program, const char* name, int value);
void setUniform(const GlProgram& program, const char* name, const glm::ivec2& value);
void setUniform(const GlProgram& program, const char* name, unsigned value);

}  // namespace isobrick
