//! The window's state and what it shows.

use super::compare::{self, Curve, FULL_DIFFERENCE, Mode, Statistics};
use super::engine_thread::{self, EngineThread, Shown, Wanted};
use super::look::Look;
use super::quality::Quality;
use super::truth_thread::{self, Truth};
use super::{Changes, Record, Source, controls};
use crate::base::display_table::DisplayTable;
use crate::base::error::{Error, Result};
use crate::base::numbers::uncertain;
use crate::gpu::Backend;
use eframe::egui::{self, Color32, ColorImage, Sense, TextureHandle, TextureOptions, Ui, Vec2};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long a view rests before the truth of it is begun.
const REST: Duration = Duration::from_millis(400);

/// How long each of two pictures is seen in turn.
const FLIP: f64 = 0.7;

/// Radians a point of a drag.
const TURN: f64 = 0.008;

/// Half size, quarter size: while something moves, pictures are made smaller until they take no longer than is wanted.
const COARSEST: f64 = 0.125;

/// How visible the difference is to the truth as it was after some samples.
struct Visible {
    wanted: Wanted,
    samples: u32,
    flip: f64,
}

/// The window.
pub struct App {
    source: Arc<dyn Source>,
    wanted: Wanted,
    /// The last that was asked for, and when it was; with the scale of pictures while something moves.
    asked: Option<Wanted>,
    changed: Instant,
    is_truth_asked: bool,
    engine: EngineThread,
    truth_thread: (Sender<Option<Wanted>>, Receiver<truth_thread::Answer>),
    shown: Option<Arc<Shown>>,
    pictures: u64,
    truth: Option<Truth>,
    statistics: Option<Statistics>,
    visible: Option<Visible>,
    visible_answer: Option<Receiver<Result<Option<Visible>>>>,
    is_flip_known: bool,
    mode: Mode,
    wipe: f64,
    stops: f64,
    /// The scene's view transform, as soon as it is known; and whether it is what is shown.
    cube: Option<Arc<DisplayTable>>,
    cube_answer: Option<Receiver<Result<Option<DisplayTable>>>>,
    is_scenes_view: bool,
    is_playing: bool,
    speed: f64,
    /// Milliseconds that a picture may take while something moves.
    budget: f64,
    moving_scale: f64,
    /// Settings that a budget picks from, and whether it does.
    quality: Quality,
    is_by_budget: bool,
    /// What is to be said, and whether it is a failure.
    message: Option<(String, bool)>,
    saving: Option<Receiver<Result<String>>>,
    texture: Option<TextureHandle>,
    is_stale: bool,
    flip: bool,
    /// Where a picture of the window goes as soon as the truth has that many samples; then the window closes.
    photograph: Option<(PathBuf, u32)>,
    is_asked_for_photograph: bool,
    /// What writing it came to, where that failed.
    failure: Arc<Mutex<Option<Error>>>,
}

impl App {
    /// Starts its threads. `wake` is called when there is something new to show.
    pub fn new(source: Arc<dyn Source>, backend: Backend, wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        let engine = EngineThread::start(Arc::clone(&source), backend, Arc::clone(&wake));
        let (ask_truth, truth_requests) = channel();
        let (truth_answers, hear_truth) = channel();
        let (own, woken) = (Arc::clone(&source), Arc::clone(&wake));
        std::thread::spawn(move || truth_thread::run(&*own, &truth_requests, &truth_answers, &*woken));
        let (answer_cube, cube_answer) = channel();
        let own = Arc::clone(&source);
        std::thread::spawn(move || {
            let _ = answer_cube.send(own.view_transform());
            wake();
        });
        Self {
            wanted: Wanted { look: Look::default(), changes: Changes::default() },
            asked: None,
            changed: Instant::now(),
            is_truth_asked: false,
            engine,
            truth_thread: (ask_truth, hear_truth),
            shown: None,
            pictures: 0,
            truth: None,
            statistics: None,
            visible: None,
            visible_answer: None,
            is_flip_known: true,
            mode: Mode::Engine,
            wipe: 0.5,
            stops: 0.0,
            cube: None,
            cube_answer: Some(cube_answer),
            is_scenes_view: true,
            is_playing: false,
            speed: 1.0,
            budget: 100.0,
            moving_scale: 1.0,
            is_by_budget: !source.front().is_empty(),
            quality: Quality::new(source.front()),
            message: None,
            saving: None,
            texture: None,
            is_stale: true,
            flip: false,
            photograph: None,
            is_asked_for_photograph: false,
            failure: Arc::default(),
            source,
        }
    }

