//! The window without a screen: its widgets, its threads and its figures, driven as a person would.
#![cfg(feature = "viewer")]

mod support;

use cloudparity::base::display_table::DisplayTable;
use cloudparity::engines::Engine;
use cloudparity::engines::defects::Defects;
use cloudparity::gpu::{Backend, Gpu};
use cloudparity::integrators::path::GivenMedium;
use cloudparity::scene::Scene;
use cloudparity::scene::image::Image;
use cloudparity::viewer::compare::{Curve, Statistics};
use cloudparity::viewer::quality::Choice;
use cloudparity::viewer::{App, Changes, Record, Source};
use cloudparity::{Error, Result, engines};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A small cloud; what is recorded is kept.
struct Small {
    scene: Scene,
    model: &'static str,
    quality: Option<&'static str>,
    /// Settings that are levels of quality, from low on.
    front: Vec<Choice>,
    recorded: Mutex<Vec<(Image, Vec<Image>)>>,
    /// Engines that were begun, and those that were put together after as long as is said.
    engines: [AtomicUsize; 2],
    takes: Duration,
    /// The devices that were opened, which the test can destroy under the window.
    devices: Mutex<Vec<wgpu::Device>>,
    most_devices: usize,
}

impl Small {
    fn new(model: &'static str) -> Arc<Self> {
        Self::sized(model, None, "procedural-clouds", [32, 18])
    }

    fn sized(model: &'static str, quality: Option<&'static str>, scene: &str, size: [u32; 2]) -> Arc<Self> {
        let mut scene = support::scene(scene);
        scene.film.resolution = size;
        scene.film.resolution_percentage = 100;
        Arc::new(Self {
            scene,
            model,
            quality,
            front: Vec::new(),
            recorded: Mutex::default(),
            engines: Default::default(),
            takes: Duration::ZERO,
            devices: Mutex::default(),
            most_devices: 2,
        })
    }

    /// Ends a window whose pictures came from an adapter. The thread of its truth may outlive it, and would give the devices back while the process
    /// ends and the driver's own state is gone: a test that had passed died by a signal.
    fn close(&self, window: Harness<'static, App>) {
        drop(window);
        self.devices.lock().expect("no panic before").clear();
    }
}

impl Source for Small {
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn adapter(&self) -> Result<Gpu> {
        let mut devices = self.devices.lock().expect("no panic before");
        if devices.len() == self.most_devices {
            return Err(Error::new("graphics adapter", "no adapter", "another device", "Plug it in again."));
        }
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = pollster::block_on(instance.request_adapter(&Default::default())).expect("there is an adapter");
        let descriptor = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).expect("there is a device");
        devices.push(device.clone());
        Ok(Gpu::of_device(&adapter, device, queue))
    }

    fn engine(&self, changes: &Changes) -> Result<(Scene, Engine)> {
        self.engines[0].fetch_add(1, Ordering::SeqCst);
        std::thread::sleep(self.takes);
        let mut scene = self.scene.clone();
        changes.scene.iter().try_for_each(|(name, value)| scene.set(&format!("{name}={value}")))?;
        let model = engines::find(self.model)?;
        let level = changes.setting.map(|number| ["low", "high"][number]);
        let texts: Vec<String> = changes.density.iter().map(|(name, value)| format!("{name}={value}")).collect();
        let values = model.values(changes.quality.as_deref().or(level).or(self.quality), &texts)?;
        let mut engine = model.engine(&scene, &values, &Defects::NONE, changes.seconds)?;
        for (name, &value) in &changes.of_light {
            engines::light::models::set(&mut engine.light, name, value, name)?;
        }
        self.engines[1].fetch_add(1, Ordering::SeqCst);
        Ok((scene, engine))
    }

    fn truth(&self, changes: &Changes) -> Result<(Scene, Option<GivenMedium>)> {
        let (scene, engine) = self.engine(changes)?;
        let medium = GivenMedium { identity: engine.medium_identity(), object: Arc::new(engine.medium()?) };
        Ok((scene, Some(medium)))
    }

    fn pictures(&self) -> &[Image] {
        &[]
    }

    fn sub_pixels(&self, _: &Changes) -> u32 {
        1
    }

    fn front(&self) -> &[Choice] {
        &self.front
    }

    /// No FLIP, but a number that is known.
    fn flip(&self, ours: &Image, truth: &Image) -> Result<Option<f64>> {
        Ok(Some((ours.mean()[0] - truth.mean()[0]).abs() + 1.0))
    }

    fn record(&self, record: &Record<'_>) -> Result<String> {
        let pair = (record.shown.image.clone(), record.truth.to_vec());
        self.recorded.lock().expect("no panic before").push(pair);
        Ok("pair-001: recorded".into())
    }

    fn save_preset(&self, _: &Changes) -> Result<String> {
        Err(Error::new("the folder", "no room", "some", "Make room."))
    }
}

