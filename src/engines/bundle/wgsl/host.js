// Runs a bundle in plain WebGPU: rays of the camera, the march, compositing, and the picture on a canvas. bundle.json says what goes where.
//
// For other pages: `await open(canvas, folder)` gives a host with `draw()`, `orbit(longitude, latitude, distance)`, `set(kernel, name, values)`
// and `read()`, which gives the linear colours as Float32Array, four numbers a pixel from the top-left corner; `close()` gives back what it has.

const RAY = 64, PIXEL = 32;

// What a page may change, by kernel and field: the range that makes sense, on a scale of factors where it is one.
const NUMBERS = [
  ["march", "extinction", "Extinction", "factor", 0.1, 10],
  ["march", "ambient", "Light of the world", "factor", 0.1, 10],
  ["march", "anisotropy", "Anisotropy", "value", -0.95, 0.95],
  ["march", "steps", "Steps of the march", "whole", 1, 256],
  ["march", "shadow_steps", "Steps towards the sun", "whole", 1, 64],
  ["compose", "exposure", "Exposure", "factor", 0.1, 10],
];

const SHOW = `
@group(0) @binding(0) var<storage, read> colour: array<vec4f>;
// Width, height, the column of the line, colours along each axis of the table (0: the curve of sRGB); exposure as a factor.
struct Screen { size: vec4u, exposure: vec4f }
@group(0) @binding(1) var<uniform> screen: Screen;
@group(0) @binding(2) var<storage, read> truth: array<vec4f>;
// Display values of ten bits, blue fastest.
@group(0) @binding(3) var<storage, read> table: array<u32>;
@vertex fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
// IEC 61966-2-1, the curve of sRGB.
fn encoded(linear: vec3f) -> vec3f {
  let value = clamp(linear, vec3f(0.0), vec3f(1.0));
  return select(1.055 * pow(value, vec3f(1.0 / 2.4)) - 0.055, 12.92 * value, value <= vec3f(0.0031308));
}
// Between the colours of the scene's view transform, which lie at (e^(t s) - 1) / 4096 with t = ln(1 + 4096 * 64), s from 0 to 1.
fn looked_up(linear: vec3f) -> vec3f {
  let side = screen.size.w;
  let place = log(1.0 + 4096.0 * clamp(linear, vec3f(0.0), vec3f(64.0))) * (f32(side - 1u) / log(1.0 + 4096.0 * 64.0));
  let low = min(vec3u(place), vec3u(side - 2u));
  let part = place - vec3f(low);
  var sum = vec3f(0.0);
  for (var corner = 0u; corner < 8u; corner++) {
    let high = vec3u(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
    let weights = select(1.0 - part, part, high == vec3u(1u));
    let at = low + high;
    let word = table[(at.x * side + at.y) * side + at.z];
    let value = vec3f(vec3u(word, word >> 10u, word >> 20u) & vec3u(1023u)) / 1023.0;
    sum += weights.x * weights.y * weights.z * value;
  }
  return sum;
}
@fragment fn shown(@builtin(position) place: vec4f) -> @location(0) vec4f {
  let at = u32(place.y) * screen.size.x + u32(place.x);
  // Right of a line stands the truth.
  if (u32(place.x) == screen.size.z) { return vec4f(1.0, 0.69, 0.13, 1.0); }
  var pixel = colour[at];
  if (u32(place.x) > screen.size.z) { pixel = truth[at]; }
  let exposed = pixel.rgb * screen.exposure.x;
  if (screen.size.w != 0u) { return vec4f(looked_up(exposed), 1.0); }
  return vec4f(encoded(exposed), 1.0);
}`;

const add = (a, b, times = 1) => a.map((value, axis) => value + times * b[axis]);
const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / Math.hypot(...a));
const linear = (matrix, a) => [0, 1, 2].map((row) => dot(matrix[row].slice(0, 3), a));
// Rodrigues' formula.
const turned = (a, axis, angle) => {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(a.map((value) => value * c), cross(axis, a), s), axis, dot(axis, a) * (1 - c));
};

