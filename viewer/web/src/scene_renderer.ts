// Draws chunks of surfaces with three.js as the window draws them (viewer/render): linear light
// into four samples of half floats, then sRGB. Opaque surfaces, caps, then those seen through.
import * as three from 'three';
import { depthRangeOf, type Place, type PlacedCamera } from './camera';
import type { UnpackedChunk } from './chunk_message';
import * as shaders from './shaders';
import { dot, inverse, length, mapped, product, subtract, times, transposed } from './vector';
import type { Box, Mat3, Vec3 } from './vector';

// A chunk as the GPU takes it: position = origin + step * positions, in the lattice of the scene.
export interface DrawnChunk extends Omit<UnpackedChunk, 'id' | 'volume' | 'positions'> {
  step: number;
  positions: Uint16Array | Float32Array;
}

export interface SceneCap {
  plane: number; // that it caps
  corner: Vec3; // world
  across: Vec3;
  along: Vec3;
  values: ImageBitmap | undefined; // grey, as shares of the range of values; opaque where there are any
  least: number; // such a share, which the inside of the surface has at least
  window: readonly [number, number]; // that are shown black and white
}

export interface SceneFrame {
  camera: PlacedCamera;
  bounds: Box; // of all that is drawn
  lattice: { matrix: Mat3; origin: Vec3 }; // world = origin + matrix * lattice
  // By number; others are not drawn, nor those of opacity 0. Volumes are by their place: 0 has the caps.
  surfaces: ReadonlyMap<number, { color: Vec3; opacity: number; isovalue: number; volume: number }>;
  color_by_level: boolean;
  clip_planes: readonly { normal: Vec3; offset: number }[];
  caps: readonly SceneCap[];
  background_top: Vec3; // colours are sRGB
  background_bottom: Vec3;
}

const kLevelColors: readonly Vec3[] = [
  [0.84, 0.24, 0.27], [0.96, 0.55, 0.25], [0.97, 0.84, 0.42], [0.58, 0.77, 0.4],
  [0.24, 0.66, 0.62], [0.24, 0.51, 0.8], [0.38, 0.34, 0.7], [0.6, 0.38, 0.64],
];
const kBackColor: Vec3 = [0.46, 0.2, 0.13];
const kSamples = 4;
const kWithoutCaps = 1; // the layer of what they do not close
const kFlat = { depthTest: false, depthWrite: false };

const linear = (value: number): number => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
const linearColor = (srgb: Vec3): three.Vector3 => new three.Vector3(...mapped(srgb, linear));
const matrix3 = (m: Mat3): three.Matrix3 => new three.Matrix3().fromArray(m.flat());

type Uniforms = Record<string, { value: unknown }>;

type Rest = three.ShaderMaterialParameters;
const program = (vertexShader: string, fragmentShader: string, uniforms: Uniforms, rest: Rest = {}) =>
  new three.RawShaderMaterial({ glslVersion: three.GLSL3, vertexShader, fragmentShader, uniforms, ...rest });

function fixedMesh(geometry: three.BufferGeometry, material: three.Material): three.Mesh {
  const mesh = new three.Mesh(geometry, material);
  mesh.frustumCulled = mesh.matrixAutoUpdate = mesh.matrixWorldAutoUpdate = false;
  return mesh;
}

function fixedScene(mesh?: three.Mesh): three.Scene {
  const scene = new three.Scene();
  scene.matrixWorldAutoUpdate = false;
  return mesh ? scene.add(mesh) : scene;
}

function shape(places: number[], triangles: number[]): three.BufferGeometry {
  const geometry = new three.BufferGeometry();
  geometry.setAttribute('position', new three.Float32BufferAttribute(places, 3));
  geometry.setIndex(triangles);
  return geometry;
}

