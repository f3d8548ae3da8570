// The programs: the light of viewer/render/scene_shaders.cpp, in GLSL ES 3.00. Eye coordinates: the
// eye at the origin, +x right, +y up, -z ahead. All light is linear.
import surfaceVertex from './glsl/surface_vertex.glsl';
import clip from './glsl/clip.glsl';
import surfaceFragment from './glsl/surface_fragment.glsl';
import countFragment from './glsl/count_fragment.glsl';
import distanceFragment from './glsl/distance_fragment.glsl';
import capVertex from './glsl/cap_vertex.glsl';
import capFragment from './glsl/cap_fragment.glsl';
import pictureVertex from './glsl/picture_vertex.glsl';
import backgroundFragment from './glsl/background_fragment.glsl';
import screenFragment from './glsl/screen_fragment.glsl';

export const kSurfaceVertexShader = surfaceVertex;
export const kSurfaceFragmentShader = clip + surfaceFragment;
export const kCountFragmentShader = clip + countFragment;
export const kDistanceFragmentShader = clip + distanceFragment;
export const kCapVertexShader = capVertex;
export const kCapFragmentShader = clip + capFragment;
export const kPictureVertexShader = pictureVertex;
export const kBackgroundFragmentShader = backgroundFragment;
export const kScreenFragmentShader = screenFragment;