export async function open(canvas, folder = ".") {
  const get = async (name) => {
    const answer = await fetch(`${folder}/${name}`);
    if (!answer.ok) throw new Error(`${name}: the server answers ${answer.status}. The folder must be served whole.`);
    return answer;
  };
  const bundle = await (await get("bundle.json")).json();
  if (!navigator.gpu) throw new Error("This browser has no WebGPU. Chrome and Edge from 113, Safari from 26 and Firefox from 141 have it; on Linux it may have to be switched on. Pages need https or localhost for it.");
  const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
  if (!adapter) throw new Error("The browser has WebGPU but gives no graphics adapter. Its page about graphics (chrome://gpu) says why.");
  const [width, height] = bundle.resolution;
  const files = new Map();
  for (const kernel of bundle.kernels) {
    for (const binding of kernel.bindings.filter((one) => one.file)) {
      if (!files.has(binding.file)) files.set(binding.file, await (await get(binding.file)).arrayBuffer());
    }
  }
  const largest = Math.max(width * height * 16, ...[...files.values()].map((content) => content.byteLength));
  const isStored = (binding) => binding.role !== "density";
  const buffers = Math.max(...bundle.kernels.map((kernel) => kernel.bindings.filter(isStored).length));
  const wanted = { maxStorageBufferBindingSize: largest, maxBufferSize: largest, maxStorageBuffersPerShaderStage: buffers };
  const requiredLimits = {};
  for (const [name, needed] of Object.entries(wanted)) {
    if (needed > adapter.limits[name]) throw new Error(`This scene needs ${name} of ${needed}, and the adapter has ${adapter.limits[name]}.`);
    // The default of every implementation is enough for small scenes.
    if (name !== "maxStorageBuffersPerShaderStage" || needed > 8) requiredLimits[name] = needed;
  }
  const device = await adapter.requestDevice({ requiredLimits });
  // `isStandard`: the curve of sRGB in the place of the scene's view transform.
  const host = { bundle, device, lost: null, wipe: 1, isStandard: false };
  device.lost.then((why) => { host.lost = why.message || why.reason; });
  host.close = () => device.destroy();

  const buffer = (size, usage) => device.createBuffer({ size, usage });
  const { STORAGE, COPY_SRC, COPY_DST, UNIFORM, MAP_READ } = GPUBufferUsage;
  const rays = buffer(bundle.rays_together * RAY, STORAGE);
  const pixels = buffer(bundle.rays_together * PIXEL, STORAGE | COPY_DST);
  const colour = buffer(width * height * 16, STORAGE | COPY_SRC);
  const roles = { rays, pixels, colour };
  // The right picture, and as numbers for its error.
  const truth = bundle.truth ? new Float32Array(await (await get(bundle.truth)).arrayBuffer()) : null;
  const right = truth ? buffer(truth.byteLength, STORAGE | COPY_DST) : colour;
  if (truth) device.queue.writeBuffer(right, 0, truth);
  const display = bundle.display ?? { exposure: 0, side: 0 };
  const table = display.file ? new Uint32Array(await (await get(display.file)).arrayBuffer()) : null;
  const colours = table ? buffer(table.byteLength, STORAGE | COPY_DST) : colour;
  if (table) device.queue.writeBuffer(colours, 0, table);
  const uniforms = bundle.kernels.flatMap((kernel) => kernel.bindings).filter((one) => one.role === "density").map((one) => one.file);
  for (const [name, content] of files) {
    roles[name] = buffer(content.byteLength, (uniforms.includes(name) ? UNIFORM : STORAGE) | COPY_DST);
    device.queue.writeBuffer(roles[name], 0, content);
  }
  const kernels = {};
  for (const kernel of bundle.kernels) {
    const code = await (await get(kernel.file)).text();
    const pipeline = await device.createComputePipelineAsync({
      layout: "auto", compute: { module: device.createShaderModule({ code }), entryPoint: "main" },
    });
    const fields = Object.fromEntries(kernel.uniform.map((field) => [field.name, { ...field, values: [...field.values] }]));
    kernels[kernel.name] = { ...kernel, pipeline, fields };
  }

  // What a kernel is given for one dispatch.
  const packed = (kernel, changes) => {
    const bytes = new DataView(new ArrayBuffer(kernel.bytes));
    for (const { name, offset, kind, values } of Object.values(kernel.fields)) {
      (name in changes ? [changes[name]] : values).forEach((value, number) => {
        if (kind === "f32") bytes.setFloat32(offset + 4 * number, value, true);
        else bytes.setUint32(offset + 4 * number, value, true);
      });
    }
    return bytes;
  };
  let spare = [];
  const run = (encoder, used, kernel, count, changes) => {
    const uniform = spare.find((one) => one.size === kernel.bytes && !used.includes(one)) ?? buffer(kernel.bytes, UNIFORM | COPY_DST);
    used.push(uniform);
    device.queue.writeBuffer(uniform, 0, packed(kernel, changes));
    const groups = new Map([[0, [{ binding: 0, resource: { buffer: uniform } }]]]);
    for (const { group, binding, role, file } of kernel.bindings) {
      if (!groups.has(group)) groups.set(group, []);
      groups.get(group).push({ binding, resource: { buffer: roles[file ?? role] } });
    }
    const pass = encoder.beginComputePass();
    pass.setPipeline(kernel.pipeline);
    for (const [number, entries] of groups) {
      pass.setBindGroup(number, device.createBindGroup({ layout: kernel.pipeline.getBindGroupLayout(number), entries }));
    }
    pass.dispatchWorkgroups(Math.ceil(count / kernel.workgroup));
    pass.end();
  };

  const context = canvas?.getContext("webgpu");
  let screen = null;
  if (context) {
    const format = navigator.gpu.getPreferredCanvasFormat();
    const module = device.createShaderModule({ code: SHOW });
    const pipeline = await device.createRenderPipelineAsync({
      layout: "auto", vertex: { module }, fragment: { module, targets: [{ format }] },
    });
    const size = buffer(32, UNIFORM | COPY_DST);
    const entries = [colour, size, right, colours].map((one, binding) => ({ binding, resource: { buffer: one } }));
    const group = device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries });
    // With the first picture, not before: until then the canvas may be another host's.
    const begin = () => {
      [canvas.width, canvas.height] = [width, height];
      context.configure({ device, format, alphaMode: "opaque" });
      screen.begin = null;
    };
    screen = { size, pipeline, group, begin };
  }

  // What is on the canvas, from the last picture.
  host.show = () => {
    if (!screen) return;
    screen.begin?.();
    // The part of the width that is the engine's; all of it where the view is none that the truth is of.
    const line = host.wipe < 1 && truth && host.isHome() ? Math.round(host.wipe * width) : 0xffffffff;
    const side = table && !host.isStandard ? display.side : 0;
    device.queue.writeBuffer(screen.size, 0, new Uint32Array([width, height, line, side]));
    device.queue.writeBuffer(screen.size, 16, new Float32Array([2 ** display.exposure, 0, 0, 0]));
    const encoder = device.createCommandEncoder();
    const view = context.getCurrentTexture().createView();
    const pass = encoder.beginRenderPass({ colorAttachments: [{ view, loadOp: "clear", storeOp: "store" }] });
    pass.setPipeline(screen.pipeline);
    pass.setBindGroup(0, screen.group);
    pass.draw(3);
    pass.end();
    device.queue.submit([encoder.finish()]);
  };

  // Whether every number is the scene's, as the kernels get it.
  host.isHome = () => bundle.kernels.every((kernel) => kernel.uniform.every(
    (field) => field.values.every((value, index) => Math.fround(value) === Math.fround(kernels[kernel.name].fields[field.name].values[index]))));

  // relMSE of the last picture: the mean over pixels and channels of d^2 / (t^2 + e^2), with the difference d, the truth t and e = 1 % of
  // its mean. None without a truth, and where the view is not the scene's.
  host.error = async () => {
    if (!truth || !host.isHome()) return null;
    const found = await host.read();
    const isColour = (_, index) => index % 4 !== 3;
    const values = 3 * width * height;
    const mean = truth.filter(isColour).reduce((sum, value) => sum + value, 0) / values;
    let sum = 0;
    truth.forEach((value, index) => {
      if (index % 4 !== 3) sum += (found[index] - value) ** 2 / (value * value + (0.01 * mean) ** 2);
    });
    return sum / values;
  };

  // One picture; resolves when the adapter is done, with the milliseconds that it took.
  host.draw = async () => {
    if (host.lost) throw new Error(`The graphics device was lost: ${host.lost}. Load the page again.`);
    const begin = performance.now();
    const { camera, march, compose } = kernels;
    const steps = march.fields.steps.values[0];
    const together = Math.max(1, bundle.steps_together);
    for (let first = 0; first < width * height; first += bundle.rays_together) {
      const count = Math.min(bundle.rays_together, width * height - first);
      const used = [];
      const encoder = device.createCommandEncoder();
      encoder.clearBuffer(pixels);
      run(encoder, used, camera, count, { first, count });
      for (let step = 0; step < steps; step += together) {
        run(encoder, used, march, count, { count, first_step: step, end_step: step + together });
      }
      run(encoder, used, compose, count, { first, count, rays: 1, begin: 0 });
      device.queue.submit([encoder.finish()]);
      // Uniforms are free again for the next submission: writes to them are queued behind it.
      spare = [...new Set([...spare, ...used])];
    }
    host.show();
    await device.queue.onSubmittedWorkDone();
    return performance.now() - begin;
  };

  host.read = async () => {
    const copy = buffer(width * height * 16, COPY_DST | MAP_READ);
    const encoder = device.createCommandEncoder();
    encoder.copyBufferToBuffer(colour, 0, copy, 0, copy.size);
    device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const values = new Float32Array(copy.getMappedRange().slice(0));
    copy.destroy();
    return values;
  };

  host.get = (kernel, name) => kernels[kernel].fields[name].values;
  host.set = (kernel, name, values) => { kernels[kernel].fields[name].values = [...values]; };
  // Parameters of the density, by field. Which cells may hold something is not known where one has changed.
  const density = new Map((bundle.density ?? []).map(({ field, value }) => [field, value]));
  host.getDensity = (field) => density.get(field);
  host.setDensity = (field, value) => {
    if (!density.has(field)) throw new Error(`The bundle has no parameter ${field}; bundle.json says which there are.`);
    density.set(field, value);
    uniforms.forEach((name) => device.queue.writeBuffer(roles[name], 0, new Float32Array([...density.values()])));
    const isOwn = bundle.density.every((one) => density.get(one.field) === one.value);
    host.set("march", "everywhere", [isOwn ? 0 : 1]);
  };
  host.original = (kernel, name) =>
    bundle.kernels.find((one) => one.name === kernel).uniform.find((field) => field.name === name).values;

  // The scene's camera, turned around what it looks at (the middle of the density's box) and moved towards it or away: longitude around the
  // world's z axis and latitude in radians, distance as a factor.
  host.orbit = (longitude, latitude, distance) => {
    const { place, target, to_local, unit: metres } = bundle.camera;
    const away = add(place, target, -1);
    const side = unit(cross([0, 0, 1], away).map((value) => value || 1e-9));
    const turn = (a) => turned(turned(a, side, -latitude), [0, 0, 1], longitude);
    const at = (name) => host.original("camera", name);
    for (const part of ["", "_across", "_up"]) {
      const direction = turn(at(`direction${part}`));
      host.set("camera", `direction${part}`, direction);
      host.set("camera", `way${part}`, linear(to_local, direction).map((value) => value * metres));
    }
    // Where rays begin, from the camera's place on, which was given in the density's frame.
    const middle = add(linear(to_local, target), to_local.map((row) => row[3]));
    const to_world = inverse(to_local);
    const moved = (local) => linear(to_local, turn(linear(to_world, local)));
    const from = add(linear(to_local, place), to_local.map((row) => row[3]));
    const near = moved(add(at("start"), from, -1));
    host.set("camera", "start", add(add(middle, linear(to_local, turn(away)), distance), near));
    host.set("camera", "start_across", moved(at("start_across")));
    host.set("camera", "start_up", moved(at("start_up")));
  };
  return host;
}