    /// The engine's picture that is seen.
    pub fn shown(&self) -> Option<&Shown> {
        self.shown.as_deref()
    }

    /// The truth of the view that is seen, as far as it is known.
    pub fn truth(&self) -> Option<&Truth> {
        let shown = self.shown.as_ref()?;
        self.truth.as_ref().filter(|truth| truth.wanted == shown.wanted)
    }

    /// Error of the picture that is seen.
    pub fn statistics(&self) -> Option<Statistics> {
        self.statistics
    }

    /// What is looked at.
    pub fn look(&self) -> Look {
        self.wanted.look
    }

    /// What was changed.
    pub fn changes(&self) -> &Changes {
        &self.wanted.changes
    }

    /// Sets a parameter of the system, as its slider does.
    pub fn set_density(&mut self, name: &str, value: f64) {
        self.wanted.changes.density.insert(name.to_owned(), value);
        self.changed = Instant::now();
    }

    /// Sets a parameter of its light.
    pub fn set_light(&mut self, name: &str, value: f64) {
        self.wanted.changes.of_light.insert(name.to_owned(), value);
        self.changed = Instant::now();
    }

    /// Sets a value of the scene's material.
    pub fn set_scene(&mut self, name: &str, value: f64) {
        self.wanted.changes.scene.insert(name.to_owned(), value);
        self.changed = Instant::now();
    }

    /// Pictures of the engine that were seen so far.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Turns the suns, in radians around the world's z axis and upwards.
    pub fn set_sun(&mut self, sun: [f64; 2]) {
        self.wanted.look.sun = sun;
        self.changed = Instant::now();
    }

