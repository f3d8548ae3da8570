precision highp float;
uniform vec3 top;
uniform vec3 bottom;
uniform float picture_height;
out vec4 color;
void main() {
  vec3 root = mix(sqrt(bottom), sqrt(top), gl_FragCoord.y / picture_height);
  color = vec4(root * root, 1.0);
}
