//! Numbers on a regular grid that programs read: the one kind of texture, with the smallest and largest values of its blocks.
//!
//! A texel's value stands *at* its index; between texels a reader interpolates ([`crate::nodes::texture_lookup`] is the one read, and
//! `shaders/nodes/shared/texture.wgsl` its twin). Textures are filtered in the shader, since the filter of graphics hardware has
//! weights of 8 bits.

use crate::base::arrays::{Mapped, each};
use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files::sha256;
use half::f16;
use std::sync::{Arc, OnceLock};

choice! {
    "lowercase",
    /// How texels are stored.
    pub enum TexelFormat {
        /// 32 bits, as they are.
        F32,
        /// IEEE 754 binary16: relative error up to 2^-11, values up to 65504.
        F16,
        /// 8 bits between the smallest and the largest value: error up to 1/510 of that range.
        Unorm8,
    }
}

choice! {
    "lowercase",
    /// How a texture is read between its texels.
    pub enum TextureFilter {
        /// The value of the nearest texel.
        Nearest,
        /// Linear along each axis, x first.
        Trilinear,
    }
}

/// What lies outside of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outside {
    /// Its nearest texel.
    Clamp,
    /// The texture again.
    Repeat,
    /// 0, to which the outermost texel falls along one more.
    Zero,
}

/// Texels as they are stored, x fastest.
#[derive(Debug, Clone, PartialEq)]
pub enum Texels {
    /// The values.
    F32(Vec<f32>),
    /// Bits of binary16.
    F16(Vec<u16>),
    /// Parts of 255 of a range above its low end.
    Unorm8 {
        /// A byte per texel, which whoever made them may keep, too.
        bytes: Arc<[u8]>,
        /// The values that 0 and 255 stand for.
        range: [f32; 2],
    },
}

/// A grid of numbers.
#[derive(Debug)]
pub struct Texture {
    size: [usize; 3],
    texels: Texels,
    /// What each byte stands for, where texels are bytes.
    decoded: Option<Box<[f32; 256]>>,
    filter: TextureFilter,
    outside: Outside,
    identity: OnceLock<String>,
    pyramid: OnceLock<Vec<Level>>,
}

/// Smallest and largest values of blocks of 2^(l+1) texels per axis, x fastest.
#[derive(Debug)]
struct Level {
    size: [usize; 3],
    ranges: Ranges,
}

/// Ranges of blocks.
#[derive(Debug)]
enum Ranges {
    /// Of values.
    Floats(Vec<[f32; 2]>),
    /// Of bytes: what they stand for grows with them.
    Bytes(Vec<[u8; 2]>),
}

/// Blocks per axis that a question for a range looks at, at most.
const BLOCKS: i64 = 4;

impl Texture {
    /// A texture of texels that are stored already; x runs fastest.
    ///
    /// # Panics
    /// Where the number of texels is not the product of the size, or a side is 0.
    pub fn new(size: [usize; 3], texels: Texels, filter: TextureFilter, outside: Outside) -> Self {
        assert!(size.iter().all(|&side| side > 0) && size.iter().product::<usize>() == texels.len());
        let decoded = match &texels {
            Texels::Unorm8 { range: [low, high], .. } => {
                Some(Box::new(each(|byte| low + (high - low) * (byte as f32 / 255.0))))
            }
            _ => None,
        };
        Self { size, texels, decoded, filter, outside, identity: OnceLock::new(), pyramid: OnceLock::new() }
    }