fn window(source: &Arc<Small>, backend: Backend) -> Harness<'static, App> {
    let app = App::new(Arc::clone(source) as Arc<dyn Source>, backend, Arc::new(|| ()));
    Harness::builder().with_size([1200.0, 2600.0]).build_ui_state(|ui, app: &mut App| app.ui(ui), app)
}

/// Shows frame after frame until something has come.
fn until(window: &mut Harness<'static, App>, what: &str, is_there: impl Fn(&App) -> bool) {
    let begin = Instant::now();
    while !is_there(window.state()) {
        // A limit for what would never end; nothing is timed.
        assert!(begin.elapsed() < Duration::from_secs(120), "{what} never came: {:?}", window.state().message());
        window.step();
        std::thread::sleep(Duration::from_millis(5));
    }
    window.step();
}

/// The picture of what is wanted now is there, in its full size.
fn is_shown(app: &App) -> bool {
    app.is_up_to_date()
}

#[test]
fn closing_waits_for_the_picture_that_is_being_made() {
    let mut source = Small::new("perlin-fbm");
    Arc::get_mut(&mut source).expect("nobody else has it").takes = Duration::from_millis(300);
    let mut window = window(&source, Backend::Cpu);
    let begin = Instant::now();
    while source.engines[0].load(Ordering::SeqCst) == 0 {
        assert!(begin.elapsed() < Duration::from_secs(120), "no picture was ever begun");
        window.step();
    }
    assert_eq!(source.engines[1].load(Ordering::SeqCst), 0, "this test has to come before the end of the picture");
    drop(window);
    // No thread is left that has an adapter while the process ends.
    assert_eq!(source.engines[1].load(Ordering::SeqCst), 1);
}

#[test]
fn a_tour_with_all_cores() {
    let source = Small::new("perlin-fbm");
    let mut window = window(&source, Backend::Cpu);
    until(&mut window, "a picture", is_shown);
    let home = window.state().shown().expect("it is there").image.clone();

    // The truth accumulates while the view rests, and the error is that of the pictures that are recorded.
    until(&mut window, "an error", |app| app.statistics().is_some());
    assert!(window.state().error_text().contains('±'), "{}", window.state().error_text());
    until(&mut window, "HDR-FLIP", |app| app.error_text().contains("HDR-FLIP 1."));
    window.get_by_label("Record this pair").click();
    window.step();
    let found = window.state().statistics();
    until(&mut window, "a record", |app| app.message().is_some_and(|(text, _)| text.contains("recorded")));
    {
        let recorded = source.recorded.lock().expect("no panic before");
        let (ours, truth) = &recorded[0];
        assert_eq!(ours.pixels, home.pixels);
        let again = Statistics::of(ours, truth).expect("an error");
        // The truth goes on between the click and the next look: its figure is within its own uncertainty.
        let found = found.expect("it was there");
        let spread = found.standard_error.max(again.standard_error);
        assert!((again.error() - found.error()).abs() <= 6.0 * spread, "{again:?} {found:?}");
    }

    // What cannot be saved is said.
    window.get_by_label("Save preset").click();
    window.step();
    window.step();
    assert!(window.state().message().is_some_and(|(text, is_failure)| is_failure && text.contains("no room")));

    // Around and back.
    let area = window.get_by_label("Picture").rect();
    window.drag_at(area.center());
    window.step();
    window.hover_at(area.center() + eframe::egui::vec2(60.0, 12.0));
    window.step();
    window.drop_at(area.center() + eframe::egui::vec2(60.0, 12.0));
    window.step();
    assert!(!window.state().look().is_home(), "a drag goes around");
    until(&mut window, "the view from there", is_shown);
    assert_ne!(window.state().shown().expect("it is there").image.pixels, home.pixels);
    window.get_by_label("Scene's camera").click();
    window.step();
    window.step();
    assert!(window.state().look().is_home());
    until(&mut window, "the scene's own view", is_shown);
    let back = &window.state().shown().expect("it is there").image;
    assert!(back.pixels == home.pixels, "to the bit; {} x {}", back.width, back.height);
}

