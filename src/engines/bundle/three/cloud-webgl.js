// The cloud as a material of three's WebGLRenderer (WebGL 2): a triangle over the whole picture that is drawn over what is there.

import { ShaderMaterial, Vector2, Vector3 } from "three";
import { dataTexture, over } from "./cloud.js";

const held = ({ kind, values }) => {
  if (values.length === 1) return kind === "u32" ? values[0] >>> 0 : values[0];
  return values.length === 2 ? new Vector2(...values) : new Vector3(...values);
};

export async function material(cloud) {
  const texture = dataTexture(cloud);
  const uniforms = { cloud_data: { value: texture } };
  const fill = () => {
    for (const { name, count, elements } of cloud.manifest.blocks) {
      const values = elements.map((fields, element) => Object.fromEntries(fields.map((field) => [
        field.name, held({ kind: field.kind, values: cloud.get(name, field.name, element) }),
      ])));
      const uniform = uniforms[`cloud_${name}`] ??= {};
      uniform.value = count > 0 ? values : values[0];
    }
  };
  fill();
  const functions = await cloud.text("cloud.glsl");
  const made = new ShaderMaterial({
    uniforms,
    vertexShader: "void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }",
    // The chunk turns linear colours into those of what is drawn into: none for a render target, sRGB for the canvas.
    fragmentShader: `${functions}
void main() {
  gl_FragColor = picture(gl_FragCoord.xy);
  #include <colorspace_fragment>
}`,
    ...over,
  });
  let version = cloud.version;
  // The numbers of the cloud, where they have changed.
  made.refresh = () => {
    if (version === cloud.version) return;
    version = cloud.version;
    fill();
    made.uniformsNeedUpdate = true;
  };
  return made;
}