    /// A texture of values, stored in a format; values that it cannot hold are refused. `place` says what is stored.
    pub fn store(
        size: [usize; 3],
        values: Vec<f32>,
        format: TexelFormat,
        filter: TextureFilter,
        outside: Outside,
        place: &str,
    ) -> Result<Self> {
        let low = values.iter().copied().fold(f32::INFINITY, f32::min);
        let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let most = match format {
            TexelFormat::F32 => f32::INFINITY,
            TexelFormat::F16 => f16::MAX.to_f32(),
            TexelFormat::Unorm8 => f32::MAX,
        };
        // f32 and f16 carry NaN into the picture, where it is seen; 8 bits have none.
        let nan = format == TexelFormat::Unorm8 && values.iter().any(|value| value.is_nan());
        if nan || high > most {
            return Err(Error::new(
                format!("{place}, format {}", format.name()),
                if nan { "NaN at a vertex".to_owned() } else { format!("a value of {high:e}") },
                format!("numbers up to {most:e}"),
                "Store 32 bits, or correct the density (cloudparity eval shows it).",
            )
            .with_setting("cache_format"));
        }
        let parts = (high - low).max(0.0);
        let texels = match format {
            TexelFormat::F32 => Texels::F32(values),
            TexelFormat::F16 => Texels::F16(values.iter().map(|&value| f16::from_f32(value).to_bits()).collect()),
            TexelFormat::Unorm8 => Texels::Unorm8 {
                bytes: values
                    .iter()
                    .map(|&value| if parts > 0.0 { ((value - low) / parts * 255.0).round() as u8 } else { 0 })
                    .collect(),
                range: [low, high],
            },
        };
        Ok(Self::new(size, texels, filter, outside))
    }

    /// The same texture under an identity that is known already, such as the hash of a file.
    pub fn with_identity(self, identity: String) -> Self {
        Self { identity: OnceLock::from(identity), ..self }
    }

    /// Texels along x, y and z.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// The stored texels.
    pub fn texels(&self) -> &Texels {
        &self.texels
    }

    /// How it is read between texels.
    pub fn filter(&self) -> TextureFilter {
        self.filter
    }

    /// What lies outside.
    pub fn outside(&self) -> Outside {
        self.outside
    }

    /// What tells it from another: a hash of all that it is, unless one was given.
    pub fn identity(&self) -> &str {
        self.identity.get_or_init(|| {
            let head = format!("{:?} {:?} {:?} {:?} ", self.size, self.filter, self.outside, self.texels.format());
            sha256(&[head.as_bytes(), &self.texels.words()].concat())
        })
    }

    /// The texel at an index that is inside.
    #[inline(always)]
    pub fn texel(&self, [x, y, z]: [usize; 3]) -> f32 {
        let index = (z * self.size[1] + y) * self.size[0] + x;
        match &self.texels {
            Texels::F32(values) => values[index],
            Texels::F16(values) => f16::from_bits(values[index]).to_f32(),
            Texels::Unorm8 { bytes, .. } => self.decode(bytes[index]),
        }
    }

    /// What a byte stands for; of textures of bytes alone.
    #[inline(always)]
    fn decode(&self, byte: u8) -> f32 {
        self.decoded.as_ref().map_or(0.0, |decoded| decoded[usize::from(byte)])
    }

    /// The eight texels from an index to the next along each axis, x fastest, by what lies outside.
    #[inline(always)]
    pub fn corners(&self, low: [i32; 3]) -> [f32; 8] {
        if (0..3).any(|axis| low[axis] < 0 || low[axis] as usize + 1 >= self.size[axis]) {
            return if self.outside == Outside::Zero { self.corners_at_the_rim(low) } else { self.corners_around(low) };
        }
        let [x, y, z] = low.mapped(|index| index as usize);
        let row = self.size[0];
        let first = (z * self.size[1] + y) * row + x;
        let layer = row * self.size[1];
        let rows = [first, first + row, first + layer, first + layer + row];
        // The format is looked at once, and a row's two texels lie side by side.
        match &self.texels {
            Texels::F32(values) => pairs(values, rows, |value| value),
            Texels::F16(values) => pairs(values, rows, |bits| f16::from_bits(bits).to_f32()),
            Texels::Unorm8 { bytes, .. } => pairs(bytes, rows, |byte| self.decode(byte)),
        }
    }

    /// The eight texels where every index has one: flat textures, which are at their rim everywhere, come here.
    fn corners_around(&self, low: [i32; 3]) -> [f32; 8] {
        let x = self.ends(0, low[0]);
        let y = self.ends(1, low[1]).mapped(|index| index * self.size[0]);
        let z = self.ends(2, low[2]).mapped(|index| index * self.size[0] * self.size[1]);
        let rows = [z[0] + y[0], z[0] + y[1], z[1] + y[0], z[1] + y[1]];
        match &self.texels {
            Texels::F32(values) => of_rows(values, rows, x, |value| value),
            Texels::F16(values) => of_rows(values, rows, x, |bits| f16::from_bits(bits).to_f32()),
            Texels::Unorm8 { bytes, .. } => of_rows(bytes, rows, x, |byte| self.decode(byte)),
        }
    }

