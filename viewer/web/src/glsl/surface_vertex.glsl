// position * step + offset is one rounded sum from the snapped eye (viewer/stream/surface_chunk.h,
// SnappedEye), so chunks that share a vertex give it the same bits from here on. The model's matrix
// has the step and the offset.
precision highp float;
precision highp int;
in vec4 position;  // the last: bits above the 16 of each, five an axis
in vec3 normal;
uniform mat4 modelMatrix;
uniform mat4 projectionMatrix;
uniform vec3 eye_rest;  // in the lattice
uniform mat3 lattice_to_eye;
uniform mat3 world_to_eye;
out vec3 eye_position;
out vec3 eye_normal;

void main() {
  int high = int(position.w);
  vec3 place = position.xyz + 65536.0 * vec3(high & 31, (high >> 5) & 31, (high >> 10) & 31);
  vec3 from_snapped_eye = place * modelMatrix[0][0] + modelMatrix[3].xyz;
  eye_position = lattice_to_eye * from_snapped_eye - lattice_to_eye * eye_rest;
  eye_normal = world_to_eye * normal;
  gl_Position = projectionMatrix * vec4(eye_position, 1.0);
}