interface KeptChunk extends Pick<DrawnChunk, 'origin' | 'step' | 'surface' | 'level'> {
  mesh: three.Mesh; // its front, and its back if it is opaque
  back: three.Mesh; // drawn if it is seen through
  is_shown: boolean;
  is_new: boolean; // the GPU has not got it
}

export class SceneRenderer {
  private readonly gl: three.WebGLRenderer;
  private readonly camera = new three.Camera();
  private readonly target: three.WebGLRenderTarget;
  private readonly picked = new three.WebGLRenderTarget(1, 1);
  private readonly opaque = fixedScene();
  private readonly clear = fixedScene();
  private readonly chunks = new Map<number, KeptChunk>();
  private readonly materials = new Map<string, three.RawShaderMaterial>();
  private readonly textures = new Map<ImageBitmap, three.Texture>();
  private to_eye: Mat3 = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  private readonly uniforms = {
    eye_rest: { value: new three.Vector3() },
    lattice_to_eye: { value: new three.Matrix3() },
    world_to_eye: { value: new three.Matrix3() },
    orthographic: { value: false },
    clip_planes: { value: [0, 1, 2, 3, 4, 5].map(() => new three.Vector4()) },
    clip_count: { value: 0 },
    back_color: { value: linearColor(kBackColor) },
    key_direction: { value: new three.Vector3(-0.55, 0.75, 0.6).normalize() },
  };
  private readonly ground = { top: { value: {} }, bottom: { value: {} }, picture_height: { value: 1 } };
  private readonly ground_scene: three.Scene;
  private readonly screen_scene: three.Scene;
  private readonly cap_place = {
    corner: { value: new three.Vector3() }, across: { value: new three.Vector3() }, along: { value: new three.Vector3() },
    cap_of: { value: 0 }, least: { value: 0 }, window: { value: new three.Vector2() },
    values: { value: null as three.Texture | null }, has_values: { value: false },
  };
  private readonly cap: three.RawShaderMaterial;
  private readonly cap_scene: three.Scene;
  private readonly counters: three.RawShaderMaterial[];
  private readonly distance: three.RawShaderMaterial;

  // Throws if the browser has no WebGL 2.
  constructor(canvas: HTMLCanvasElement) {
    this.gl = new three.WebGLRenderer({ canvas, antialias: false, depth: false, stencil: false });
    this.gl.autoClear = this.gl.debug.checkShaderErrors = false;
    this.gl.setClearColor(0, 0);
    this.camera.matrixWorldAutoUpdate = false;
    this.camera.layers.enable(kWithoutCaps);
    this.target = new three.WebGLRenderTarget(1, 1, {
      type: this.gl.extensions.has('EXT_color_buffer_float') ? three.HalfFloatType : three.UnsignedByteType,
      samples: kSamples,
      stencilBuffer: true,
      minFilter: three.NearestFilter,
      magFilter: three.NearestFilter,
    });
    const all = shape([-1, -1, 0, 3, -1, 0, -1, 3, 0], [0, 1, 2]);
    const picture = { picture: { value: this.target.texture } };
    const ground = program(shaders.kPictureVertexShader, shaders.kBackgroundFragmentShader, this.ground, kFlat);
    const screen = program(shaders.kPictureVertexShader, shaders.kScreenFragmentShader, picture, kFlat);
    this.ground_scene = fixedScene(fixedMesh(all, ground));
    this.screen_scene = fixedScene(fixedMesh(all, screen));
    // Where a ray leaves more than it enters behind the plane, the plane is inside.
    this.counters = [three.BackSide, three.FrontSide].map((side) => {
      const stencilZPass = side === three.BackSide ? three.IncrementWrapStencilOp : three.DecrementWrapStencilOp;
      const rest = { ...kFlat, side, colorWrite: false, stencilWrite: true, stencilZPass };
      return program(shaders.kSurfaceVertexShader, shaders.kCountFragmentShader, this.uniforms, rest);
    });
    const of_cap = { ...this.uniforms, ...this.cap_place };
    const both = { side: three.DoubleSide };
    this.cap = program(shaders.kCapVertexShader, shaders.kCapFragmentShader, of_cap, { ...both, stencilWrite: true });
    const square = shape([0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0], [0, 1, 2, 2, 1, 3]);
    this.cap_scene = fixedScene(fixedMesh(square, this.cap));
    const bytes = { ...both, blending: three.NoBlending };
    this.distance = program(shaders.kSurfaceVertexShader, shaders.kDistanceFragmentShader, this.uniforms, bytes);
    // The driver makes the programs beside, while the first chunks are on their way.
    const sides = [three.DoubleSide, three.FrontSide, three.BackSide];
    const first = fixedScene().add(...sides.map((side) => fixedMesh(all, this.materialOf(0, 0, side))));
    this.gl.setRenderTarget(this.target);
    for (const scene of [first, this.ground_scene, this.cap_scene]) this.gl.compile(scene, this.camera);
  }