    /// What [`Self::inside`] gives for an index and the next, of a texture that is nowhere 0 outside, with one division at most.
    #[inline(always)]
    fn ends(&self, axis: usize, low: i32) -> [usize; 2] {
        let last = self.size[axis] as i32 - 1;
        let next = low.saturating_add(1);
        let inside = match self.outside {
            Outside::Repeat => {
                let first = if (0..=last).contains(&low) { low } else { low.rem_euclid(last + 1) };
                let second = if first == last { 0 } else { first + 1 };
                [first, if next == low { first } else { second }]
            }
            Outside::Clamp | Outside::Zero => [low.clamp(0, last), next.clamp(0, last)],
        };
        inside.mapped(|index| index as usize)
    }

    /// Not inlined: few reads come here.
    #[inline(never)]
    fn corners_at_the_rim(&self, low: [i32; 3]) -> [f32; 8] {
        let ends: [[Option<usize>; 2]; 3] =
            each(|axis| [low[axis], low[axis].saturating_add(1)].mapped(|index| self.inside(axis, index)));
        each(|corner| self.value(each(|axis| ends[axis][corner >> axis & 1])))
    }

    /// Where an index lies along an axis, by what lies outside; none where that is 0.
    #[inline(always)]
    pub fn inside(&self, axis: usize, index: i32) -> Option<usize> {
        let side = self.size[axis] as i32;
        if (0..side).contains(&index) {
            return Some(index as usize);
        }
        match self.outside {
            Outside::Clamp => Some(index.clamp(0, side - 1) as usize),
            // What reads come to next to the last texel, without a division.
            Outside::Repeat if index == side => Some(0),
            Outside::Repeat => Some(index.rem_euclid(side) as usize),
            Outside::Zero => None,
        }
    }

    /// The texel at what [`Self::inside`] gave along x, y and z.
    #[inline(always)]
    pub fn value(&self, inside: [Option<usize>; 3]) -> f32 {
        match inside {
            [Some(x), Some(y), Some(z)] => self.texel([x, y, z]),
            _ => 0.0,
        }
    }

    /// Enclosure of the values from one index to another, both included: exact for few texels, else that of the blocks they lie in.
    pub fn range(&self, first: [i64; 3], last: [i64; 3]) -> [f32; 2] {
        let mut found: Option<[f32; 2]> = None;
        let mut add = |range: [f32; 2]| found = Some(found.map_or(range, |found| hull(found, range)));
        // Along each axis the parts of the texture that are asked for.
        let mut parts: [Vec<[i64; 2]>; 3] = Default::default();
        for axis in 0..3 {
            let side = self.size[axis] as i64;
            let (first, last) = (first[axis], last[axis].max(first[axis]));
            parts[axis] = match self.outside {
                Outside::Clamp => vec![[first.clamp(0, side - 1), last.clamp(0, side - 1)]],
                Outside::Repeat if last - first >= side - 1 => vec![[0, side - 1]],
                Outside::Repeat => {
                    let (first, last) = (first.rem_euclid(side), last.rem_euclid(side));
                    if first <= last { vec![[first, last]] } else { vec![[first, side - 1], [0, last]] }
                }
                Outside::Zero => {
                    if first < 0 || last >= side {
                        add([0.0; 2]);
                    }
                    let (first, last) = (first.max(0), last.min(side - 1));
                    if first <= last { vec![[first, last]] } else { Vec::new() }
                }
            };
        }
        for x in &parts[0] {
            for y in &parts[1] {
                for z in &parts[2] {
                    add(self.range_inside([x[0], y[0], z[0]], [x[1], y[1], z[1]]));
                }
            }
        }
        found.unwrap_or([0.0; 2])
    }

