// An engine's frame in one kernel: rays of the camera, march and compositing, one invocation per pixel, with nothing between them in memory.
#import cloudparity::camera
#import cloudparity::compositing
#import cloudparity::march
#import cloudparity::rays::Pixel

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u) {
    if invocation.x >= camera::view.count { return; }
    let pixel = camera::view.first + invocation.x;
    let nothing = Pixel(vec3f(0.0), 0u, vec3f(1.0), 0u);
    let found = march::marched(camera::ray_of(pixel), nothing, 0u, march::march.steps);
    let shown = compositing::over(found, compositing::composite.background);
    compositing::put(pixel, shown * compositing::composite.exposure, found.transmittance);
}