  resize(width: number, height: number): void {
    this.gl.setSize(width, height, false);
    this.target.setSize(width, height);
  }

  // The GPU gets it with the next draw(); it is not seen before show().
  add(id: number, chunk: DrawnChunk): void {
    const geometry = new three.BufferGeometry();
    geometry.setAttribute('position', new three.BufferAttribute(chunk.positions, 4));
    geometry.setAttribute('normal', new three.BufferAttribute(chunk.normals, 4, true));
    geometry.setIndex(new three.BufferAttribute(chunk.triangles, 1));
    for (const attribute of [...Object.values(geometry.attributes), geometry.index!])
      (attribute as three.BufferAttribute).onUpload(forgetArray);
    const box = new three.Box3(new three.Vector3(...chunk.lower), new three.Vector3(...chunk.upper));
    geometry.boundingSphere = box.getBoundingSphere(new three.Sphere());
    const mesh = fixedMesh(geometry, this.materialOf(chunk.surface, chunk.level, three.DoubleSide));
    const back = fixedMesh(geometry, mesh.material as three.Material);
    const { origin, step, surface, level } = chunk;
    this.chunks.set(id, { mesh, back, origin, step, surface, level, is_shown: false, is_new: true });
    this.opaque.add(mesh);
  }

  show(id: number, is_shown: boolean): void {
    const chunk = this.chunks.get(id);
    if (chunk !== undefined) chunk.is_shown = is_shown;
  }

  remove(id: number): void {
    const chunk = this.chunks.get(id);
    chunk?.mesh.removeFromParent();
    chunk?.back.removeFromParent();
    chunk?.mesh.geometry.dispose();
    this.chunks.delete(id);
  }

  draw(frame: SceneFrame): void {
    this.prepare(frame);
    const { gl, target, camera } = this;
    gl.setRenderTarget(target);
    gl.clear(false, true, true);
    this.ground.top.value = linearColor(frame.background_top);
    this.ground.bottom.value = linearColor(frame.background_bottom);
    this.ground.picture_height.value = target.height;
    gl.render(this.ground_scene, camera);
    gl.render(this.opaque, camera);
    for (const cap of frame.caps) this.drawCap(frame, cap);
    gl.render(this.clear, camera);
    gl.setRenderTarget(null);
    gl.render(this.screen_scene, camera);
    for (const [bitmap, texture] of this.textures) {
      if (frame.caps.some((cap) => cap.values === bitmap)) continue;
      texture.dispose();
      this.textures.delete(bitmap);
    }
  }

