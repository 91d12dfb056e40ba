// The cloud in Unity's built-in pipeline: a square over the whole picture, whose rays look into it. What lies before the cloud hides it.
Shader "cloudparity/Cloud"
{
    SubShader
    {
        Tags { "Queue" = "Transparent" "RenderType" = "Transparent" "IgnoreProjector" = "True" }
        Pass
        {
            Cull Off
            ZWrite Off
            ZTest Always
            // Colours have alpha in them.
            Blend One OneMinusSrcAlpha

            HLSLPROGRAM
            #pragma vertex corners
            #pragma fragment shade
            #pragma target 4.5
            #include "UnityCG.cginc"
            #include "cloud.hlsl"

            UNITY_DECLARE_DEPTH_TEXTURE(_CameraDepthTexture);
            // Clip space to the world.
            float4x4 cloud_from_clip;

            struct Corner
            {
                float4 place : SV_POSITION;
                float2 clip : TEXCOORD0;
            };

            Corner corners(float4 vertex : POSITION)
            {
                Corner corner;
                corner.place = float4(vertex.xy, UNITY_NEAR_CLIP_VALUE, 1.0);
                corner.clip = vertex.xy;
                return corner;
            }

            float4 shade(Corner corner) : SV_Target
            {
                float4 far = mul(cloud_from_clip, float4(corner.clip, UNITY_RAW_FAR_CLIP_VALUE, 1.0));
                float3 direction = normalize(far.xyz / far.w - _WorldSpaceCameraPos);
                float2 screen = corner.place.xy / _ScreenParams.xy;
                float depth = LinearEyeDepth(SAMPLE_DEPTH_TEXTURE(_CameraDepthTexture, screen));
                float3 forward = -UNITY_MATRIX_V[2].xyz;
                float farthest = depth / dot(direction, forward);
                // Unity's y is up and its z away; Blender's z is up and its y away.
                return cloud_from_blender(_WorldSpaceCameraPos.xzy, direction.xzy, farthest);
            }
            ENDHLSL
        }
    }
}