/// A number that a kernel is given compiles nothing, whatever it is; the program says how many it has compiled.
#[test]
fn a_number_that_changes_compiles_nothing() {
    if !support::require("vulkan") {
        return;
    }
    let source = Small::new("perlin-fbm");
    let mut window = window(&source, Backend::Gpu);
    until(&mut window, "a picture", is_shown);
    let compiled = window.state().shown().expect("it is there").compilations;
    assert!(compiled > 0, "the first picture compiles");
    let mut before = window.state().shown().expect("it is there").image.clone();
    for step in 1..=20 {
        let app = window.state_mut();
        app.set_light("first_lobe", 0.3 + 0.02 * f64::from(step));
        app.set_density("opacity", 1.0 + 0.1 * f64::from(step));
        app.set_sun([0.05 * f64::from(step), 0.0]);
        until(&mut window, "a picture of new numbers", is_shown);
        let shown = window.state().shown().expect("it is there");
        assert_ne!(shown.image.pixels, before.pixels, "step {step}");
        assert_eq!(shown.compilations, compiled, "step {step}");
        before = shown.image.clone();
    }
    // Another structure does.
    window.state_mut().set_light("octaves", 3.0);
    until(&mut window, "a picture with octaves", is_shown);
    assert!(window.state().shown().expect("it is there").compilations > compiled);
    // And back again does not.
    let compiled = window.state().shown().expect("it is there").compilations;
    window.state_mut().set_light("octaves", 1.0);
    until(&mut window, "a picture without", is_shown);
    assert_eq!(window.state().shown().expect("it is there").compilations, compiled);
    source.close(window);
}

#[test]
fn a_lost_device_is_replaced_and_without_another_the_cores_go_on() {
    if !support::require("vulkan") {
        return;
    }
    let source = Small::new("perlin-fbm");
    let mut window = window(&source, Backend::Gpu);
    until(&mut window, "a picture", is_shown);
    let before = window.state().shown().expect("it is there").image.clone();

    let lose = || source.devices.lock().expect("no panic before").last().expect("one is open").destroy();
    lose();
    window.state_mut().set_light("first_lobe", 0.5);
    until(&mut window, "a picture of the second device", is_shown);
    let shown = window.state().shown().expect("it is there");
    assert!(shown.backend == Backend::Gpu && shown.image.pixels != before.pixels);
    assert_eq!(source.devices.lock().expect("no panic before").len(), 2);
    assert!(window.state().message().is_none(), "{:?}", window.state().message());

    lose();
    window.state_mut().set_light("first_lobe", 0.6);
    until(&mut window, "a picture of all cores", is_shown);
    assert_eq!(window.state().shown().expect("it is there").backend, Backend::Cpu);
    let (text, is_failure) = window.state().message().expect("it is said");
    assert!(!is_failure && text.contains("all cores") && text.contains("no adapter"), "{text}");
    source.close(window);
}

#[test]
fn a_number_out_of_range_is_said_and_the_window_stays() {
    let source = Small::new("perlin-fbm");
    let mut window = window(&source, Backend::Cpu);
    until(&mut window, "a picture", is_shown);
    window.state_mut().set_light("second_share", 7.0);
    until(&mut window, "a message", |app| app.message().is_some_and(|(_, is_failure)| is_failure));
    let (text, _) = window.state().message().expect("it is there");
    assert!(text.contains("second_share") && text.contains('7'), "{text}");
    assert!(window.state().shown().is_some(), "the old picture stands");
    window.state_mut().set_light("second_share", 0.5);
    until(&mut window, "the next picture", is_shown);
    assert!(window.state().message().is_none_or(|(_, is_failure)| !is_failure));
}