    /// Whether the picture that is seen is what is wanted now, in full.
    pub fn is_up_to_date(&self) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.wanted == self.wanted)
    }

    /// What the window says, and whether it is a failure.
    pub fn message(&self) -> Option<(&str, bool)> {
        self.message.as_ref().map(|(text, is_failure)| (text.as_str(), *is_failure))
    }

    /// Shows everything and takes what is done with it.
    pub fn ui(&mut self, ui: &mut Ui) {
        self.hear();
        self.hear_cube();
        self.hear_flip();
        let before = self.wanted.clone();
        let passed = f64::from(ui.input(|input| input.stable_dt)).min(0.25);
        if self.is_playing {
            self.wanted.changes.seconds += passed * self.speed;
        }
        if self.is_by_budget {
            let [width, height] = self.wanted.look.size(self.source.scene()).map(f64::from);
            self.wanted.changes.setting = self.quality.pick(self.budget, width * height);
        }
        egui::Panel::right("numbers").resizable(true).default_size(390.0).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| self.numbers(ui));
        });
        egui::Panel::bottom("figures").show(ui, |ui| self.figures(ui));
        egui::CentralPanel::default().show(ui, |ui| self.picture(ui));
        if self.wanted != before {
            self.changed = Instant::now();
        }
        self.ask(ui.ctx());
    }

    /// Takes what the threads have.
    fn hear(&mut self) {
        while let Some(answer) = self.engine.answer() {
            match answer {
                engine_thread::Answer::Shown(shown) => {
                    self.adapt(&shown);
                    if self.message.as_ref().is_some_and(|(_, is_failure)| *is_failure) {
                        self.message = None;
                    }
                    self.shown = Some(Arc::from(shown));
                    self.pictures += 1;
                    self.renew();
                }
                engine_thread::Answer::NoAdapter(error) => {
                    self.message = Some((format!("The engine runs on all cores. {error}"), false));
                }
                engine_thread::Answer::Failed(error) => self.message = Some((error.to_string(), true)),
            }
        }
        let mut heard = false;
        while let Ok(answer) = self.truth_thread.1.try_recv() {
            match answer {
                truth_thread::Answer::Truth(truth) => (self.truth, heard) = (Some(*truth), true),
                truth_thread::Answer::Failed(error) => {
                    self.message = Some((format!("There is no truth of this: {error}"), true));
                }
            }
        }
        if heard {
            self.renew();
        }
        if let Some(answer) = self.saving.as_ref().and_then(|saving| saving.try_recv().ok()) {
            self.message = Some(match answer {
                Ok(text) => (text, false),
                Err(error) => (error.to_string(), true),
            });
            self.saving = None;
        }
    }

    /// Takes the scene's view transform.
    fn hear_cube(&mut self) {
        let Some(answer) = self.cube_answer.as_ref().and_then(|answer| answer.try_recv().ok()) else { return };
        self.cube_answer = None;
        match answer {
            Ok(cube) => self.cube = cube.map(Arc::new),
            Err(error) => self.message = Some((format!("Shown as Standard, not as the scene says. {error}"), false)),
        }
        self.is_stale = true;
    }

    /// How linear colours are shown now.
    fn curve(&self) -> Curve {
        let stops = self.stops + f64::from(self.source.scene().display.exposure);
        match &self.cube {
            Some(cube) if self.is_scenes_view => Curve::of(Arc::clone(cube), stops),
            _ => Curve::standard(stops),
        }
    }

    /// Takes HDR-FLIP, and asks for it where the truth has twice the samples that it was last computed with: it takes a second or so.
    fn hear_flip(&mut self) {
        if let Some(answer) = self.visible_answer.as_ref().and_then(|answer| answer.try_recv().ok()) {
            self.visible_answer = None;
            match answer {
                Ok(Some(visible)) => self.visible = Some(visible),
                Ok(None) => self.is_flip_known = false,
                Err(error) => {
                    self.is_flip_known = false;
                    self.message = Some((format!("There is no HDR-FLIP. {error}"), false));
                }
            }
        }
        if self.visible_answer.is_some() || !self.is_flip_known || self.statistics.is_none() {
            return;
        }
        let (Some(shown), Some(truth)) = (&self.shown, self.truth()) else { return };
        let known =
            self.visible.as_ref().filter(|visible| visible.wanted == truth.wanted).map(|visible| visible.samples);
        if known.is_some_and(|known| truth.samples < 2 * known.max(1)) {
            return;
        }
        let (source, shown, mean) = (Arc::clone(&self.source), Arc::clone(shown), Arc::clone(&truth.mean));
        let (wanted, samples) = (truth.wanted.clone(), truth.samples);
        let (sender, receiver) = channel();
        self.visible_answer = Some(receiver);
        std::thread::spawn(move || {
            let found = source.flip(&shown.image, &mean);
            let _ = sender.send(found.map(|flip| flip.map(|flip| Visible { wanted, samples, flip })));
        });
    }

    /// A smaller picture next time where this one took too long, a larger one where there was time for it.
    fn adapt(&mut self, shown: &Shown) {
        // Smaller pictures take longer a pixel, and the first of a new kernel waits for the driver.
        let is_new = self.shown.as_ref().is_none_or(|before| before.compilations != shown.compilations);
        if let Some(setting) = shown.wanted.changes.setting
            && !is_new
            && shown.wanted.look.scale == self.wanted.look.scale
        {
            self.quality.note(setting, shown.milliseconds, (shown.image.width * shown.image.height) as f64);
        }
        if shown.milliseconds > 0.0 {
            let at_once = shown.wanted.look.scale / self.wanted.look.scale;
            let wanted = at_once * (self.budget / shown.milliseconds).sqrt();
            // By halves, so that buffers and pictures keep their sizes.
            self.moving_scale = wanted.log2().floor().exp2().clamp(COARSEST, 1.0);
        }
    }

    /// What follows from a new picture.
    fn renew(&mut self) {
        self.is_stale = true;
        self.statistics = match (&self.shown, self.truth()) {
            (Some(shown), Some(truth)) => Statistics::of(&shown.image, &truth.replicas),
            _ => None,
        };
    }

    /// Asks for the next picture and for the truth where there is something to ask for.
    fn ask(&mut self, context: &egui::Context) {
        let rests = !self.is_playing && self.changed.elapsed() >= REST;
        let mut wanted = self.wanted.clone();
        if !rests {
            // What is seen in full is not asked for again, smaller.
            if !self.is_up_to_date() {
                wanted.look.scale *= self.moving_scale;
            }
            context.request_repaint_after(REST.saturating_sub(self.changed.elapsed()) + Duration::from_millis(5));
        }
        if self.asked.as_ref() != Some(&wanted) {
            // One at a time while something moves: a picture that is not waited for is of no use.
            let is_idle = match (&self.asked, &self.shown) {
                (Some(asked), Some(shown)) => shown.wanted == *asked || self.message.as_ref().is_some_and(|one| one.1),
                (Some(_), None) => self.message.as_ref().is_some_and(|one| one.1),
                (None, _) => true,
            };
            if is_idle || rests {
                self.engine.ask(wanted.clone());
                if self.is_truth_asked {
                    let _ = self.truth_thread.0.send(None);
                    self.is_truth_asked = false;
                }
                self.asked = Some(wanted);
            }
        } else if rests && !self.is_truth_asked && self.shown.as_ref().is_some_and(|shown| shown.wanted == wanted) {
            let _ = self.truth_thread.0.send(Some(wanted));
            self.is_truth_asked = true;
        }
        if self.is_playing || self.mode == Mode::Flip {
            context.request_repaint_after(Duration::from_millis(30));
        }
    }

    fn numbers(&mut self, ui: &mut Ui) {
        ui.add_space(6.0);
        egui::ComboBox::from_label("Shown").selected_text(title(self.mode)).show_ui(ui, |ui| {
            for (mode, title) in Mode::ALL {
                if ui.selectable_value(&mut self.mode, mode, title).clicked() {
                    self.is_stale = true;
                }
            }
        });
        if self.mode == Mode::Wipe && ui.add(egui::Slider::new(&mut self.wipe, 0.0..=1.0).text("Wipe")).changed() {
            self.is_stale = true;
        }
        if self.mode == Mode::Difference {
            ui.weak(format!(
                "Blue: the engine is darker; red: brighter; full colour from {FULL_DIFFERENCE} of the truth."
            ));
        }
        ui.horizontal(|ui| {
            if ui
                .button("Record this pair")
                .on_hover_text("Both pictures and their differences, for cloudparity report")
                .clicked()
            {
                self.record();
            }
            if ui.button("Save preset").on_hover_text("The engine as it is now, for render, publish and tune").clicked()
            {
                self.message = Some(match self.source.save_preset(&self.wanted.changes) {
                    Ok(text) => (text, false),
                    Err(error) => (error.to_string(), true),
                });
            }
        });
        ui.horizontal(|ui| {
            if ui.button(if self.is_playing { "Pause" } else { "Play" }).clicked() {
                self.is_playing ^= true;
            }
            ui.add(egui::DragValue::new(&mut self.wanted.changes.seconds).speed(0.05).suffix(" s"))
                .on_hover_text("Time");
            ui.add(egui::Slider::new(&mut self.speed, 0.1..=10.0).logarithmic(true).text("Speed"));
        });
        ui.add(egui::Slider::new(&mut self.budget, 5.0..=2000.0).logarithmic(true).text("Budget").suffix(" ms"))
            .on_hover_text(
                "What a picture may take while something moves: it is made smaller for it, and in full when it rests.",
            );
        self.settings(ui);
        if let Some(cube) = &self.cube {
            let names = [cube.name().to_owned(), "Standard".to_owned()];
            let shown = usize::from(!self.is_scenes_view);
            egui::ComboBox::from_label("View transform").selected_text(&names[shown]).show_ui(ui, |ui| {
                for (name, is_scenes) in names.iter().zip([true, false]) {
                    self.is_stale |= ui.selectable_value(&mut self.is_scenes_view, is_scenes, name).clicked();
                }
            });
        }
        let stops = self.stops;
        controls::of_look(ui, &mut self.wanted.look, &mut self.stops);
        self.is_stale |= self.stops != stops;
        if let Some(shown) = self.shown.clone() {
            controls::of_changes(ui, self.source.scene(), &shown.engine, &mut self.wanted.changes);
        }
        ui.add_space(12.0);
    }

    /// Which setting of the front it is, and whether the budget says so.
    fn settings(&mut self, ui: &mut Ui) {
        if self.quality.choices().is_empty() {
            return;
        }
        ui.checkbox(&mut self.is_by_budget, "Quality by the budget").on_hover_text(
            "Of the settings that were measured, the one of least error that a picture has the time for.",
        );
        let setting = &mut self.wanted.changes.setting;
        let words = |setting: Option<usize>| match setting {
            Some(number) => self.quality.choices()[number].words.as_str(),
            None => "as given",
        };
        let before = *setting;
        egui::ComboBox::from_label("Setting").selected_text(words(before)).width(240.0).show_ui(ui, |ui| {
            ui.selectable_value(setting, None, words(None));
            for number in 0..self.quality.choices().len() {
                ui.selectable_value(setting, Some(number), words(Some(number)));
            }
        });
        self.is_by_budget &= *setting == before;
    }

    /// The setting of the front that is seen, with what was measured of it.
    pub fn setting_text(&self) -> Option<String> {
        let shown = self.shown.as_ref()?;
        let number = shown.wanted.changes.setting?;
        let choice = &self.quality.choices()[number];
        let [error, standard_error] = choice.error;
        let expected = choice.milliseconds_a_pixel * (shown.image.width * shown.image.height) as f64;
        let by = if self.is_by_budget { format!(", by the budget of {:.0} ms", self.budget) } else { String::new() };
        Some(format!(
            "Setting {} of {}{by}: {}; where it was measured: relMSE {}, {expected:.1} ms for this size.",
            number + 1,
            self.quality.choices().len(),
            choice.words,
            uncertain(error, standard_error)
        ))
    }

    /// Sets the budget in milliseconds, as its slider does.
    pub fn set_budget(&mut self, milliseconds: f64) {
        self.budget = milliseconds;
    }

    fn record(&mut self) {
        let Some(shown) = self.shown.clone() else { return };
        if self.saving.is_some() {
            return;
        }
        let truth = self.truth().map(|truth| Arc::clone(&truth.replicas)).unwrap_or_default();
        let source = Arc::clone(&self.source);
        let (sender, receiver) = channel();
        self.saving = Some(receiver);
        self.message = Some(("Recording.".into(), false));
        std::thread::spawn(move || {
            let record = Record {
                scene: &shown.scene,
                changes: &shown.wanted.changes,
                backend: shown.backend,
                shown: &shown,
                truth: &truth,
            };
            let _ = sender.send(source.record(&record));
        });
    }

    fn figures(&mut self, ui: &mut Ui) {
        ui.add_space(4.0);
        ui.label(self.time_text());
        if let Some(text) = self.setting_text() {
            ui.label(text);
        }
        ui.label(self.error_text());
        if let Some((text, is_failure)) = &self.message {
            let color = if *is_failure { ui.visuals().error_fg_color } else { ui.visuals().weak_text_color() };
            ui.colored_label(color, text);
        }
        ui.add_space(4.0);
    }

    /// Time of the picture that is seen.
    pub fn time_text(&self) -> String {
        let Some(shown) = &self.shown else { return "Compiling.".into() };
        let kernels = shown.kernel_milliseconds.map_or(String::new(), |time| format!(" ({time:.1} ms in kernels)"));
        format!(
            "{} × {}: {:.1} ms{kernels}, prepared in {:.0} ms, {} kernels compiled, {}",
            shown.image.width,
            shown.image.height,
            shown.milliseconds,
            shown.preparation_milliseconds,
            shown.compilations,
            shown.worker
        )
    }

    /// Error of the picture that is seen.
    pub fn error_text(&self) -> String {
        let Some(truth) = self.truth() else { return "Truth: begins when the view rests.".into() };
        let of = match truth.samples {
            0 => format!("{} pictures", truth.replicas.len()),
            samples => format!("{samples} samples a pixel"),
        };
        match self.statistics {
            None => format!("Truth: {of}; an error needs {} of them.", truth_thread::REPLICAS),
            Some(found) if found.standard_error.is_nan() => {
                let [whole, own] = [found.relmse, found.error()];
                format!("Truth: {of}; relMSE {whole:.2e}, without the truth's noise {own:.2e}{}", self.flip_text())
            }
            Some(found) => format!(
                "Truth: {of}; relMSE {:.2e} ± {:.0e} without the truth's noise, {:.2e} with it{}",
                found.error(),
                found.standard_error,
                found.relmse,
                self.flip_text()
            ),
        }
    }

    /// HDR-FLIP of the picture that is seen, with the truth's noise, and how many samples the truth had for it.
    fn flip_text(&self) -> String {
        let visible =
            self.visible.as_ref().filter(|visible| self.truth().is_some_and(|truth| truth.wanted == visible.wanted));
        visible.map_or(String::new(), |Visible { samples, flip, .. }| match samples {
            0 => format!("; HDR-FLIP {flip:.4}"),
            samples => format!("; HDR-FLIP {flip:.4} at {samples} samples"),
        })
    }

    fn picture(&mut self, ui: &mut Ui) {
        let Some(shown) = self.shown.clone() else {
            ui.centered_and_justified(|ui| match &self.message {
                Some((text, true)) => ui.label(text),
                _ => ui.spinner(),
            });
            return;
        };
        let mut mode = self.mode;
        if mode == Mode::Flip {
            let second = ui.input(|input| input.time) % (2.0 * FLIP) >= FLIP;
            self.is_stale |= second != self.flip;
            self.flip = second;
            mode = if second { Mode::Truth } else { Mode::Engine };
        }
        if self.is_stale || self.texture.is_none() {
            let truth = self.truth().map(|truth| Arc::clone(&truth.mean));
            let screen = compare::screen(mode, &shown.image, truth.as_deref(), self.wipe, &self.curve());
            let pixels = screen.pixels.iter().map(|&[red, green, blue]| Color32::from_rgb(red, green, blue)).collect();
            let image = ColorImage::new([screen.width, screen.height], pixels);
            match &mut self.texture {
                Some(texture) => texture.set(image, TextureOptions::LINEAR),
                None => self.texture = Some(ui.ctx().load_texture("picture", image, TextureOptions::LINEAR)),
            }
            self.is_stale = false;
        }
        let Some(texture) = &self.texture else { return };
        let (room, size) = (ui.available_size(), texture.size_vec2());
        let scale = (room.x / size.x).min(room.y / size.y).max(0.0);
        let area = ui.centered_and_justified(|ui| {
            ui.add(egui::Image::new((texture.id(), size * scale)).sense(Sense::click_and_drag()).alt_text("Picture"))
        });
        let response = area.inner;
        let first_tag = match (self.mode, self.truth().is_some()) {
            (Mode::Flip, true) => Some(title(mode)),
            (wanted, false) if wanted != Mode::Engine => Some("no truth of this view yet: the engine"),
            _ => None,
        };
        if let Some(text) = first_tag {
            let at = response.rect.left_top() + Vec2::splat(8.0);
            let font = egui::FontId::proportional(14.0);
            ui.painter().text(at, egui::Align2::LEFT_TOP, text, font, Color32::from_rgb(255, 176, 32));
        }
        self.moved(ui, &response, size.y * scale);
    }

    /// The mouse on the picture: drag to orbit, with Shift or the middle button to pan, with Ctrl or the right button to turn the sun; the
    /// wheel for the distance; in a wipe a drag near the line moves the line.
    fn moved(&mut self, ui: &Ui, response: &egui::Response, height: f32) {
        let drag = response.drag_delta();
        let [x, y] = [drag.x, drag.y].map(f64::from);
        let modifiers = ui.input(|input| input.modifiers);
        let look = &mut self.wanted.look;
        if response.dragged() && (x, y) != (0.0, 0.0) {
            let at = response
                .interact_pointer_pos()
                .map_or(-1.0, |at| f64::from((at.x - response.rect.left()) / response.rect.width().max(1.0)));
            if self.mode == Mode::Wipe && (at - self.wipe).abs() < 0.04 {
                self.wipe = (self.wipe + x / f64::from(response.rect.width().max(1.0))).clamp(0.0, 1.0);
                self.is_stale = true;
            } else if modifiers.ctrl || response.dragged_by(egui::PointerButton::Secondary) {
                look.sun[0] += x * TURN;
                look.sun[1] -= y * TURN;
            } else if modifiers.shift || response.dragged_by(egui::PointerButton::Middle) {
                let points = f64::from(height.max(1.0));
                look.pan = [look.pan[0] - x / points, look.pan[1] + y / points];
            } else {
                look.orbit[0] -= x * TURN;
                look.orbit[1] = (look.orbit[1] + y * TURN).clamp(-1.5, 1.5);
            }
        }
        if response.hovered() {
            let wheel = f64::from(ui.input(|input| input.smooth_scroll_delta().y));
            look.distance = (look.distance * (-wheel * 0.002).exp()).clamp(0.02, 50.0);
        }
    }

    /// Takes the photograph that was asked for.
    fn photographs(&mut self, context: &egui::Context) {
        let Some((path, samples)) = self.photograph.clone() else { return };
        let is_there = self.shown.is_some()
            && self.cube_answer.is_none()
            && (samples == 0 || self.truth().is_some_and(|truth| truth.samples >= samples || truth.samples == 0));
        let failed = self.message.as_ref().is_some_and(|(_, is_failure)| *is_failure);
        if (is_there || failed) && !self.is_asked_for_photograph {
            self.is_asked_for_photograph = true;
            let (closing, failure) = (context.clone(), Arc::clone(&self.failure));
            context.send_viewport_cmd(egui::ViewportCommand::Screenshot(egui::ScreenshotCallback::new(move |image| {
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = write_png(&path, &image).err();
                closing.send_viewport_cmd(egui::ViewportCommand::Close);
            })));
        }
        context.request_repaint_after(Duration::from_millis(100));
    }
}

