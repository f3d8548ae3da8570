// The programs: the light of viewer/render/scene_shaders.cpp, in GLSL ES 3.00. Eye coordinates: the
// eye at the origin, +x right, +y up, -z ahead. All light is linear.
import clip from './glsl/clip.glsl';
import surfaceFragment from './glsl/surface_fragment.glsl';
import countFragment from './glsl/count_fragment.glsl';
import distanceFragment from './glsl/distance_fragment.glsl';
import capFragment from './glsl/cap_fragment.glsl';

export { default as kSurfaceVertexShader } from './glsl/surface_vertex.glsl';
export { default as kCapVertexShader } from './glsl/cap_vertex.glsl';
export { default as kPictureVertexShader } from './glsl/picture_vertex.glsl';
export { default as kBackgroundFragmentShader } from './glsl/background_fragment.glsl';
export { default as kScreenFragmentShader } from './glsl/screen_fragment.glsl';
export const kSurfaceFragmentShader = clip + surfaceFragment;
export const kCountFragmentShader = clip + countFragment;
export const kDistanceFragmentShader = clip + distanceFragment;
export const kCapFragmentShader = clip + capFragment;
