//! KTX2 files of textures of one channel (Khronos Texture specification 2.0), uncompressed, with all levels that are given.
//!
//! Written here as no library at hand writes them; `ktx2`, which reads them, is what the tests read them with.

/// How a texel is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// IEEE 754 binary16.
    Float16,
    /// 8 bits that stand for 0 to 1.
    Unorm8,
}

impl Channel {
    /// Bytes of a texel.
    pub fn bytes(self) -> usize {
        match self {
            Self::Float16 => 2,
            Self::Unorm8 => 1,
        }
    }

    /// The number of `VkFormat`.
    fn vulkan(self) -> u32 {
        match self {
            Self::Float16 => 76,
            Self::Unorm8 => 9,
        }
    }

    /// The one sample of the data format descriptor: bits, qualifiers, the numbers that stand for the ends of the range.
    fn sample(self) -> [u32; 4] {
        const SIGNED_FLOAT: u32 = 0xC0;
        match self {
            Self::Float16 => [15 << 16 | SIGNED_FLOAT << 24, 0, (-1.0_f32).to_bits(), 1.0_f32.to_bits()],
            Self::Unorm8 => [7 << 16, 0, 0, 255],
        }
    }
}

/// Texels along x, y and z of a level: each is half of the one before, rounded down, 1 at least.
pub fn level_size(size: [usize; 3], level: usize) -> [usize; 3] {
    size.map(|side| (side >> level).max(1))
}

/// A file of a texture with three dimensions. Levels begin with the largest, x runs fastest.
///
/// # Panics
/// Where a level has not the bytes of its size: a mistake of the caller.
pub fn write(size: [usize; 3], channel: Channel, levels: &[Vec<u8>], writer: &str) -> Vec<u8> {
    const HEAD: usize = 80;
    const OF_LEVEL: usize = 24;
    const KEY: &[u8] = b"KTXwriter\0";
    for (level, bytes) in levels.iter().enumerate() {
        assert_eq!(bytes.len(), channel.bytes() * level_size(size, level).iter().product::<usize>());
    }
    let descriptor: Vec<u32> = [
        vec![44, 0, 2 | 40 << 16],
        // Colour model RGBSDA, no primaries, linear.
        vec![1 | 1 << 16, 0, channel.bytes() as u32, 0],
        channel.sample().to_vec(),
    ]
    .concat();
    let mut value = [KEY, writer.as_bytes(), b"\0"].concat();
    let value_length = value.len() as u32;
    value.resize(value.len().next_multiple_of(4), 0);
    let descriptor_at = HEAD + OF_LEVEL * levels.len();
    let value_at = descriptor_at + 4 * descriptor.len();
    let value_bytes = 4 + value.len();
    // Levels lie from the smallest to the largest.
    let alignment = channel.bytes().max(4);
    let mut data: Vec<u8> = Vec::new();
    let data_at = (value_at + value_bytes).next_multiple_of(alignment);
    let mut places = vec![[0_u64; 2]; levels.len()];
    for (level, bytes) in levels.iter().enumerate().rev() {
        data.resize(data.len().next_multiple_of(alignment), 0);
        places[level] = [(data_at + data.len()) as u64, bytes.len() as u64];
        data.extend_from_slice(bytes);
    }
    let mut file = vec![0xAB, 0x4B, 0x54, 0x58, 0x20, 0x32, 0x30, 0xBB, 0x0D, 0x0A, 0x1A, 0x0A];
    let words = |words: &[u32], file: &mut Vec<u8>| words.iter().for_each(|word| file.extend(word.to_le_bytes()));
    let [x, y, z] = size.map(|side| side as u32);
    words(&[channel.vulkan(), channel.bytes() as u32, x, y, z, 0, 1, levels.len() as u32, 0], &mut file);
    words(&[descriptor_at as u32, 4 * descriptor.len() as u32, value_at as u32, value_bytes as u32], &mut file);
    words(&[0; 4], &mut file);
    for [at, length] in places {
        [at, length, length].iter().for_each(|number| file.extend(number.to_le_bytes()));
    }
    words(&descriptor, &mut file);
    words(&[value_length], &mut file);
    file.extend(value);
    file.resize(data_at, 0);
    file.extend(data);
    file
}
