// A cap: the values of the volume on the cut, or one grey until they have come.
precision highp float;
in vec2 position;  // shares of across and along
uniform mat4 projectionMatrix;
uniform vec3 corner;
uniform vec3 across;
uniform vec3 along;
out vec3 eye_position;
out vec2 place;
void main() {
  place = position;
  eye_position = corner + position.x * across + position.y * along;
  gl_Position = projectionMatrix * vec4(eye_position, 1.0);
}