  // Along the view, of the surface at a place; 0: there is only background.
  async distanceAt(frame: SceneFrame, place: Place): Promise<number> {
    this.prepare(frame);
    const { gl, camera, picked } = this;
    // The pixel becomes the whole picture.
    const { width: w, height: h } = this.target;
    const pixel = new three.Matrix4().set(w, 0, 0, -place[0] * w, 0, h, 0, -place[1] * h, 0, 0, 1, 0, 0, 0, 0, 1);
    camera.projectionMatrix.premultiply(pixel);
    gl.setRenderTarget(picked);
    gl.clear(true, true, false);
    this.drawSurfaces(this.distance);
    gl.setRenderTarget(null);
    const bytes = new Uint8Array(4);
    await gl.readRenderTargetPixelsAsync(picked, 0, 0, 1, 1, bytes);
    return new DataView(bytes.buffer).getFloat32(0, true);
  }

  private drawSurfaces(material: three.Material): void {
    for (const scene of [this.opaque, this.clear]) {
      scene.overrideMaterial = material;
      this.gl.render(scene, this.camera);
      scene.overrideMaterial = null;
    }
  }

  private prepare(frame: SceneFrame): void {
    const { camera, lattice } = frame;
    const { near, far } = depthRangeOf(frame.bounds, camera);
    const { half_width: w, half_height: h } = camera;
    const deep = far - near;
    const [scale, offset] = camera.orthographic ? [-2, -(far + near)] : [-(far + near), -2 * far * near];
    const [ahead, one] = camera.orthographic ? [0, 1] : [-1, 0];
    const p = this.camera.projectionMatrix;
    p.set(1 / w, 0, 0, 0, 0, 1 / h, 0, 0, 0, 0, scale / deep, offset / deep, 0, 0, ahead, one);
    this.camera.projectionMatrixInverse.copy(p).invert();
    this.to_eye = transposed([camera.right, camera.up, mapped(camera.forward, (v) => -v)]);
    const to_lattice = inverse(lattice.matrix);
    const toLattice = (point: Vec3): Vec3 => times(to_lattice, subtract(point, lattice.origin));
    const eye = toLattice(camera.eye);
    const ends = [frame.bounds.lower, frame.bounds.upper];
    const snapped = snapEye(eye, 2 * Math.max(...ends.map((end) => length(subtract(toLattice(end), eye)))));
    const rest = subtract(eye, snapped);
    const u = this.uniforms;
    u.eye_rest.value.set(...rest);
    u.lattice_to_eye.value.copy(matrix3(product(this.to_eye, lattice.matrix)));
    u.world_to_eye.value.copy(matrix3(this.to_eye));
    u.orthographic.value = camera.orthographic;
    u.clip_count.value = frame.clip_planes.length;
    frame.clip_planes.forEach(({ normal, offset }, i) =>
      u.clip_planes.value[i]!.set(...times(this.to_eye, normal), dot(normal, camera.eye) - offset),
    );
    // For culling alone: the programs do the same without losing digits.
    const turn = new three.Matrix4().setFromMatrix3(u.lattice_to_eye.value);
    this.camera.matrixWorldInverse.makeTranslation(-rest[0], -rest[1], -rest[2]).premultiply(turn);
    // From the outermost, whose isovalue is the least, to the innermost.
    const nested = [...frame.surfaces].sort(([, a], [, b]) => a.volume - b.volume || a.isovalue - b.isovalue);
    const order = nested.map(([number]) => number);
    for (const chunk of this.chunks.values()) this.place(chunk, snapped, frame, order.indexOf(chunk.surface));
    for (const [key, material] of this.materials) {
      const [surface = 0, level = 0] = key.split(' ').map(Number);
      const look = frame.surfaces.get(surface) ?? { color: kBackColor, opacity: 0 };
      const color = linearColor(frame.color_by_level ? kLevelColors[Math.min(level, 7)]! : look.color);
      material.uniforms['surface_color']!.value.set(color.x, color.y, color.z, look.opacity);
    }
  }

