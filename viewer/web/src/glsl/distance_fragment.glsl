// The bits of the distance along the view, as bytes: every card can draw and read these.
out vec4 color;
void main() {
  clip(-1);
  uint bits = floatBitsToUint(-eye_position.z);
  color = vec4(uvec4(bits, bits >> 8, bits >> 16, bits >> 24) & 255u) / 255.0;
}