fn title(mode: Mode) -> &'static str {
    Mode::ALL.iter().find(|(other, _)| *other == mode).map_or("", |(_, title)| title)
}

fn write_png(path: &std::path::Path, picture: &ColorImage) -> Result<()> {
    let [width, height] = picture.size.map(|side| side as u32);
    let bytes: Vec<u8> = picture.pixels.iter().flat_map(Color32::to_array).collect();
    let written = image::save_buffer(path, &bytes, width, height, image::ColorType::Rgba8);
    written.map_err(|cause| {
        Error::new(path.display().to_string(), cause.to_string(), "a PNG that can be written", "Give another place.")
    })
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        App::ui(self, ui);
        self.photographs(&ui.ctx().clone());
    }
}

/// Opens the window, and returns when it is closed. With a `photograph`, a picture of it is written as soon as the truth has so many
/// samples of each pixel, and it closes.
pub fn open(
    source: Arc<dyn Source>,
    backend: Backend,
    size: [f32; 2],
    mode: Mode,
    photograph: Option<(PathBuf, u32)>,
) -> Result<()> {
    let title = format!("{}: cloudparity", source.scene().name);
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default().with_title(&title).with_inner_size(size),
        renderer: eframe::Renderer::Wgpu,
        ..Default::default()
    };
    let failure: Arc<Mutex<Option<Error>>> = Arc::default();
    let noted = Arc::clone(&failure);
    let begin = move |context: &eframe::CreationContext<'_>| -> std::result::Result<Box<dyn eframe::App>, _> {
        context.egui_ctx.set_visuals(egui::Visuals::dark());
        let woken = context.egui_ctx.clone();
        let mut app = App::new(source, backend, Arc::new(move || woken.request_repaint()));
        (app.mode, app.photograph, app.failure) = (mode, photograph, noted);
        Ok(Box::new(app))
    };
    let shown = eframe::run_native("cloudparity", options, Box::new(begin)).map_err(|cause| {
        Error::new(
            "the window",
            cause.to_string(),
            "a screen and a driver that draws on it",
            "On Linux: an X server (DISPLAY), the packages libx11-xcb1, libxkbcommon-x11-0 and libxcursor1, and a Vulkan driver \
             (mesa-vulkan-drivers); on a machine without a screen: xvfb-run -a cloudparity view SCENE. A page in a browser instead: \
             cloudparity publish SCENE -o DIR.",
        )
    });
    let failure = failure.lock().unwrap_or_else(PoisonError::into_inner).take();
    shown.and(failure.map_or(Ok(()), Err))
}