  private place(chunk: KeptChunk, snapped: Vec3, frame: SceneFrame, depth: number): void {
    const { mesh, back, step, surface, level, is_new } = chunk;
    const { opacity, volume } = frame.surfaces.get(surface) ?? { opacity: 0, volume: 0 };
    const is_drawn = chunk.is_shown && opacity > 0;
    chunk.is_new = false;
    mesh.matrixWorld.makeScale(step, step, step).setPosition(...subtract(chunk.origin, snapped));
    back.matrixWorld.copy(mesh.matrixWorld);
    mesh.geometry.setDrawRange(0, is_drawn ? Infinity : 0);
    mesh.visible = back.visible = is_drawn || is_new;
    mesh.frustumCulled = back.frustumCulled = !is_new; // that goes to the GPU in any case
    mesh.layers.set(volume === 0 ? 0 : kWithoutCaps);
    back.layers.mask = mesh.layers.mask;
    // Surfaces lie within each other: the backs from the outermost in, then the fronts out.
    back.renderOrder = depth;
    mesh.renderOrder = opacity < 1 ? 100 - depth : 0;
    const scene = opacity < 1 ? this.clear : this.opaque;
    if (mesh.parent === scene) return;
    scene.add(mesh);
    back.removeFromParent();
    if (scene === this.clear) scene.add(back);
    mesh.material = this.materialOf(surface, level, scene === this.clear ? three.FrontSide : three.DoubleSide);
    back.material = this.materialOf(surface, level, three.BackSide);
  }

  private materialOf(surface: number, level: number, side: three.Side): three.RawShaderMaterial {
    const key = `${surface} ${level} ${side}`;
    const is_clear = side !== three.DoubleSide;
    const uniforms = { ...this.uniforms, surface_color: { value: new three.Vector4() } };
    const rest = { side, transparent: is_clear, depthWrite: !is_clear };
    const made = this.materials.get(key);
    const material = made ?? program(shaders.kSurfaceVertexShader, shaders.kSurfaceFragmentShader, uniforms, rest);
    this.materials.set(key, material);
    return material;
  }

  private drawCap(frame: SceneFrame, cap: SceneCap): void {
    const { gl, to_eye, cap_place } = this;
    gl.clear(false, false, true);
    const { values } = cap;
    this.camera.layers.disable(kWithoutCaps);
    if (!values) this.counters.forEach((counter) => this.drawSurfaces(counter));
    this.camera.layers.enable(kWithoutCaps);
    cap_place.corner.value.set(...times(to_eye, subtract(cap.corner, frame.camera.eye)));
    cap_place.across.value.set(...times(to_eye, cap.across));
    cap_place.along.value.set(...times(to_eye, cap.along));
    cap_place.cap_of.value = cap.plane;
    cap_place.least.value = cap.least;
    cap_place.window.value.set(...cap.window);
    cap_place.has_values.value = values !== undefined;
    cap_place.values.value = values ? this.textureOf(values) : null;
    this.cap.stencilFunc = values ? three.AlwaysStencilFunc : three.NotEqualStencilFunc;
    this.cap.uniformsNeedUpdate = true;
    gl.render(this.cap_scene, this.camera);
  }

  private textureOf(bitmap: ImageBitmap): three.Texture {
    const texture = this.textures.get(bitmap) ?? new three.Texture(bitmap);
    if (this.textures.has(bitmap)) return texture;
    texture.flipY = texture.generateMipmaps = false;
    texture.minFilter = texture.magFilter = three.LinearFilter;
    texture.needsUpdate = true;
    this.textures.set(bitmap, texture);
    return texture;
  }
}

// A place near the eye from which the origin of every chunk within reach is away by a float without
// rounding (viewer/stream/surface_chunk.h). Origins are multiples of a power of two that it divides.
function snapEye(eye: Vec3, reach: number): Vec3 {
  const step = 2 ** Math.min(0, Math.ceil(Math.log2(Math.max(1, reach))) - 23);
  return mapped(eye, (value) => Math.round(value / step) * step);
}

// The GPU has it: the page keeps no second copy.
function forgetArray(this: three.BufferAttribute): void {
  this.array = new Uint8Array(0);
}
