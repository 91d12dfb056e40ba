// Draws the cloud in every camera of Unity's built-in pipeline. Put this folder's data.bin, view.bin and the other .bin files into
// Assets/StreamingAssets/cloud, Cloud.shader and cloud.hlsl side by side into Assets, and this component onto an empty object.
using System.Collections.Generic;
using System.IO;
using UnityEngine;

public class Cloud : MonoBehaviour
{
    // Texels of a row of data.bin.
    const int Row = 2048;

    public Shader shader;

    readonly List<GraphicsBuffer> buffers = new List<GraphicsBuffer>();
    Material material;
    Texture2D texture;
    Mesh square;

    static string PathOf(string name)
    {
        return Path.Combine(Application.streamingAssetsPath, "cloud", name);
    }

    void OnEnable()
    {
        material = new Material(shader != null ? shader : Shader.Find("cloudparity/Cloud"));
        byte[] data = File.ReadAllBytes(PathOf("data.bin"));
        // No curve of sRGB, no filter: texels are words.
        texture = new Texture2D(Row, data.Length / (4 * Row), TextureFormat.RGBA32, false, true) { filterMode = FilterMode.Point };
        texture.LoadRawTextureData(data);
        texture.Apply(false, true);
        material.SetTexture("cloud_data", texture);
        foreach (string name in new[] { "view", "march", "composite", "suns" })
        {
            if (!File.Exists(PathOf(name + ".bin"))) continue;
            byte[] numbers = File.ReadAllBytes(PathOf(name + ".bin"));
            var buffer = new GraphicsBuffer(GraphicsBuffer.Target.Constant, 1, numbers.Length);
            buffer.SetData(numbers);
            material.SetConstantBuffer(name + "_numbers", buffer, 0, numbers.Length);
            buffers.Add(buffer);
        }
        square = new Mesh
        {
            vertices = new[] { new Vector3(-1, -1), new Vector3(3, -1), new Vector3(-1, 3) },
            triangles = new[] { 0, 1, 2 },
            bounds = new Bounds(Vector3.zero, Vector3.one * 1e6f),
        };
        Camera.onPreCull += Draw;
    }

    void OnDisable()
    {
        Camera.onPreCull -= Draw;
        foreach (GraphicsBuffer buffer in buffers) buffer.Dispose();
        buffers.Clear();
        Destroy(material);
        Destroy(texture);
        Destroy(square);
    }

    void Draw(Camera camera)
    {
        camera.depthTextureMode |= DepthTextureMode.Depth;
        Matrix4x4 projection = GL.GetGPUProjectionMatrix(camera.projectionMatrix, true);
        material.SetMatrix("cloud_from_clip", (projection * camera.worldToCameraMatrix).inverse);
        Graphics.DrawMesh(square, Matrix4x4.identity, material, gameObject.layer, camera);
    }
}
