//! Draws the cloud of the folder above into a PNG: `cargo run --release -- PICTURE.png [FOLDER]`.

mod cloud;

use cloud::Cloud;
use std::path::Path;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let output = arguments.next().unwrap_or_else(|| "cloud.png".into());
    let folder = arguments.next().unwrap_or_else(|| "..".into());
    let (device, queue) = pollster::block_on(device())?;
    let cloud = Cloud::load(Path::new(&folder), &device, &queue)?;
    let begin = std::time::Instant::now();
    let pixels = cloud.draw(&device, &queue)?;
    let [width, height] = cloud.resolution();
    let bytes = pixels.iter().flat_map(|&[red, green, blue, _]| [red, green, blue].map(shown)).collect();
    let picture = image::RgbImage::from_raw(width, height, bytes).ok_or("a picture of another size")?;
    picture.save(&output)?;
    println!("{output}: {width} x {height} in {:.0} ms", begin.elapsed().as_secs_f64() * 1e3);
    Ok(())
}

async fn device() -> Result<(wgpu::Device, wgpu::Queue), Failure> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = instance.request_adapter(&Default::default()).await?;
    let limits = adapter.limits();
    let descriptor = wgpu::DeviceDescriptor { required_limits: limits, ..Default::default() };
    Ok(adapter.request_device(&descriptor).await?)
}

/// The curve of sRGB in 8 bits.
fn shown(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let curved = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (255.0 * curved).round() as u8
}
