//! Scene-linear pictures and their files.
//!
//! An [`Image`] is RGBA in f32: linear Rec. 709, premultiplied, top row first. EXR files are ZIP
//! compressed scan lines of float channels; provenance travels as text attributes whose names begin
//! with [`ATTRIBUTE_PREFIX`]. A picture without background may hold what each channel lets through of one; in a file those are the
//! channels R, G and B of the layer `transmittance`, beside alpha, which is a single number.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::{self, FileKind};
use exr::prelude::{
    AttributeValue, Compression, Encoding, ImageAttributes, IntegerBounds, Layer, LayerAttributes, LineOrder,
    ReadChannels, ReadLayers, ReadSpecificChannel, SpecificChannels, Text, Vec2, WritableImage,
};
use indexmap::IndexMap;
use std::path::Path;

/// Begins the names of the attributes that say how a picture was made.
pub const ATTRIBUTE_PREFIX: &str = "cloudparity:";

/// What files declare as their colour space, in the attribute colorInteropID: as Blender does.
const COLOR_SPACE: &str = "lin_rec709_scene";

/// Channels of the layer that holds the transmittance.
const TRANSMITTANCE: [&str; 3] = ["transmittance.R", "transmittance.G", "transmittance.B"];

/// A scene-linear RGBA picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Row by row from the top: premultiplied red, green, blue, and alpha.
    pub pixels: Vec<[f32; 4]>,
    /// Share of a background that red, green and blue let through, 0 to 1, for each pixel; none where nothing says so.
    pub transmittance: Option<Vec<[f32; 3]>>,
    /// How it was made: names without prefix, values as text.
    pub provenance: IndexMap<String, String>,
}

