in vec2 place;
uniform int cap_of;
uniform sampler2D values;
uniform bool has_values;
uniform float least;   // shares of the range of values: below it nothing is drawn
uniform vec2 window;  // that are shown black and white
out vec4 color;
void main() {
  clip(cap_of);
  float grey = 0.45;
  if (has_values) {
    vec2 size = vec2(textureSize(values, 0));
    vec4 value = texture(values, (place * (size - 1.0) + 0.5) / size);
    if (value.a < 1.0 || value.r < least) discard;
    grey = clamp((value.r - window.x) / max(window.y - window.x, 1e-6), 0.0, 1.0);
  }
  color = vec4(pow(vec3(grey), vec3(2.0, 2.1, 2.3)), 1.0);  // warm, unlike every surface
}