/// Settings as a study knows them: the window says which it is, and another budget takes another.
#[test]
fn a_budget_picks_a_setting_of_the_front() {
    let mut source = Arc::into_inner(Small::new("perlin-fbm")).expect("nobody else has it");
    let choice = |words: &str, milliseconds_a_pixel, error| Choice {
        words: words.into(),
        milliseconds_a_pixel,
        error: [error, 0.01 * error],
    };
    // So fast and so slow that no machine's own times of the first pictures change what fits.
    source.front = vec![choice("few steps", 1e-9, 0.2), choice("many steps", 1e6, 0.01)];
    let mut window = window(&Arc::new(source), Backend::Cpu);
    until(&mut window, "a picture", is_shown);
    assert_eq!(window.state().changes().setting, Some(0));
    let text = window.state().setting_text().expect("it is of the front");
    assert!(text.contains("1 of 2, by the budget") && text.contains("few steps") && text.contains("0.2"), "{text}");
    let few = window.state().shown().expect("it is there").image.clone();
    window.state_mut().set_budget(1e12);
    until(&mut window, "a picture of the other setting", |app| {
        app.is_up_to_date() && app.shown().is_some_and(|shown| shown.image.pixels != few.pixels)
    });
    assert!(window.state().setting_text().is_some_and(|text| text.contains("many steps")));
    // Who chooses one has it, whatever the budget.
    window.get_by_label("Quality by the budget").click();
    window.step();
    window.state_mut().set_budget(1e-12);
    window.step();
    window.step();
    assert_eq!(window.state().changes().setting, Some(1));
}

/// Kilobytes of memory that the process holds.
#[cfg(target_os = "linux")]
fn resident() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").expect("Linux has it");
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("it is there");
    line.trim().trim_end_matches(" kB").parse().expect("a number")
}

/// As many changes as an hour of dragging has, one a second; run by hand, as it takes minutes. Buffers and pictures of a change are gone
/// with the next: after the first sixth, in which allocators and drivers fill up, nothing grows by more than a page of memory a change.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "takes minutes: cargo test --release --test viewer -- --ignored --nocapture"]
fn an_hour_of_dragging_takes_no_more_memory() {
    if !support::require("vulkan") {
        return;
    }
    let source = Small::new("graph");
    let mut window = window(&source, Backend::Gpu);
    until(&mut window, "a picture", is_shown);
    let mut before = 0;
    for step in 0..3600_u32 {
        let turn = f64::from(step) * 0.01;
        let app = window.state_mut();
        app.set_sun([turn.sin(), 0.1 * turn.cos()]);
        app.set_light("first_lobe", 0.4 + 0.3 * turn.sin());
        app.set_scene("Density", 1.0 + 0.5 * turn.sin());
        let pictures = app.pictures();
        until(&mut window, "a picture", |app| app.pictures() > pictures);
        if step == 600 {
            before = resident();
        }
        if step % 600 == 0 {
            println!("{step} changes: {} kB", resident());
        }
    }
    let grown = resident().saturating_sub(before);
    println!("3000 changes: {grown} kB more than {before} kB");
    assert!(grown <= 3000 * 4, "{grown} kB");
}

/// What the window takes for the cloud, for docs/viewer.md; run by hand on an idle machine. A picture: in full, as at rest. Latency: from a
/// number that is set to the first picture of it on the screen.
#[test]
#[ignore = "a table of times: cargo test --release --test viewer times -- --ignored --nocapture"]
fn times_of_the_window() {
    if !support::require("vulkan") {
        return;
    }
    let hardware = Gpu::open().is_ok_and(|gpu| !gpu.adapter().is_software());
    let sizes: &[[u32; 2]] = if hardware { &[[640, 360], [1920, 1080]] } else { &[[640, 360]] };
    for (&size, quality) in sizes.iter().flat_map(|size| ["low", "medium", "high"].map(|quality| (size, quality))) {
        println!("{size:?}");
        let source = Small::sized("graph", Some(quality), "clouds-in-daylight", size);
        let mut window = window(&source, Backend::Gpu);
        let begin = Instant::now();
        until(&mut window, "a picture", is_shown);
        println!("{quality}: first picture after {:.0} ms", begin.elapsed().as_secs_f64() * 1e3);
        type Step = fn(&mut App, f64);
        let steps: [(&str, Step); 3] = [
            ("sun", |app, turn| app.set_sun([turn, 0.0])),
            ("light", |app, turn| app.set_light("first_lobe", 0.4 + 0.1 * turn)),
            ("material", |app, turn| app.set_scene("Density", 1.1 + 0.1 * turn)),
        ];
        for (name, step) in steps {
            let (mut latencies, mut pictures) = (Vec::new(), Vec::new());
            for turn in 1..=9 {
                let (begin, before) = (Instant::now(), window.state().pictures());
                step(window.state_mut(), f64::from(turn) * 0.1);
                until(&mut window, "a picture", |app| app.pictures() > before);
                latencies.push(begin.elapsed().as_secs_f64() * 1e3);
                until(&mut window, "the picture in full", is_shown);
                pictures.push(window.state().shown().expect("it is there").milliseconds);
            }
            let [(latency, most), (picture, _)] = [latencies, pictures].map(|mut times| {
                times.sort_by(f64::total_cmp);
                (times[times.len() / 2], times[times.len() - 1])
            });
            println!(
                "{quality}, {name}: {picture:.1} ms a picture ({:.1} a second), latency {latency:.0} ms, at most {most:.0}",
                1e3 / picture
            );
        }
    }
}

