// Draws chunks of surfaces with three.js as the window draws them (viewer/render): linear light
// into four samples of half floats, then sRGB. Opaque surfaces, caps, then those seen through.
import * as three from 'three';
import type { PlacedCamera } from './camera';
import { depthRangeOf } from './camera';
import * as shaders from './shaders';
import type { Box, Mat3, Vec3 } from './vector';
import { dot, inverse, length, mapped, product, subtract, times, transposed } from './vector';

// A chunk as the GPU takes it: position = origin + step * positions, in the lattice of the voxels.
export interface DrawnChunk {
  surface: number;
  level: number;
  origin: Vec3;
  step: number;
  lower: Vec3; // of the least box around its positions
  upper: Vec3;
  positions: Uint16Array; // 4 a vertex, of which the last is not used
  normals: Int16Array; // likewise; world, unit = 32767
  triangles: Uint16Array | Uint32Array;
}

export interface SceneSurface {
  color: Vec3; // sRGB
  opacity: number; // 0: not drawn
  isovalue: number;
}

export interface SceneCap {
  plane: number; // that it caps
  corner: Vec3; // world
  across: Vec3;
  along: Vec3;
  values: ImageBitmap | undefined; // grey, and opaque inside the surface
}

export interface SceneFrame {
  camera: PlacedCamera;
  bounds: Box; // of all that is drawn
  lattice: { matrix: Mat3; origin: Vec3 }; // world = origin + matrix * lattice
  surfaces: readonly SceneSurface[];
  color_by_level: boolean;
  clip_planes: readonly { normal: Vec3; offset: number }[];
  caps: readonly SceneCap[];
  background_top: Vec3;
  background_bottom: Vec3;
}

const kLevelColors: readonly Vec3[] = [
  [0.84, 0.24, 0.27],
  [0.96, 0.55, 0.25],
  [0.97, 0.84, 0.42],
  [0.58, 0.77, 0.4],
  [0.24, 0.66, 0.62],
  [0.24, 0.51, 0.8],
  [0.38, 0.34, 0.7],
  [0.6, 0.38, 0.64],
];
const kBackColor: Vec3 = [0.46, 0.2, 0.13];
const kSamples = 4;

const linear = (value: number): number =>
  value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
const linearColor = (srgb: Vec3): three.Vector3 => new three.Vector3(...mapped(srgb, linear));
const matrix3 = (m: Mat3): three.Matrix3 => new three.Matrix3().fromArray(m.flat());

type Uniforms = Record<string, { value: unknown }>;

function program(
  vertex: string,
  fragment: string,
  uniforms: Uniforms,
  rest: three.ShaderMaterialParameters = {},
): three.RawShaderMaterial {
  return new three.RawShaderMaterial({
    glslVersion: three.GLSL3,
    vertexShader: vertex,
    fragmentShader: fragment,
    uniforms,
    ...rest,
  });
}

function fixedMesh(geometry: three.BufferGeometry, material: three.Material): three.Mesh {
  const mesh = new three.Mesh(geometry, material);
  mesh.frustumCulled = false;
  mesh.matrixAutoUpdate = mesh.matrixWorldAutoUpdate = false;
  return mesh;
}

function fixedScene(...objects: three.Object3D[]): three.Scene {
  const scene = new three.Scene();
  scene.matrixWorldAutoUpdate = false;
  if (objects.length > 0) scene.add(...objects);
  return scene;
}

interface KeptChunk {
  mesh: three.Mesh; // its front, and its back if it is opaque
  back: three.Mesh; // drawn if it is seen through
  origin: Vec3;
  step: number;
  surface: number;
  level: number;
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
  private readonly background: three.RawShaderMaterial;
  private readonly background_scene: three.Scene;
  private readonly screen_scene: three.Scene;
  private readonly cap: three.RawShaderMaterial;
  private readonly cap_scene: three.Scene;
  private readonly counters: three.RawShaderMaterial[];
  private readonly distance: three.RawShaderMaterial;
  private readonly textures = new Map<ImageBitmap, three.Texture>();

