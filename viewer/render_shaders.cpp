#include "isobrick/viewer/render_shaders.h"

#include <algorithm>
#include <array>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Eye coordinates: the eye at the origin, +x right, +y up, -z ahead. All light is linear.
constexpr char kSurfaceVertexShader[] = R"(#version 330 core
layout(location = 0) in vec3 position_from_eye;
layout(location = 1) in vec3 normal;
layout(location = 2) in uint level;
uniform mat3 world_to_eye;
uniform vec4 projection;  // x and y scale, depth scale and offset
out vec3 eye_position;
out vec3 eye_normal;
out vec3 barycentric;
flat out uint triangle_level;

void main() {
  eye_position = world_to_eye * position_from_eye;
  eye_normal = world_to_eye * normal;
  int corner = gl_VertexID % 3;
  barycentric = vec3(corner == 0, corner == 1, corner == 2);
  triangle_level = level;
  gl_Position = vec4(projection.xy * eye_position.xy, projection.z * eye_position.z + projection.w,
                     -eye_position.z);
}
)";

// Its 8 and 7u are kShadedLevels and the last of them.
constexpr char kSurfaceFragmentShader[] = R"(#version 330 core
in vec3 eye_position;
in vec3 eye_normal;
in vec3 barycentric;
flat in uint triangle_level;
uniform vec3 level_colors[8];
uniform vec3 back_color;
uniform bool wireframe;
out vec4 color;

const vec3 kKeyDirection = normalize(vec3(-0.55, 0.75, 0.60));  // over the viewer's left shoulder
const vec3 kSkyLight = vec3(0.20, 0.22, 0.25);
const vec3 kGroundLight = vec3(0.09, 0.08, 0.07);

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

void main() {
  vec3 to_eye = normalize(-eye_position);
  float length_of_normal = length(eye_normal);
  vec3 normal = length_of_normal > 1e-6 ? eye_normal / length_of_normal : to_eye;
  // Back faces are lit as seen, whichever way their normals point; front faces with inward normals
  // stay dark, and are found out.
  if (!gl_FrontFacing && dot(normal, to_eye) < 0.0) normal = -normal;

  vec3 surface = gl_FrontFacing ? level_colors[min(triangle_level, 7u)] : back_color;
  float head = max(dot(normal, to_eye), 0.0);
  float key = max(dot(normal, kKeyDirection), 0.0);
  vec3 light = mix(kGroundLight, kSkyLight, 0.5 + 0.5 * normal.y) + 0.24 * head +
               vec3(0.70, 0.68, 0.64) * key;
  vec3 shaded = surface * light;
  if (gl_FrontFacing) {
    float gloss = pow(max(dot(normal, normalize(kKeyDirection + to_eye)), 0.0), 48.0);
    shaded += 0.10 * gloss * key;
  } else {
    shaded *= 0.6;
  }
  if (wireframe) shaded = mix(shaded, 0.10 * surface, 0.85 * edgeCoverage());
  color = vec4(shaded, 1.0);
}
)";

// One triangle that covers the picture.
constexpr char kBackgroundVertexShader[] = R"(#version 330 core
out float height;

void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  height = 0.5 + 0.5 * corner.y;
  gl_Position = vec4(corner, 0.0, 1.0);
}
)";

constexpr char kBackgroundFragmentShader[] = R"(#version 330 core
in float height;
uniform vec3 top;
uniform vec3 bottom;
out vec4 color;

void main() {
  vec3 root = mix(sqrt(bottom), sqrt(top), height);  // close to steps that look even
  color = vec4(root * root, 1.0);
}
)";

constexpr char kLineVertexShader[] = R"(#version 330 core
layout(location = 0) in vec3 place;  // normalised device coordinates, and pixels from the middle
out float pixels_from_middle;

void main() {
  pixels_from_middle = place.z;
  gl_Position = vec4(place.xy, 0.0, 1.0);
}
)";

// Nothing is left of the casing kLineReach pixels outside.
constexpr char kLineFragmentShader[] = R"(#version 330 core
in float pixels_from_middle;
uniform vec3 line_color;
uniform float half_width;
out vec4 color;

void main() {
  float outside = abs(pixels_from_middle) - half_width;
  float line = clamp(0.5 - outside, 0.0, 1.0);
  float casing = 0.5 * clamp(2.0 - outside, 0.0, 1.0);  // dark, so that bright grounds show it too
  color = vec4(line_color * line, 1.0 - (1.0 - line) * (1.0 - casing));  // premultiplied
}
)";

GLuint compileShader(GLenum stage, const char* source) {
  const GLuint shader = glCreateShader(stage);
  glShaderSource(shader, 1, &source, nullptr);
  glCompileShader(shader);
  return shader;
}

GLuint linkProgram(const char* vertex_source, const char* fragment_source) {
  const GLuint vertex = compileShader(GL_VERTEX_SHADER, vertex_source);
  const GLuint fragment = compileShader(GL_FRAGMENT_SHADER, fragment_source);
  const GLuint program = glCreateProgram();
  glAttachShader(program, vertex);
  glAttachShader(program, fragment);
  glLinkProgram(program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  GLint linked = GL_FALSE;
  glGetProgramiv(program, GL_LINK_STATUS, &linked);
  if (linked != GL_TRUE) {
    std::array<char, 512> log{};
    glGetProgramInfoLog(program, static_cast<GLsizei>(log.size()), nullptr, log.data());
    std::replace(log.begin(), log.end(), '\n', ' ');
    throw Error(std::string("cannot render: the OpenGL driver refused a shader (") + log.data() +
                "); update the graphics driver or Mesa");
  }
  return program;
}

}  // namespace

GLuint makeSurfaceProgram() { return linkProgram(kSurfaceVertexShader, kSurfaceFragmentShader); }

GLuint makeBackgroundProgram() {
  return linkProgram(kBackgroundVertexShader, kBackgroundFragmentShader);
}

GLuint makeLineProgram() { return linkProgram(kLineVertexShader, kLineFragmentShader); }

void setUniform(GLuint program, const char* name, const glm::vec3& value) {
  glUniform3fv(glGetUniformLocation(program, name), 1, &value[0]);
}

}  // namespace isobrick