impl Image {
    /// A picture of zeros.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[0.0; 4]; width * height], transmittance: None, provenance: IndexMap::new() }
    }

    /// Mean of each channel over all pixels, summed in f64.
    pub fn mean(&self) -> [f64; 4] {
        let count = self.pixels.len().max(1) as f64;
        std::array::from_fn(|channel| self.pixels.iter().map(|pixel| f64::from(pixel[channel])).sum::<f64>() / count)
    }

    /// Mean of pictures of one size, summed in f64. Its provenance is what theirs agree in, and that it is a mean.
    pub fn mean_of(images: &[Self]) -> Result<Self> {
        let Some(first) = images.first() else {
            return Err(Error::new("mean of pictures", "no picture", "at least one", "Render one."));
        };
        if let Some(other) = images.iter().find(|image| (image.width, image.height) != (first.width, first.height)) {
            return Err(Error::new(
                "mean of pictures",
                format!("{} x {} pixels", other.width, other.height),
                format!("{} x {}, as the first", first.width, first.height),
                "Average renders of one picture.",
            ));
        }
        let mut mean = Self::new(first.width, first.height);
        let all: Vec<&[[f32; 4]]> = images.iter().map(|image| image.pixels.as_slice()).collect();
        mean.pixels = mean_pixels(&all);
        let through: Option<Vec<&[[f32; 3]]>> = images.iter().map(|image| image.transmittance.as_deref()).collect();
        mean.transmittance = through.map(|through| mean_pixels(&through));
        let shared = |(name, value): &(&String, &String)| images.iter().all(|i| i.provenance.get(*name) == Some(value));
        mean.provenance = first.provenance.iter().filter(shared).map(|(n, v)| (n.clone(), v.clone())).collect();
        mean.provenance.insert("content".to_owned(), format!("mean of {} replicas", images.len()));
        Ok(mean)
    }

    /// An error that counts the pixels with NaN or infinity and places the first one.
    pub fn check_finite(&self, place: &str) -> Result<()> {
        let wrong = |pixel: &[f32; 4]| pixel.iter().any(|value| !value.is_finite());
        let Some(first) = self.pixels.iter().position(wrong) else { return Ok(()) };
        let count = self.pixels.iter().filter(|pixel| wrong(pixel)).count();
        Err(Error::new(
            place,
            format!(
                "{count} pixels with NaN or infinity, the first in column {}, row {} from the top: {:?}",
                first % self.width,
                first / self.width,
                self.pixels[first]
            ),
            "finite pixels",
            "Look at the density there (cloudparity eval), or allow such pixels to write the picture as it is.",
        )
        .with_setting("allow_nonfinite"))
    }

    /// Writes the picture; a picture with NaN or infinity only if `allow_nonfinite`.
    pub fn write_exr(&self, path: &Path, allow_nonfinite: bool) -> Result<()> {
        if !allow_nonfinite {
            self.check_finite(&path.display().to_string())?;
        }
        // Channels are asked for pixel by pixel: a large picture is not copied to be written.
        let at = |position: Vec2<usize>| position.y() * self.width + position.x();
        let Some(transmittance) = &self.transmittance else {
            let channels = SpecificChannels::rgba(|position| self.pixels[at(position)].into());
            let file = self.in_file(channels);
            return files::replace_atomically(path, |temporary| {
                file.write().to_file(temporary).map_err(std::io::Error::other)
            });
        };
        let [red, green, blue] = TRANSMITTANCE;
        let channels = SpecificChannels::build()
            .with_channel::<f32>("R")
            .with_channel::<f32>("G")
            .with_channel::<f32>("B")
            .with_channel::<f32>("A")
            .with_channel::<f32>(red)
            .with_channel::<f32>(green)
            .with_channel::<f32>(blue)
            .with_pixel_fn(|position| {
                let ([r, g, b, a], [x, y, z]) = (self.pixels[at(position)], transmittance[at(position)]);
                (r, g, b, a, x, y, z)
            });
        let file = self.in_file(channels);
        files::replace_atomically(path, |temporary| file.write().to_file(temporary).map_err(std::io::Error::other))
    }

    /// What a file holds besides the channels.
    fn in_file<C>(&self, channel_data: C) -> exr::image::Image<Layer<C>> {
        let encoding = Encoding {
            compression: Compression::ZIP16,
            blocks: exr::image::Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        let size = Vec2(self.width, self.height);
        // Attribute text is bytes; UTF-8 is what OpenImageIO reads and writes there.
        let text = |text: &str| Text::from_bytes_unchecked(text.bytes().collect());
        let mut attributes = LayerAttributes::default();
        attributes.other.insert(text("colorInteropID"), AttributeValue::Text(text(COLOR_SPACE)));
        for (name, value) in &self.provenance {
            attributes.other.insert(text(&format!("{ATTRIBUTE_PREFIX}{name}")), AttributeValue::Text(text(value)));
        }
        let window = ImageAttributes::new(IntegerBounds::new(attributes.layer_position, size));
        exr::image::Image { attributes: window, layer_data: Layer { channel_data, attributes, size, encoding } }
    }

    /// Why a file is no plain EXR, which is one part with channels R, G and B in floats over its
    /// whole display window, as this program and Blender write; none where it is one, or cannot be
    /// read at all, which the reader explains.
    pub fn why_not_plain(path: &Path) -> Result<Option<String>> {
        files::check_input(path, FileKind::Exr.described())?;
        let Ok(file) = exr::meta::MetaData::read_from_file(path, false) else { return Ok(None) };
        let [header] = file.headers.as_slice() else {
            return Ok(Some(format!("{} parts", file.headers.len())));
        };
        let shown = header.shared_attributes.display_window;
        let (at, size) = (header.own_attributes.layer_position, header.layer_size);
        if header.deep {
            return Ok(Some("a deep picture".into()));
        }
        if (shown.position, shown.size) != (at, size) {
            let pixels = |size: Vec2<usize>, at: Vec2<i32>| format!("{} x {} at {}, {}", size.0, size.1, at.0, at.1);
            let (stored, shown) = (pixels(size, at), pixels(shown.size, shown.position));
            return Ok(Some(format!("{stored} of the {shown} pixels of its display window")));
        }
        let missing = ["R", "G", "B"].into_iter().find(|name| {
            let is_it = |channel: &exr::meta::attribute::ChannelDescription| {
                channel.name.eq(name) && channel.sample_type != exr::meta::attribute::SampleType::U32
            };
            !header.channels.list.iter().any(is_it)
        });
        Ok(missing.map(|name| format!("no channel {name} of floats")))
    }

    /// Reads a plain EXR ([`Self::why_not_plain`]) with channels R, G, B and, if there are, A (else
    /// 1) and the transmittance's.
    pub fn read_exr(path: &Path) -> Result<Self> {
        kinds::want(path, FileKind::Exr)?;
        let place = path.display().to_string();
        if let Some(found) = Self::why_not_plain(path)? {
            return Err(Error::new(
                place,
                found,
                "one picture with channels R, G, B in floats over its whole display window",
                "Save the one picture that is meant by itself, uncropped.",
            ));
        }
        let [red, green, blue] = TRANSMITTANCE;
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .specific_channels()
            .required("R")
            .required("G")
            .required("B")
            .optional("A", 1.0_f32)
            .optional(red, 1.0_f32)
            .optional(green, 1.0_f32)
            .optional(blue, 1.0_f32)
            .collect_pixels(
                |resolution, (_, _, _, _, red, green, blue)| {
                    let holds = red.is_some() && green.is_some() && blue.is_some();
                    let mut read = Self::new(resolution.width(), resolution.height());
                    read.transmittance = holds.then(|| vec![[1.0; 3]; resolution.area()]);
                    read
                },
                |read, position, pixel: (f32, f32, f32, f32, f32, f32, f32)| {
                    let at = position.y() * read.width + position.x();
                    read.pixels[at] = [pixel.0, pixel.1, pixel.2, pixel.3];
                    if let Some(transmittance) = &mut read.transmittance {
                        transmittance[at] = [pixel.4, pixel.5, pixel.6];
                    }
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .map_err(|cause| {
                Error::new(place, cause.to_string(), "an EXR with channels R, G, B", "Render the picture again.")
            })?;
        let layer = image.layer_data;
        let mut provenance = IndexMap::new();
        for (name, value) in &layer.attributes.other {
            let utf8 = |text: &Text| String::from_utf8_lossy(text.as_slice()).into_owned();
            let name = utf8(name);
            let Some(name) = name.strip_prefix(ATTRIBUTE_PREFIX).map(str::to_owned) else { continue };
            let text = match value {
                AttributeValue::Text(text) => utf8(text),
                AttributeValue::F32(number) => number.to_string(),
                AttributeValue::F64(number) => number.to_string(),
                AttributeValue::I32(number) => number.to_string(),
                _ => continue,
            };
            provenance.insert(name, text);
        }
        // The order of a hash map is not kept between runs.
        provenance.sort_keys();
        Ok(Self { provenance, ..layer.channel_data.pixels })
    }
}

/// Mean of the pixels of several pictures, summed in f64.
fn mean_pixels<const N: usize>(pictures: &[&[[f32; N]]]) -> Vec<[f32; N]> {
    let mean = |index: usize, channel: usize| {
        let sum: f64 = pictures.iter().map(|pixels| f64::from(pixels[index][channel])).sum();
        (sum / pictures.len() as f64) as f32
    };
    let count = pictures.first().map_or(0, |pixels| pixels.len());
    (0..count).map(|index| std::array::from_fn(|channel| mean(index, channel))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Image {
        let mut image = Image::new(3, 2);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = std::array::from_fn(|channel| (index * 4 + channel) as f32 / 7.0);
        }
        image.provenance.insert("scene".into(), "test".into());
        image
    }

    #[test]
    fn an_exr_keeps_every_bit_and_the_provenance() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        let image = picture();
        image.write_exr(&path, false).expect("it is written");
        assert_eq!(Image::read_exr(&path).expect("it is read"), image);
    }

    #[test]
    fn what_a_background_would_show_through_is_kept_beside_alpha() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        let mut image = picture();
        image.transmittance = Some((0..6).map(|index| [0.1, 0.2, 0.3].map(|part| part * index as f32)).collect());
        image.write_exr(&path, false).expect("it is written");
        assert_eq!(Image::read_exr(&path).expect("it is read"), image);
        // A reader that knows nothing of the layer finds the same four channels.
        let plain = exr::prelude::read_first_rgba_layer_from_file(
            &path,
            |size, _| vec![[0.0; 4]; size.area()],
            |pixels: &mut Vec<[f32; 4]>, at, (r, g, b, a): (f32, f32, f32, f32)| {
                pixels[at.y() * 3 + at.x()] = [r, g, b, a]
            },
        );
        assert_eq!(plain.expect("it is read").layer_data.channel_data.pixels, image.pixels);
        let mut other = image.clone();
        other.transmittance.as_mut().expect("it is there")[1] = [0.3, 0.6, 0.9];
        let mean = Image::mean_of(&[image.clone(), other]).expect("of one size");
        assert_eq!(mean.transmittance.expect("both have it")[1], [0.2, 0.4, 0.6]);
        assert_eq!(Image::mean_of(&[image, picture()]).expect("of one size").transmittance, None);
    }

    #[test]
    fn a_picture_with_nan_is_refused_with_count_and_place() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        let mut image = picture();
        image.pixels[4][1] = f32::NAN;
        let error = image.write_exr(&path, false).expect_err("NaN is refused");
        assert!(error.found.contains("1 pixels") && error.found.contains("column 1, row 1"), "{error}");
        assert!(!path.exists());
        image.write_exr(&path, true).expect("the flag allows it");
        assert!(Image::read_exr(&path).expect("it is read").pixels[4][1].is_nan());
    }
}