  // Throws if the browser has no WebGL 2.
  constructor(canvas: HTMLCanvasElement) {
    this.gl = new three.WebGLRenderer({ canvas, antialias: false, depth: false, stencil: false });
    this.gl.autoClear = false;
    this.gl.debug.checkShaderErrors = false;
    this.camera.matrixWorldAutoUpdate = false;
    this.target = new three.WebGLRenderTarget(1, 1, {
      type: this.gl.extensions.has('EXT_color_buffer_float') ? three.HalfFloatType : three.UnsignedByteType,
      samples: kSamples,
      stencilBuffer: true,
      minFilter: three.NearestFilter,
      magFilter: three.NearestFilter,
    });
    const all = new three.BufferGeometry();
    all.setAttribute('position', new three.Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    const flat = { depthTest: false, depthWrite: false };
    this.background = program(
      shaders.kPictureVertexShader,
      shaders.kBackgroundFragmentShader,
      { top: { value: null }, bottom: { value: null }, picture_height: { value: 1 } },
      flat,
    );
    this.background_scene = fixedScene(fixedMesh(all, this.background));
    const screen = program(
      shaders.kPictureVertexShader,
      shaders.kScreenFragmentShader,
      { picture: { value: this.target.texture } },
      flat,
    );
    this.screen_scene = fixedScene(fixedMesh(all, screen));
    // Where more is left than entered behind the plane, the plane is inside.
    this.counters = [three.BackSide, three.FrontSide].map((side) =>
      program(shaders.kSurfaceVertexShader, shaders.kCountFragmentShader, this.uniforms, {
        ...flat,
        side,
        colorWrite: false,
        stencilWrite: true,
        stencilZPass: side === three.BackSide ? three.IncrementWrapStencilOp : three.DecrementWrapStencilOp,
      }),
    );
    this.cap = program(
      shaders.kCapVertexShader,
      shaders.kCapFragmentShader,
      {
        ...this.uniforms,
        corner: { value: new three.Vector3() },
        across: { value: new three.Vector3() },
        along: { value: new three.Vector3() },
        cap_of: { value: 0 },
        values: { value: null },
        has_values: { value: false },
      },
      { side: three.DoubleSide, stencilWrite: true, stencilRef: 0, stencilFunc: three.NotEqualStencilFunc },
    );
    const square = new three.BufferGeometry();
    square.setAttribute('position', new three.Float32BufferAttribute([0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0], 3));
    square.setIndex([0, 1, 2, 2, 1, 3]);
    this.cap_scene = fixedScene(fixedMesh(square, this.cap));
    this.distance = program(shaders.kSurfaceVertexShader, shaders.kDistanceFragmentShader, this.uniforms, {
      side: three.DoubleSide,
      blending: three.NoBlending,
    });
  }

  resize(width: number, height: number): void {
    this.gl.setPixelRatio(1);
    this.gl.setSize(width, height, false);
    this.target.setSize(width, height);
  }

  // The GPU gets it with the next draw(); it is not seen before show().
  add(id: number, chunk: DrawnChunk): void {
    const geometry = new three.BufferGeometry();
    const positions = new three.BufferAttribute(chunk.positions, 4);
    const normals = new three.BufferAttribute(chunk.normals, 4, true);
    geometry.setAttribute('position', positions);
    geometry.setAttribute('normal', normals);
    geometry.setIndex(new three.BufferAttribute(chunk.triangles, 1));
    const box = new three.Box3(new three.Vector3(...chunk.lower), new three.Vector3(...chunk.upper));
    geometry.boundingSphere = box.getBoundingSphere(new three.Sphere());
    for (const attribute of [positions, normals, geometry.index!]) attribute.onUpload(forgetArray);
    geometry.setDrawRange(0, 0);
    const mesh = fixedMesh(geometry, this.materialOf(chunk.surface, chunk.level, three.DoubleSide));
    const back = fixedMesh(geometry, mesh.material as three.Material);
    const { origin, step, surface, level } = chunk;
    this.chunks.set(id, { mesh, back, origin, step, surface, level });
    this.opaque.add(mesh);
  }

  show(id: number): void {
    const chunk = this.chunks.get(id);
    if (chunk === undefined) return;
    chunk.mesh.geometry.setDrawRange(0, Infinity);
    chunk.mesh.frustumCulled = chunk.back.frustumCulled = true;
  }

  hide(id: number): void {
    const geometry = this.chunks.get(id)?.mesh.geometry;
    geometry?.setDrawRange(0, 0);
  }

  remove(id: number): void {
    const chunk = this.chunks.get(id);
    if (chunk === undefined) return;
    chunk.mesh.removeFromParent();
    chunk.back.removeFromParent();
    chunk.mesh.geometry.dispose();
    this.chunks.delete(id);
  }

  draw(frame: SceneFrame): void {
    this.prepare(frame);
    const { gl, target } = this;
    gl.setRenderTarget(target);
    gl.clear(false, true, true);
    this.background.uniforms['top']!.value = linearColor(frame.background_top);
    this.background.uniforms['bottom']!.value = linearColor(frame.background_bottom);
    this.background.uniforms['picture_height']!.value = target.height;
    gl.render(this.background_scene, this.camera);
    gl.render(this.opaque, this.camera);
    for (const cap of frame.caps) this.drawCap(frame, cap);
    gl.render(this.clear, this.camera);
    gl.setRenderTarget(null);
    gl.render(this.screen_scene, this.camera);
    for (const [bitmap, texture] of this.textures) {
      if (frame.caps.some((cap) => cap.values === bitmap)) continue;
      texture.dispose();
      this.textures.delete(bitmap);
    }
  }

  // Along the view, of the surface at a place of the frame drawn last (normalised device
  // coordinates); none: there is only background.
  async distanceAt(frame: SceneFrame, place: readonly [number, number]): Promise<number | undefined> {
    this.prepare(frame);
    const { gl, camera, picked } = this;
    const whole = camera.projectionMatrix.clone();
    // The pixel becomes the whole picture.
    const { width, height } = this.target;
    camera.projectionMatrix.premultiply(
      new three.Matrix4().set(width, 0, 0, -place[0] * width, 0, height, 0, -place[1] * height, 0, 0, 1, 0, 0, 0, 0, 1),
    );
    gl.setRenderTarget(picked);
    gl.setClearColor(0, 0);
    gl.clear(true, true, false);
    for (const scene of [this.opaque, this.clear]) {
      scene.overrideMaterial = this.distance;
      gl.render(scene, camera);
      scene.overrideMaterial = null;
    }
    camera.projectionMatrix.copy(whole);
    gl.setRenderTarget(null);
    const bytes = new Uint8Array(4);
    await gl.readRenderTargetPixelsAsync(picked, 0, 0, 1, 1, bytes);
    const distance = new DataView(bytes.buffer).getFloat32(0, true);
    return distance === 0 ? undefined : distance;
  }

  private prepare(frame: SceneFrame): void {
    const { camera, lattice } = frame;
    const { near, far } = depthRangeOf(frame.bounds, camera);
    const { half_width: w, half_height: h } = camera;
    const p = this.camera.projectionMatrix;
    if (camera.orthographic)
      p.set(1 / w, 0, 0, 0, 0, 1 / h, 0, 0, 0, 0, -2 / (far - near), -(far + near) / (far - near), 0, 0, 0, 1);
    else
      p.set(1 / w, 0, 0, 0, 0, 1 / h, 0, 0, 0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near), 0, 0, -1, 0);
    this.camera.projectionMatrixInverse.copy(p).invert();
    const to_eye = transposed([camera.right, camera.up, mapped(camera.forward, (v) => -v)]);
    const lattice_to_eye = product(to_eye, lattice.matrix);
    const eye = times(inverse(lattice.matrix), subtract(camera.eye, lattice.origin));
    const snapped = this.snap(eye, frame);
    const rest = subtract(eye, snapped);
    const u = this.uniforms;
    u.eye_rest.value.set(...rest);
    u.lattice_to_eye.value.copy(matrix3(lattice_to_eye));
    u.world_to_eye.value.copy(matrix3(to_eye));
    u.orthographic.value = camera.orthographic;
    u.clip_count.value = frame.clip_planes.length;
    frame.clip_planes.forEach((plane, i) =>
      u.clip_planes.value[i]!.set(...times(to_eye, plane.normal), dot(plane.normal, camera.eye) - plane.offset),
    );
    // For culling alone: the programs do the same without losing digits.
    const turn = new three.Matrix4().setFromMatrix3(u.lattice_to_eye.value);
    this.camera.matrixWorldInverse.copy(turn.multiply(new three.Matrix4().makeTranslation(-rest[0], -rest[1], -rest[2])));
    // From the outermost, whose isovalue is the least, to the innermost.
    const order = frame.surfaces.map((_, i) => i).sort((a, b) => frame.surfaces[a]!.isovalue - frame.surfaces[b]!.isovalue);
    for (const chunk of this.chunks.values()) this.place(chunk, snapped, frame, order.indexOf(chunk.surface));
    for (const [key, material] of this.materials) {
      const [surface = 0, level = 0] = key.split(' ').map(Number);
      const shown = frame.surfaces[surface];
      const color = linearColor(
        frame.color_by_level ? kLevelColors[Math.min(level, 7)]! : (shown?.color ?? kBackColor),
      );
      material.uniforms['surface_color']!.value.set(...color.toArray(), shown?.opacity ?? 0);
    }
  }