    fn range_inside(&self, first: [i64; 3], last: [i64; 3]) -> [f32; 2] {
        let levels = self.pyramid.get_or_init(|| self.levels());
        let widest = (0..3).map(|axis| last[axis] - first[axis] + 1).max().unwrap_or(1);
        let mut level = 0;
        while widest >> level > BLOCKS && level < levels.len() {
            level += 1;
        }
        let mut found: Option<[f32; 2]> = None;
        let (begin, end) = (first.mapped(|index| index >> level), last.mapped(|index| index >> level));
        for z in begin[2]..=end[2] {
            for y in begin[1]..=end[1] {
                for x in begin[0]..=end[0] {
                    let place = [x as usize, y as usize, z as usize];
                    let range = match level.checked_sub(1) {
                        None => [self.texel(place); 2],
                        Some(coarse) => self.block(&levels[coarse], place),
                    };
                    found = Some(found.map_or(range, |found| hull(found, range)));
                }
            }
        }
        found.unwrap_or([0.0; 2])
    }

    fn levels(&self) -> Vec<Level> {
        let mut levels: Vec<Level> = Vec::new();
        let mut finer = self.size;
        while finer.iter().any(|&side| side > 1) {
            let ranges = match (&self.texels, levels.last().map(|level| &level.ranges)) {
                (Texels::Unorm8 { bytes, .. }, None) => {
                    Ranges::Bytes(blocks(finer, |index| [bytes[index]; 2], byte_hull))
                }
                (_, Some(Ranges::Bytes(finer_ranges))) => {
                    Ranges::Bytes(blocks(finer, |index| finer_ranges[index], byte_hull))
                }
                (_, Some(Ranges::Floats(finer_ranges))) => {
                    Ranges::Floats(blocks(finer, |index| finer_ranges[index], hull))
                }
                (Texels::F32(values), None) => Ranges::Floats(blocks(finer, |index| [values[index]; 2], hull)),
                (Texels::F16(values), None) => {
                    Ranges::Floats(blocks(finer, |index| [f16::from_bits(values[index]).to_f32(); 2], hull))
                }
            };
            finer = finer.mapped(|side| side.div_ceil(2));
            levels.push(Level { size: finer, ranges });
        }
        levels
    }

    /// The range of a block of a level.
    fn block(&self, level: &Level, [x, y, z]: [usize; 3]) -> [f32; 2] {
        let index = (z * level.size[1] + y) * level.size[0] + x;
        match &level.ranges {
            Ranges::Floats(ranges) => ranges[index],
            Ranges::Bytes(ranges) => ranges[index].mapped(|byte| self.decode(byte)),
        }
    }
}

/// The two texels that begin at each of four places.
#[inline(always)]
fn pairs<T: Copy>(texels: &[T], rows: [usize; 4], value: impl Fn(T) -> f32) -> [f32; 8] {
    // Four calls, since a map over an array is not inlined here.
    let pair = |first: usize| {
        let pair = &texels[first..first + 2];
        [value(pair[0]), value(pair[1])]
    };
    let [a, b, c, d] = [pair(rows[0]), pair(rows[1]), pair(rows[2]), pair(rows[3])];
    [a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]]
}

/// The same where a row's two texels, at `x` in it, need not lie side by side.
#[inline(always)]
fn of_rows<T: Copy>(texels: &[T], rows: [usize; 4], x: [usize; 2], value: impl Fn(T) -> f32) -> [f32; 8] {
    let at = |row: usize, end: usize| value(texels[rows[row] + x[end]]);
    [at(0, 0), at(0, 1), at(1, 0), at(1, 1), at(2, 0), at(2, 1), at(3, 0), at(3, 1)]
}

/// Hulls of blocks of two per axis, of `size` ranges that stand at their indices.
fn blocks<T: Copy>(size: [usize; 3], range: impl Fn(usize) -> T, hull: impl Fn(T, T) -> T) -> Vec<T> {
    let coarse = size.mapped(|side| side.div_ceil(2));
    let mut found = Vec::with_capacity(coarse.iter().product());
    for z in 0..coarse[2] {
        for y in 0..coarse[1] {
            // Rows of the finer ranges that a row of blocks holds; the last ones stand twice where a side is odd.
            let rows: [usize; 4] = each(|number| {
                let y = (2 * y + (number & 1)).min(size[1] - 1);
                let z = (2 * z + (number >> 1)).min(size[2] - 1);
                (z * size[1] + y) * size[0]
            });
            found.extend((0..coarse[0]).map(|x| {
                let columns = [2 * x, (2 * x + 1).min(size[0] - 1)];
                let of_row = |row: usize| hull(range(row + columns[0]), range(row + columns[1]));
                hull(hull(of_row(rows[0]), of_row(rows[1])), hull(of_row(rows[2]), of_row(rows[3])))
            }));
        }
    }
    found
}

