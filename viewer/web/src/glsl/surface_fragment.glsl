in vec3 eye_normal;
uniform bool orthographic;
uniform vec3 back_color;
uniform vec3 key_direction;
uniform vec4 surface_color;
out vec4 color;
const vec3 kSkyLight = vec3(0.20, 0.22, 0.25);
const vec3 kGroundLight = vec3(0.09, 0.08, 0.07);

void main() {
  clip(-1);
  vec3 to_eye = orthographic ? vec3(0.0, 0.0, 1.0) : normalize(-eye_position);
  float length_of_normal = length(eye_normal);
  vec3 normal = length_of_normal > 1e-6 ? eye_normal / length_of_normal : to_eye;
  if (!gl_FrontFacing && dot(normal, to_eye) < 0.0) normal = -normal;
  vec3 surface = gl_FrontFacing ? surface_color.rgb : back_color;
  float head = max(dot(normal, to_eye), 0.0);
  float key = max(dot(normal, key_direction), 0.0);
  vec3 light = mix(kGroundLight, kSkyLight, 0.5 + 0.5 * normal.y) + 0.24 * head +
               vec3(0.70, 0.68, 0.64) * key;
  vec3 shaded = surface * light;
  if (gl_FrontFacing) {
    float gloss = pow(max(dot(normal, normalize(key_direction + to_eye)), 0.0), 48.0);
    shaded += 0.10 * gloss * key;
  } else {
    shaded *= 0.6;
  }
  color = vec4(shaded, surface_color.a);
}