  private place(chunk: KeptChunk, snapped: Vec3, frame: SceneFrame, depth: number): void {
    const { mesh, back } = chunk;
    const opacity = frame.surfaces[chunk.surface]?.opacity ?? 0;
    const [x, y, z] = subtract(chunk.origin, snapped);
    mesh.matrixWorld.makeScale(chunk.step, chunk.step, chunk.step).setPosition(x, y, z);
    mesh.visible = back.visible = opacity > 0;
    const scene = opacity < 1 ? this.clear : this.opaque;
    if (mesh.parent !== scene) {
      scene.add(mesh);
      back.removeFromParent();
      if (scene === this.clear) scene.add(back);
      const side = scene === this.clear ? three.FrontSide : three.DoubleSide;
      mesh.material = this.materialOf(chunk.surface, chunk.level, side);
      back.material = this.materialOf(chunk.surface, chunk.level, three.BackSide);
    }
    if (scene !== this.clear) return;
    // Surfaces lie within each other: the backs from the outermost in, then the fronts out.
    back.matrixWorld.copy(mesh.matrixWorld);
    back.renderOrder = depth;
    mesh.renderOrder = 100 - depth;
  }

  private materialOf(surface: number, level: number, side: three.Side): three.RawShaderMaterial {
    const key = `${surface} ${level} ${side}`;
    let material = this.materials.get(key);
    if (material === undefined) {
      const is_clear = side !== three.DoubleSide;
      material = program(
        shaders.kSurfaceVertexShader,
        shaders.kSurfaceFragmentShader,
        { ...this.uniforms, surface_color: { value: new three.Vector4() } },
        { side, transparent: is_clear, depthWrite: !is_clear },
      );
      this.materials.set(key, material);
    }
    return material;
  }

