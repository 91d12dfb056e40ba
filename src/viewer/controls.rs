//! The column of numbers beside the picture.

use super::Changes;
use super::look::Look;
use crate::engines::light::models as lights;
use crate::engines::parameters::{Parameter, Range};
use crate::engines::{self, Engine};
use crate::scene::Scene;
use eframe::egui::{self, DragValue, Slider, SliderClamping, Ui};
use indexmap::IndexMap;

/// Ratio of the ends of a range from which on a slider goes by factors.
const BY_FACTORS: f64 = 30.0;

/// A number that was given, the range of the slider and what is allowed.
struct Number<'a> {
    title: &'a str,
    about: String,
    slider: Option<[f64; 2]>,
    is_whole: bool,
    value: f64,
}

impl Number<'_> {
    /// Shows it; the new value where it was changed, and whether the change is to be undone.
    fn show(&self, ui: &mut Ui, is_changed: bool) -> (Option<f64>, bool) {
        let mut value = self.value;
        let mut undone = false;
        let response = ui
            .horizontal(|ui| {
                let response = match self.slider {
                    Some([low, high]) => {
                        // A range from 0 whose usual values are near its beginning, as Blender's limits often are, too.
                        let least = if low > 0.0 { low } else { self.value.abs().max(high * 1e-3) };
                        let by_factors = low >= 0.0 && high / least >= BY_FACTORS && !self.is_whole;
                        let mut slider = Slider::new(&mut value, low..=high)
                            .logarithmic(by_factors)
                            .clamping(SliderClamping::Never)
                            .text(self.title);
                        if self.is_whole {
                            slider = slider.integer();
                        }
                        ui.add(slider)
                    }
                    None => {
                        let speed = (value.abs() * 0.01).max(0.001);
                        let response = ui.add(DragValue::new(&mut value).speed(speed));
                        let label = ui.label(self.title);
                        response.labelled_by(label.id)
                    }
                };
                if is_changed {
                    undone = ui.small_button("Undo").on_hover_text(format!("{}: as it was", self.title)).clicked();
                }
                response
            })
            .inner;
        let response = if self.about.is_empty() { response } else { response.on_hover_text(&self.about) };
        let value = if self.is_whole { value.round() } else { value };
        (Some(value).filter(|_| response.changed()), undone)
    }

    /// Shows it, and writes what was changed under its name.
    fn edit(&self, ui: &mut Ui, name: &str, changes: &mut IndexMap<String, f64>) {
        let (value, undone) = self.show(ui, changes.contains_key(name));
        if let Some(value) = value {
            changes.insert(name.to_owned(), value);
        }
        if undone {
            changes.shift_remove(name);
        }
    }
}

/// A parameter of a system or a light.
fn parameter(ui: &mut Ui, parameter: &Parameter, value: f64, changes: &mut IndexMap<String, f64>) {
    let unit = if parameter.unit.is_empty() { String::new() } else { format!(", {}", parameter.unit) };
    Number {
        title: parameter.name,
        about: format!("{} ({}{unit})", parameter.about, parameter.range),
        slider: Some(parameter.usual).filter(|[low, high]| low < high),
        is_whole: matches!(parameter.range, Range::Whole(..)),
        value: changes.get(parameter.name).copied().unwrap_or(value),
    }
    .edit(ui, parameter.name, changes);
}

/// Where the light is and how it is looked at.
pub(super) fn of_look(ui: &mut Ui, look: &mut Look, stops: &mut f64) {
    egui::CollapsingHeader::new("View").default_open(true).show(ui, |ui| {
        ui.add(Slider::new(stops, -8.0..=8.0).text("Exposure").suffix(" stops"))
            .on_hover_text("Stops of the display alone; the sRGB curve follows, Blender's view transform Standard.");
        let degrees = |ui: &mut Ui, value: &mut f64, title: &str, range: std::ops::RangeInclusive<f64>| {
            let mut shown = value.to_degrees();
            if ui.add(Slider::new(&mut shown, range).text(title).suffix("°")).changed() {
                *value = shown.to_radians();
            }
        };
        degrees(ui, &mut look.sun[0], "Sun around", -180.0..=180.0);
        degrees(ui, &mut look.sun[1], "Sun upwards", -90.0..=90.0);
        ui.add(Slider::new(&mut look.sun_strength, 0.01..=100.0).logarithmic(true).text("Sun strength"))
            .on_hover_text("Factor on the strength of the scene's suns.");
        ui.add(Slider::new(&mut look.scale, 0.125..=2.0).logarithmic(true).text("Resolution"))
            .on_hover_text("Pixels of the picture over those of the scene, along an axis.");
        ui.horizontal(|ui| {
            if ui.button("Scene's camera").clicked() {
                let Look { sun, sun_strength, scale, .. } = *look;
                *look = Look { sun, sun_strength, scale, ..Look::default() };
            }
            if ui.button("Scene's sun").clicked() {
                let Look { sun, sun_strength, .. } = Look::default();
                (look.sun, look.sun_strength) = (sun, sun_strength);
            }
        });
    });
}

/// Numbers of the scene's material, of the system and of its light.
pub(super) fn of_changes(ui: &mut Ui, scene: &Scene, engine: &Engine, changes: &mut Changes) {
    let settable = scene.settable();
    if engines::find(engine.model).is_ok_and(|model| model.is_of_scene) && !settable.is_empty() {
        egui::CollapsingHeader::new("Material").default_open(true).show(ui, |ui| {
            for one in &settable {
                let Some(stored) = one.value.as_f64() else { continue };
                let limits = one.limits.map(|limit| limit.filter(|limit| limit.abs() < f32::MAX));
                let slider = match limits {
                    [Some(low), Some(high)] if low < high => Some([low, high].map(f64::from)),
                    _ => None,
                };
                Number {
                    title: &one.name,
                    about: one.about.clone().unwrap_or_default(),
                    slider,
                    is_whole: false,
                    value: changes.scene.get(&one.name).copied().unwrap_or(stored),
                }
                .edit(ui, &one.name, &mut changes.scene);
            }
        });
    }
    let Ok(model) = engines::find(engine.model) else { return };
    egui::CollapsingHeader::new(format!("System {}", model.id)).default_open(true).show(ui, |ui| {
        if !model.qualities.is_empty() {
            let title = changes.quality.clone().unwrap_or_else(|| "as given".into());
            egui::ComboBox::from_label("Values").selected_text(title).show_ui(ui, |ui| {
                ui.selectable_value(&mut changes.quality, None, "as given");
                for (name, _) in model.qualities {
                    ui.selectable_value(&mut changes.quality, Some((*name).to_owned()), *name);
                }
            });
        }
        for one in model.parameters {
            let Some(value) = engine.values.given(one.name) else { continue };
            parameter(ui, one, value, &mut changes.density);
        }
    });
    egui::CollapsingHeader::new("Light").show(ui, |ui| {
        let title = changes.light.clone().unwrap_or_else(|| "as given".into());
        egui::ComboBox::from_label("Light model").selected_text(title).show_ui(ui, |ui| {
            ui.selectable_value(&mut changes.light, None, "as given");
            for light in lights::LIGHTS {
                ui.selectable_value(&mut changes.light, Some(light.id.to_owned()), light.id).on_hover_text(light.about);
            }
        });
        for one in lights::PARAMETERS {
            let Some(value) = lights::value(&engine.light, one.name) else { continue };
            parameter(ui, one, value, &mut changes.of_light);
        }
    });
}
