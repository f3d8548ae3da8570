// The renderer's programs: what light does, as GLSL. Compiled where the renderer is made; they
// belong to the context that is current then. Each function throws Error with the driver's words
// where it refuses the GLSL. All colours, in and out, are linear light.
#pragma once

#include <epoxy/gl.h>

#include <cstddef>
#include <glm/vec3.hpp>

namespace isobrick {

// Entries of the surface program's level_colors; levels past the last share it.
constexpr std::size_t kShadedLevels = 8;

// Lit triangles, front and back told apart.
// Attributes: 0 vec3 position from the eye, in world units and axes; 1 vec3 outward normal;
// 2 uint level. Corners are not shared: gl_VertexID % 3 is the corner's place in its triangle.
// Uniforms: mat3 world_to_eye; vec4 projection (x and y scale, depth scale and offset);
// vec3 level_colors[kShadedLevels]; vec3 back_color; bool wireframe.
GLuint makeSurfaceProgram();

// The ground of the picture, from top to bottom. Draw 3 vertices without attributes.
// Uniforms: vec3 top, bottom.
GLuint makeBackgroundProgram();

// Anti-aliased lines with a dark casing, to be blended as premultiplied colours. A line is drawn as
// triangles that reach kLineReach pixels past its half width.
// Attribute: 0 vec3, x and y in normalised device coordinates and z in pixels from the middle.
// Uniforms: vec3 line_color; float half_width (pixels).
GLuint makeLineProgram();
constexpr double kLineReach = 2.0;

// Sets a vec3 of the program in use.
void setUniform(GLuint program, const char* name, const glm::vec3& value);

}  // namespace isobrick
