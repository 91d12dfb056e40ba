// The scene's picture: a pixel shader for a triangle over a target of its size. view.bin and so on are the constant buffers, data.bin the texture.
#include "cloud.hlsl"

float4 main(float4 place : SV_Position) : SV_Target
{
    return picture(float2(place.x, float(camera_view.height) - place.y));
}