fn byte_hull(a: [u8; 2], b: [u8; 2]) -> [u8; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// NaN in one of them stays in the hull, as the whole line.
fn hull(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    if a[0].is_nan() || b[0].is_nan() {
        return [f32::NAN; 2];
    }
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Texels {
    fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F16(values) => values.len(),
            Self::Unorm8 { bytes, .. } => bytes.len(),
        }
    }

    /// How they are stored.
    pub fn format(&self) -> TexelFormat {
        match self {
            Self::F32(_) => TexelFormat::F32,
            Self::F16(_) => TexelFormat::F16,
            Self::Unorm8 { .. } => TexelFormat::Unorm8,
        }
    }

    /// The values that the ends of the stored numbers stand for; 0 and 1 where they stand for themselves.
    pub fn stored_range(&self) -> [f32; 2] {
        match self {
            Self::Unorm8 { range, .. } => *range,
            _ => [0.0, 1.0],
        }
    }

    /// Words of 32 bits that they fill.
    pub fn word_count(&self) -> usize {
        (self.len() * self.format().bytes()).div_ceil(4)
    }

    /// As kernels read them: two or four to a word from its low end, filled up to whole words.
    pub fn words(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = match self {
            Self::F32(values) => bytemuck::cast_slice(values).to_vec(),
            Self::F16(values) => bytemuck::cast_slice(values).to_vec(),
            Self::Unorm8 { bytes, .. } => bytes.to_vec(),
        };
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    }
}

/// Words of textures one behind the other, as programs read them.
pub fn words_of(textures: &[TextureHandle]) -> Vec<u8> {
    textures.iter().flat_map(|texture| texture.texels().words()).collect()
}

impl TexelFormat {
    /// The name in settings.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Bytes of a texel.
    pub fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
            Self::Unorm8 => 1,
        }
    }
}

impl TextureFilter {
    /// The name in settings.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A texture that several programs share.
#[derive(Clone)]
pub struct TextureHandle(Arc<Texture>);

impl TextureHandle {
    /// Shares a texture.
    pub fn new(texture: Texture) -> Self {
        Self(Arc::new(texture))
    }
}

impl std::ops::Deref for TextureHandle {
    type Target = Texture;

    fn deref(&self) -> &Texture {
        &self.0
    }
}

impl PartialEq for TextureHandle {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.identity() == other.identity()
    }
}