  // A place near the eye from which the origin of every chunk is away by a float without rounding
  // (viewer/stream/surface_chunk.cpp, snapEye).
  private snap(eye: Vec3, frame: SceneFrame): Vec3 {
    const lattice = inverse(frame.lattice.matrix);
    const reach = Math.max(
      1,
      ...[frame.bounds.lower, frame.bounds.upper].map((corner) =>
        2 * length(subtract(times(lattice, subtract(corner, frame.lattice.origin)), eye)),
      ),
    );
    const step = Math.min(1, 2 ** (Math.ceil(Math.log2(reach)) - 23));
    return mapped(eye, (value) => Math.round(value / step) * step);
  }

  private drawCap(frame: SceneFrame, cap: SceneCap): void {
    const { gl } = this;
    gl.clear(false, false, true);
    if (cap.values === undefined)
      for (const counter of this.counters)
        for (const scene of [this.opaque, this.clear]) {
          scene.overrideMaterial = counter;
          gl.render(scene, this.camera);
          scene.overrideMaterial = null;
        }
    const to_eye = transposed([frame.camera.right, frame.camera.up, mapped(frame.camera.forward, (v) => -v)]);
    const u = this.cap.uniforms;
    u['corner']!.value.set(...times(to_eye, subtract(cap.corner, frame.camera.eye)));
    u['across']!.value.set(...times(to_eye, cap.across));
    u['along']!.value.set(...times(to_eye, cap.along));
    u['cap_of']!.value = cap.plane;
    u['has_values']!.value = cap.values !== undefined;
    u['values']!.value = cap.values === undefined ? null : this.textureOf(cap.values);
    this.cap.stencilFunc = cap.values === undefined ? three.NotEqualStencilFunc : three.AlwaysStencilFunc;
    this.cap.uniformsNeedUpdate = true;
    gl.render(this.cap_scene, this.camera);
  }

  private textureOf(bitmap: ImageBitmap): three.Texture {
    let texture = this.textures.get(bitmap);
    if (texture === undefined) {
      texture = new three.Texture(bitmap as unknown as HTMLImageElement);
      texture.flipY = false;
      texture.generateMipmaps = false;
      texture.minFilter = texture.magFilter = three.LinearFilter;
      texture.needsUpdate = true;
      this.textures.set(bitmap, texture);
    }
    return texture;
  }
}

// The GPU has it: the page keeps no second copy.
function forgetArray(this: three.BufferAttribute): void {
  (this as { array: unknown }).array = new Uint8Array(0);
}
