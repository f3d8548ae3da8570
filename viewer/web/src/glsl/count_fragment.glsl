// Counts, in the stencil, how often a ray enters and leaves what is behind the plane.
out vec4 color;
void main() {
  clip(-1);
  color = vec4(0.0);
}
