// In front of the fragment programs of what clip planes cut.
precision highp float;
precision highp int;
uniform vec4 clip_planes[6];
uniform int clip_count;
in vec3 eye_position;

void clip(int uncut_plane) {
  for (int i = 0; i < 6; ++i)
    if (i < clip_count && i != uncut_plane &&
        dot(clip_planes[i].xyz, eye_position) + clip_planes[i].w < 0.0) discard;
}
