// A cloud as a bundle of cloudparity has it, for three.js: what both renderers share. cloud-webgl.js and cloud-webgpu.js make materials of it.
//
// The cloud lies in an Object3D whose axes are Blender's (x right, y away, z up). `frame()` gives one that is turned so that z is three's y.

import {
  BufferAttribute, BufferGeometry, ClampToEdgeWrapping, CustomBlending, DataTexture, Group, Matrix4, Mesh, NearestFilter, NoColorSpace, OneFactor,
  OneMinusSrcAlphaFactor, RGBAFormat, UnsignedByteType, Vector3,
} from "three";

const ask = async (folder, name) => {
  const answer = await fetch(`${folder}/${name}`);
  if (!answer.ok) throw new Error(`${name}: the server answers ${answer.status}. The folder must be served whole.`);
  return answer;
};

// What lies in a folder, with the numbers of its uniforms: `get(block, field, element)`, `set(block, field, values, element)`.
export async function load(folder = ".") {
  const manifest = await (await ask(folder, "cloud.json")).json();
  if (manifest.format !== "cloudparity shader 1") throw new Error(`cloud.json has format "${manifest.format}"; this program reads "cloudparity shader 1".`);
  const { file, width, height } = manifest.data;
  const texels = new Uint8Array(await (await ask(folder, file)).arrayBuffer());
  if (texels.length !== 4 * width * height) throw new Error(`${file} has ${texels.length} bytes; cloud.json says ${4 * width * height}.`);
  const numbers = new Map();
  for (const block of manifest.blocks) {
    block.elements.forEach((fields, element) => fields.forEach((field) => {
      numbers.set(`${block.name} ${element} ${field.name}`, [...field.values]);
    }));
  }
  const known = (block, field, element) => {
    const found = numbers.get(`${block} ${element} ${field}`);
    if (!found) throw new Error(`${block} has no field ${field} in element ${element}; cloud.json says what there is.`);
    return found;
  };
  const cloud = {
    manifest,
    texels,
    text: async (name) => (await ask(folder, name)).text(),
    get: (block, field, element = 0) => [...known(block, field, element)],
    set: (block, field, values, element = 0) => {
      const found = known(block, field, element);
      if (values.length !== found.length) throw new Error(`${block}.${field} has ${found.length} numbers, not ${values.length}.`);
      values.forEach((value, index) => { found[index] = value; });
      cloud.version += 1;
    },
    // Counts changes.
    version: 0,
  };
  return cloud;
}

// An object with Blender's axes in a world whose y is up.
export function frame() {
  const group = new Group();
  group.rotation.x = -Math.PI / 2;
  group.updateMatrixWorld();
  return group;
}

// Gives the cloud the view of a camera of three.js. `object` has Blender's axes and metres.
export function setCamera(cloud, camera, object) {
  const { to_local: rows, unit } = cloud.manifest.camera;
  const [width, height] = cloud.manifest.resolution;
  camera.updateMatrixWorld();
  object.updateMatrixWorld();
  const toBlender = new Matrix4().copy(object.matrixWorld).invert().multiply(camera.matrixWorld);
  const toLocal = new Matrix4().set(...rows.flat());
  const p = camera.projectionMatrix.elements;
  const isParallel = camera.isOrthographicCamera === true;
  // Where a ray of the raster begins and its displacement per metre of depth, in Blender's world. Both are linear in the raster.
  const at = (x, y) => {
    const [u, v] = [(2 * x) / width - 1, (2 * y) / height - 1];
    const place = isParallel ? new Vector3((u - p[12]) / p[0], (v - p[13]) / p[5], 0) : new Vector3();
    const way = isParallel ? new Vector3(0, 0, -1) : new Vector3((u + p[8]) / p[0], (v + p[9]) / p[5], -1);
    const linear = way.applyMatrix4(toBlender).sub(new Vector3().applyMatrix4(toBlender));
    return [place.applyMatrix4(toBlender).addScaledVector(linear, camera.near), linear];
  };
  const zero = new Vector3().applyMatrix4(toLocal);
  const start = (x, y) => at(x, y)[0].applyMatrix4(toLocal);
  const way = (direction) => direction.clone().applyMatrix4(toLocal).sub(zero).multiplyScalar(unit);
  const [corner, across, up] = [[0, 0], [1, 0], [0, 1]].map(([x, y]) => at(x, y)[1]);
  across.sub(corner);
  up.sub(corner);
  const first = start(0, 0);
  const put = (field, vector) => cloud.set("view", field, vector.toArray());
  put("start", first);
  put("start_across", start(1, 0).sub(first));
  put("start_up", start(0, 1).sub(first));
  put("direction", corner);
  put("direction_across", across);
  put("direction_up", up);
  put("way", way(corner));
  put("way_across", way(across));
  put("way_up", way(up));
  cloud.set("view", "farthest", [(camera.far - camera.near) / unit]);
}

// What a camera of three.js needs to see what the scene's camera sees: its place and axes in Blender's world, and its frustum at depth 1.
export function sceneView(cloud) {
  const vector = (field) => new Vector3(...cloud.manifest.blocks.find((block) => block.name === "view").elements[0]
    .find((one) => one.name === field).values);
  const [corner, across, up] = ["direction", "direction_across", "direction_up"].map(vector);
  const [width, height] = cloud.manifest.resolution;
  const right = across.clone().normalize();
  const above = up.clone().normalize();
  const back = right.clone().cross(above);
  const depth = -corner.dot(back);
  return {
    place: new Vector3(...cloud.manifest.camera.place),
    target: new Vector3(...cloud.manifest.camera.target),
    right, above, back,
    isParallel: across.lengthSq() === 0,
    left: corner.dot(right) / depth,
    bottom: corner.dot(above) / depth,
    width: (across.length() * width) / depth,
    height: (up.length() * height) / depth,
  };
}

// The texture that the shader reads: words, not colours.
export function dataTexture(cloud) {
  const { width, height } = cloud.manifest.data;
  const texture = new DataTexture(cloud.texels, width, height, RGBAFormat, UnsignedByteType);
  return Object.assign(texture, {
    colorSpace: NoColorSpace, minFilter: NearestFilter, magFilter: NearestFilter, wrapS: ClampToEdgeWrapping, wrapT: ClampToEdgeWrapping,
    generateMipmaps: false, premultiplyAlpha: false, flipY: false, unpackAlignment: 4, needsUpdate: true,
  });
}

// What a material says that is drawn over what is there, its colours with alpha in them.
export const over = {
  depthTest: false, depthWrite: false, transparent: true,
  blending: CustomBlending, blendSrc: OneFactor, blendDst: OneMinusSrcAlphaFactor, blendSrcAlpha: OneFactor, blendDstAlpha: OneMinusSrcAlphaFactor,
};

// A triangle over the whole picture with a material of either renderer; add it to a scene over which it is drawn.
export function mesh(made) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
  const triangle = new Mesh(geometry, made);
  triangle.frustumCulled = false;
  triangle.onBeforeRender = () => made.refresh();
  return triangle;
}