impl std::fmt::Debug for TextureHandle {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "texture {}", self.identity())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(outside: Outside) -> Texture {
        let size = [5, 3, 7];
        let values = (0..105).map(|number| ((number * 37) % 101) as f32 - 50.0).collect();
        Texture::new(size, Texels::F32(values), TextureFilter::Trilinear, outside)
    }

    #[test]
    fn corners_are_the_texels_inside() {
        let sizes = [[5, 3, 7], [6, 4, 1], [1, 1, 1], [1, 8, 2]];
        let lows = [i32::MIN, i32::MIN + 1, -9, -8, -5, -2, -1, 0, 1, 2, 3, 4, 5, 6, 7, 8, 40, i32::MAX - 1, i32::MAX];
        for size in sizes {
            let count: usize = size.iter().product();
            let numbers: Vec<f32> = (0..count).map(|number| 1.0 + (number * 37 % 251) as f32).collect();
            let halves = numbers.iter().map(|value| f16::from_f32(*value).to_bits()).collect();
            let bytes = numbers.iter().map(|value| *value as u8).collect();
            for texels in
                [Texels::F32(numbers.clone()), Texels::F16(halves), Texels::Unorm8 { bytes, range: [0.0, 255.0] }]
            {
                for outside in [Outside::Clamp, Outside::Repeat, Outside::Zero] {
                    let texture = Texture::new(size, texels.clone(), TextureFilter::Trilinear, outside);
                    for low in lows.iter().flat_map(|x| lows.iter().map(move |y| [*x, *y])) {
                        let low = [low[0], low[1], low[0].wrapping_add(low[1])];
                        let expected: [f32; 8] = std::array::from_fn(|corner| {
                            texture.value(std::array::from_fn(|axis| {
                                texture.inside(axis, low[axis].saturating_add((corner >> axis & 1) as i32))
                            }))
                        });
                        assert_eq!(texture.corners(low), expected, "{size:?} {outside:?} {low:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn ranges_hold_every_value_and_are_exact_for_few() {
        for outside in [Outside::Clamp, Outside::Repeat, Outside::Zero] {
            let texture = texture(outside);
            for number in 0..4000_i64 {
                let at = |step: i64, spread: i64| (number * step / 7) % spread - spread / 2;
                let first = [at(3, 17), at(5, 13), at(11, 19)];
                let last = [first[0] + at(13, 9).abs(), first[1] + at(17, 5).abs(), first[2] + at(19, 11).abs()];
                let range = texture.range(first, last);
                let mut exact = [f32::INFINITY, f32::NEG_INFINITY];
                for x in first[0]..=last[0] {
                    for y in first[1]..=last[1] {
                        for z in first[2]..=last[2] {
                            let at = [x, y, z];
                            let value =
                                texture.value(std::array::from_fn(|axis| texture.inside(axis, at[axis] as i32)));
                            exact = [exact[0].min(value), exact[1].max(value)];
                        }
                    }
                }
                assert!(
                    range[0] <= exact[0] && range[1] >= exact[1],
                    "{outside:?} {first:?} {last:?}: {range:?} {exact:?}"
                );
                if (0..3).all(|axis| last[axis] - first[axis] < 4) {
                    assert_eq!(range, exact, "{outside:?} {first:?} {last:?}");
                }
            }
        }
    }

    #[test]
    fn corners_are_the_texels_at_their_indices() {
        for outside in [Outside::Clamp, Outside::Repeat, Outside::Zero] {
            let texture = texture(outside);
            for number in 0..2000_i32 {
                let at = |step: i32, spread: i32| (number * step / 7) % spread - spread / 2;
                let mut low = [at(3, 29), at(5, 23), at(11, 31)];
                if number % 100 == 0 {
                    low[number as usize / 100 % 3] = if number % 200 == 0 { i32::MAX } else { i32::MIN };
                }
                assert_eq!(texture.corners(low), texture.corners_at_the_rim(low), "{outside:?} {low:?}");
            }
        }
    }

    #[test]
    fn equal_textures_are_equal_and_others_are_not() {
        let [one, same] = [0, 1].map(|_| TextureHandle::new(texture(Outside::Zero)));
        assert_eq!(one, same);
        assert_ne!(one, TextureHandle::new(texture(Outside::Clamp)));
    }

    #[test]
    fn formats_hold_what_they_say() {
        let store = |values: &[f32], format| {
            Texture::store(
                [values.len(), 1, 1],
                values.to_vec(),
                format,
                TextureFilter::Nearest,
                Outside::Clamp,
                "a test",
            )
        };
        let values = [0.5, -3.0, 17.25, 1000.0];
        for (format, error) in
            [(TexelFormat::F32, 0.0), (TexelFormat::F16, 0.25), (TexelFormat::Unorm8, 1003.0 / 510.0)]
        {
            let texture = store(&values, format).expect("ordinary values");
            for (index, value) in values.iter().enumerate() {
                let found = texture.texel([index, 0, 0]);
                // The last bits of the product and sum that decode a byte.
                assert!((found - value).abs() <= error * (1.0 + 1e-5), "{format:?} {value} {found}");
            }
        }
        assert!(store(&[1e6], TexelFormat::F16).expect_err("too large").to_string().contains("f16"));
        assert!(store(&[f32::NAN], TexelFormat::Unorm8).expect_err("no NaN").to_string().contains("NaN"));
    }
}