/// Display values of all colours of an axis, by Blender's own colour management.
fn display_values(view: &str, look: &str, axis: &[f64]) -> Vec<[f32; 3]> {
    let folder = tempfile::tempdir().expect("a folder");
    let values = folder.path().join("values.npy");
    let request = serde_json::json!({
        "op": "cube", "axis": axis, "values": values, "view": view, "look": look, "gamma": 1.0,
    });
    let kernel = cloudparity::bridge::CyclesKernel::Default;
    let script = cloudparity::measure::pictures::SCRIPT;
    let result = cloudparity::bridge::run_script(script, &request, kernel, |_| ()).expect("display values");
    assert_eq!(result["view_used"], format!("{view}, look {look}"));
    let (values, shape) = cloudparity::base::files::read_values(&values).expect("an array");
    assert_eq!(shape, [axis.len(), axis.len(), axis.len(), 3]);
    values.chunks_exact(3).map(|colour| [colour[0], colour[1], colour[2]]).collect()
}

/// The table against Blender in the middles of its cells, where it knows least: half of these colours are off by less than half a display value,
/// which is what rounding to bytes is off by.
#[test]
fn view_transforms_are_those_of_blender() {
    if !support::require("bpy") {
        return;
    }
    for (view, look) in [("AgX", "None"), ("AgX", "AgX - Punchy"), ("Filmic", "None"), ("Khronos PBR Neutral", "None")]
    {
        let cube = DisplayTable::new(view.to_owned(), 97, display_values(view, look, &DisplayTable::axis(97)));
        // Half a step of the table from its own values, where it knows least, and elsewhere; up to 16.
        let own = DisplayTable::axis(97);
        let mut axis: Vec<f64> =
            own.windows(2).map(|pair| (pair[0] + pair[1]) / 2.0).filter(|&value| value < 16.0).collect();
        axis.extend([0.0, 0.18, 0.5, 1.0]);
        let exact = display_values(view, look, &axis);
        let count = axis.len();
        let mut off = Vec::with_capacity(exact.len());
        for (index, wanted) in exact.iter().enumerate() {
            let colour = [index / count / count, index / count % count, index % count].map(|place| axis[place] as f32);
            let found = cube.shown(colour);
            let largest =
                found.iter().zip(wanted).map(|(found, wanted)| (found - wanted).abs()).fold(0.0_f32, f32::max);
            off.push(255.0 * largest);
        }
        off.sort_by(f32::total_cmp);
        let part = |share: f64| off[((off.len() - 1) as f64 * share) as usize];
        println!(
            "{view}, {look}: {} colours, half off by {:.3}, 99 % by {:.3}, all by {:.3}",
            off.len(),
            part(0.5),
            part(0.99),
            part(1.0)
        );
        assert!(part(0.5) < 0.5, "{view}: half of the colours are off by {} display values", part(0.5));
        // Light that the curve of sRGB cuts off.
        let bright = [4.0, 4.0, 4.0, 1.0];
        let shown = Curve::of(Arc::new(cube), 0.0).shown(bright)[0];
        assert!(shown < 255 && Curve::standard(0.0).shown(bright)[0] == 255, "{view}: {shown}");
    }
}
