// The cloud as a node material of three's WebGPURenderer: WGSL through TSL's wgslFn.

import { MeshBasicNodeMaterial, Vector2, Vector3 } from "three/webgpu";
import { positionGeometry, screenCoordinate, texture as textureNode, uniform, vec2, vec4, wgsl, wgslFn } from "three/tsl";
import { dataTexture, over } from "./cloud.js";

export async function material(cloud) {
  const texture = dataTexture(cloud);
  const { parameters } = JSON.parse(await cloud.text("parameters.json"));
  const values = ({ block, field, element }) => cloud.get(block, field, element);
  const vector = (numbers) => (numbers.length === 2 ? new Vector2(...numbers) : new Vector3(...numbers));
  const nodes = parameters.map((parameter) => {
    const numbers = values(parameter);
    return numbers.length === 1 ? uniform(numbers[0], parameter.kind) : uniform(vector(numbers), parameter.kind);
  });
  const entry = await cloud.text("cloud-entry.wgsl");
  const call = wgslFn(entry, [wgsl(await cloud.text("cloud.wgsl"))]);
  const height_ = cloud.manifest.resolution[1];
  const given = { raster: vec2(screenCoordinate.x, uniform(height_, "float").sub(screenCoordinate.y)) };
  if (entry.includes("data: texture_2d")) given.data = textureNode(texture);
  parameters.forEach((parameter, index) => { given[parameter.name] = nodes[index]; });
  const made = new MeshBasicNodeMaterial(over);
  made.vertexNode = vec4(positionGeometry.xy, 0, 1);
  made.fragmentNode = call(given);
  let version = cloud.version;
  made.refresh = () => {
    if (version === cloud.version) return;
    version = cloud.version;
    parameters.forEach((parameter, index) => {
      const numbers = values(parameter);
      if (numbers.length === 1) [nodes[index].value] = numbers;
      else nodes[index].value.set(...numbers);
    });
  };
  return made;
}
