// The page: the cloud in three.js, gone around with the mouse. `window.host` is for programs that look at it.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { frame, load, mesh, sceneView, setCamera } from "./cloud.js";

const status = document.getElementById("status");
const fail = (error) => { status.className = "failed"; status.textContent = error.message; console.error(error); };

async function start() {
  const cloud = await load(".");
  const [width, height] = cloud.manifest.resolution;
  document.getElementById("title").textContent = `${cloud.manifest.scene}, ${cloud.manifest.model}`;
  const canvas = document.getElementById("picture");
  const isWebGPU = new URLSearchParams(location.search).get("renderer") === "webgpu";
  let renderer, kind, library, lost;
  if (isWebGPU) {
    if (!navigator.gpu) throw new Error("This browser has no WebGPU: take the renderer for WebGL 2.");
    library = await import("three/webgpu");
    kind = await import("./cloud-webgpu.js");
    renderer = new library.WebGPURenderer({ canvas, antialias: false, alpha: true });
    await renderer.init();
    if (!renderer.backend.isWebGPUBackend) throw new Error("The browser has WebGPU but gives no graphics adapter: take the renderer for WebGL 2.");
  } else {
    library = THREE;
    kind = await import("./cloud-webgl.js");
    renderer = new THREE.WebGLRenderer({ canvas, antialias: false, alpha: true });
    canvas.addEventListener("webglcontextlost", () => {
      lost = new Error("The browser has taken the graphics context back, as it does where a shader takes too long: reload the page, or take WebGPU.");
      fail(lost);
    });
    if (!renderer.extensions.has("EXT_color_buffer_float")) throw new Error("This adapter draws no pictures of floats (EXT_color_buffer_float).");
  }
  renderer.setSize(width, height, false);
  const made = await kind.material(cloud);
  const scene = new library.Scene();
  scene.add(mesh(made));
  const target = new (isWebGPU ? library.RenderTarget : library.WebGLRenderTarget)(width, height, {
    type: THREE.FloatType, format: THREE.RGBAFormat, colorSpace: THREE.LinearSRGBColorSpace, depthBuffer: false,
    minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter,
  });
  // What the target's clear has left: nothing has to be blended, which not every adapter can do with floats.
  made.blending = THREE.NoBlending;
  const flat = new library.OrthographicCamera(-1, 1, 1, -1, 0, 1);

  // The scene's camera in three's world.
  const object = frame();
  const view = sceneView(cloud);
  const turned = (vector) => vector.clone().applyMatrix4(object.matrixWorld);
  const { near, far } = cloud.manifest.camera;
  const camera = view.isParallel
    ? new THREE.OrthographicCamera(view.left, view.left + view.width, view.bottom + view.height, view.bottom, near, far)
    : new THREE.PerspectiveCamera((360 / Math.PI) * Math.atan(view.height / 2), width / height, near, far);
  camera.position.copy(turned(view.place));
  // A camera that is not rolled goes around the vertical.
  if (Math.abs(view.right.z) > 1e-4) camera.up.copy(turned(view.above));
  camera.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(turned(view.right), turned(view.above), turned(view.back)));
  const own = new Map(["start", "start_across", "start_up", "way", "way_across", "way_up", "direction", "direction_across", "direction_up", "farthest"]
    .map((field) => [field, cloud.get("view", field)]));

  const host = { cloud, renderer, camera, setCamera: () => setCamera(cloud, camera, object) };
  window.host = host;
  // The scene's own view, as it was published.
  host.home = () => own.forEach((values, field) => cloud.set("view", field, values));

  // A picture in a texture of floats, some rows at a time so that a software adapter answers in between; then the canvas.
  host.draw = async () => {
    const begin = performance.now();
    const rows = Math.max(1, Math.floor(cloud.manifest.pixels_together / width));
    made.refresh();
    renderer.setRenderTarget(target);
    renderer.autoClear = false;
    target.scissorTest = false;
    renderer.setClearColor(0x000000, 0);
    await renderer.clear();
    target.scissorTest = true;
    // The renderer for WebGPU takes a target's rectangle, but its own word on whether it holds.
    if (isWebGPU) renderer.setScissorTest(true);
    for (let row = 0; row < height; row += rows) {
      if (lost) throw lost;
      target.scissor.set(0, row, width, Math.min(rows, height - row));
      renderer.setRenderTarget(target);
      renderer.render(scene, flat);
      // A browser gathers what WebGL is told, and gives a context up whose gathered work takes seconds: reading a pixel has it done now.
      if (!isWebGPU) await host.read(1, 1);
      if (row % (8 * rows) === 0) await new Promise((done) => { setTimeout(done); });
    }
    renderer.setRenderTarget(null);
    if (isWebGPU) renderer.setScissorTest(false);
    renderer.autoClear = true;
    renderer.render(shown, flat);
    await host.read(1, 1);
    if (lost) throw lost;
    return performance.now() - begin;
  };
  // Linear colours, four numbers a pixel, from the top-left corner.
  host.read = async (columns = width, lines = height) => {
    let pixels = new Float32Array(columns * lines * 4);
    if (isWebGPU) pixels = await renderer.readRenderTargetPixelsAsync(target, 0, 0, columns, lines);
    else renderer.readRenderTargetPixels(target, 0, 0, columns, lines, pixels);
    if (isWebGPU) return pixels;
    const turnedOver = new Float32Array(pixels.length);
    for (let line = 0; line < lines; line++) turnedOver.set(pixels.subarray(line * columns * 4, (line + 1) * columns * 4), (lines - 1 - line) * columns * 4);
    return turnedOver;
  };

  // The texture on the canvas.
  const square = new THREE.PlaneGeometry(2, 2);
  // The first row of a WebGPU texture is the topmost.
  if (isWebGPU) square.attributes.uv.array.forEach((value, index, all) => { if (index % 2 === 1) all[index] = 1 - value; });
  const copy = new (library.MeshBasicNodeMaterial ?? THREE.MeshBasicMaterial)({ map: target.texture, transparent: true, depthTest: false, toneMapped: false });
  Object.assign(copy, { blending: THREE.NoBlending });
  const sheet = new library.Mesh(square, copy);
  sheet.frustumCulled = false;
  const shown = new library.Scene();
  shown.add(sheet);

  const controls = new OrbitControls(camera, canvas);
  // On the axis of the view, beside the middle of the cloud: going around begins with what the scene's camera sees.
  const away = view.back.dot(view.target.clone().sub(view.place));
  controls.target.copy(turned(view.place.clone().addScaledVector(view.back, away)));
  controls.update();
  controls.enablePan = true;
  let busy = false, again = false;
  const show = async () => {
    if (busy) { again = true; return; }
    busy = true;
    try {
      do {
        again = false;
        const took = await host.draw();
        status.textContent = `${width} × ${height} with ${isWebGPU ? "WebGPU" : "WebGL 2"}: ${took.toFixed(0)} ms a picture. Drag to go around, turn the wheel to come closer.`;
      } while (again);
    } catch (error) { fail(error); }
    busy = false;
  };
  controls.addEventListener("change", () => { host.setCamera(); show(); });
  await show();
  host.ready = true;
}

start().catch(fail);