// Of the linear part of a matrix of rows.
function inverse(matrix) {
  const rows = matrix.slice(0, 3).map((row) => row.slice(0, 3));
  const columns = [cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])];
  const determinant = dot(rows[0], columns[0]);
  return [0, 1, 2].map((row) => columns.map((column) => column[row] / determinant).concat(0));
}

// The page.
const canvas = document.getElementById("picture");
if (canvas) {
  const at = (name) => document.getElementById(name);
  const status = at("status");
  const fail = (error) => { status.className = "failed"; status.textContent = error.message; };
  let host = null;
  let [longitude, latitude, distance] = [0, 0, 1];
  let busy = null, again = false;
  const began = performance.now();

  const draw = async () => {
    try {
      do {
        again = false;
        const took = await host.draw();
        window.firstPicture ??= performance.now() - began;
        const error = again ? null : await host.error();
        const says = error === null ? "" : ` relMSE against the truth ${error.toExponential(2)}.`;
        status.className = "";
        status.textContent = `${host.bundle.resolution.join(" × ")}: ${took.toFixed(0)} ms a picture.${says} Drag to go around, turn the wheel to come closer.`;
      } while (again);
    } catch (error) { fail(error); }
    busy = null;
  };
  const show = () => {
    again = true;
    busy ??= draw();
    return busy;
  };
  const turn = () => { host.orbit(longitude, latitude, distance); return show(); };

  const option = (value, text) => Object.assign(document.createElement("option"), { value, textContent: text });

  // Sliders of the numbers that this engine has.
  let reset = [];
  const sliders = () => {
    reset = [];
    at("numbers").replaceChildren();
    for (const [kernel, name, title, scale, low, high] of NUMBERS) {
      const own = host.original(kernel, name);
      if (!own.some((value) => value !== 0)) continue;
      const label = document.createElement("label");
      const shown = document.createElement("output");
      const slider = Object.assign(document.createElement("input"), { type: "range", step: "any" });
      const factor = scale === "factor";
      [slider.min, slider.max] = factor ? [Math.log(low), Math.log(high)] : [low, high];
      if (scale === "whole") slider.step = 1;
      const write = () => {
        const value = Number(slider.value);
        host.set(kernel, name, factor ? own.map((one) => one * Math.exp(value)) : own.map((one, index) => (index ? one : value)));
        shown.value = factor ? `× ${Math.exp(value).toFixed(2)}` : value.toFixed(scale === "whole" ? 0 : 2);
      };
      const start = () => { slider.value = factor ? 0 : own[0]; write(); };
      slider.addEventListener("input", () => { write(); show(); });
      label.append(title, shown, slider);
      at("numbers").append(label);
      start();
      reset.push(start);
    }
    const parameters = host.bundle.density ?? [];
    at("density").hidden = parameters.length === 0;
    at("parameters").replaceChildren();
    for (const { field, title, about, value, range: [low, high] } of parameters) {
      const label = Object.assign(document.createElement("label"), { title: about });
      const shown = document.createElement("output");
      const slider = Object.assign(document.createElement("input"), { type: "range", step: "any", min: low, max: high });
      const write = (now) => { host.setDensity(field, now); shown.value = Number(now.toPrecision(3)); };
      // The value itself: what a slider holds is rounded to its range.
      const start = () => { slider.value = value; write(value); };
      slider.addEventListener("input", () => { write(Number(slider.value)); show(); });
      label.append(title, shown, slider);
      at("parameters").append(label);
      start();
      reset.push(start);
    }
  };

  const certificate = async (folder) => {
    const answer = await fetch(`${folder}/certificate.json`);
    const facts = answer.ok ? await answer.json() : {};
    at("certificate").replaceChildren();
    for (const [name, value] of Object.entries(facts)) {
      if (typeof value === "object" || name === "format") continue;
      const [term, text] = [document.createElement("dt"), document.createElement("dd")];
      [term.textContent, text.textContent] = [name.replaceAll("_", " "), typeof value === "number" ? Number(value.toPrecision(4)) : value];
      text.title = value;
      at("certificate").append(term, text);
    }
  };

  // Takes the bundle of a folder; the picture of the last one stands until it is there.
  const take = async (folder) => {
    const next = await open(canvas, folder);
    if (busy) { again = false; await busy; }
    host?.close();
    next.isStandard = at("view").value === "standard";
    next.wipe = Number(at("wipe").value);
    window.host = host = next;
    const { model, scene, display, truth } = host.bundle;
    at("title").textContent = document.title = `${scene}, ${model}`;
    at("view").parentElement.hidden = !display?.file;
    at("view").options[0].textContent = display?.view ?? "";
    at("wipe").parentElement.hidden = !truth;
    sliders();
    await certificate(folder);
    await turn();
  };

  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons || !host) return;
    longitude -= event.movementX * 0.008;
    latitude = Math.max(-1.4, Math.min(1.4, latitude + event.movementY * 0.008));
    turn();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (!host) return;
    distance = Math.max(0.05, Math.min(20, distance * Math.exp(event.deltaY * 0.001)));
    turn();
  }, { passive: false });
  at("wipe").addEventListener("input", () => { host.wipe = Number(at("wipe").value); host.show(); });
  at("view").addEventListener("change", () => { host.isStandard = at("view").value === "standard"; host.show(); });
  at("reset").addEventListener("click", () => {
    if (!host) return;
    [longitude, latitude, distance] = [0, 0, 1];
    reset.forEach((start) => start());
    turn();
  });
  const presets = at("presets");
  presets.addEventListener("change", async () => {
    presets.disabled = true;
    status.textContent = "Loading the shaders.";
    try { await take(presets.value); } catch (error) { fail(error); }
    presets.disabled = false;
  });
  try {
    await take(".");
    const all = host.bundle.presets ?? [];
    presets.append(...all.map((one) => option(one.folder, one.title)));
    presets.parentElement.hidden = all.length < 2;
  } catch (error) { fail(error); }
}
