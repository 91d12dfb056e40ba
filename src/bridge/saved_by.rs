//! Which release of Blender saved a .blend, from its first bytes and before Blender starts.
//!
//! A file begins with `BLENDER`. Up to 4.5 the size of a pointer (`_` or `-`), the order of bytes (`v` or `V`) and three digits
//! of the release follow (`BLENDER-v402`); since 5.0 the length of the header, a version of the format and four digits
//! (`BLENDER17-01v0503`). Compressed files hold the same: with Zstandard since 3.0, with gzip before.

use std::fmt;
use std::io::{Cursor, Read};
use std::path::Path;

/// A line of releases, as 5.3.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Line {
    /// The first number.
    pub major: u32,
    /// The second number.
    pub minor: u32,
}

impl Line {
    /// A line by its two numbers.
    pub const fn new(major: u32, minor: u32) -> Self {
        Self { major, minor }
    }

    /// That of a release or a line in digits, as 5.3.0, 5.3 or "5.2.3 LTS"; none where the text is something else.
    pub fn of(release: &str) -> Option<Self> {
        let mut numbers = release.split_whitespace().next()?.split('.').map(|part| part.parse().ok());
        Some(Self { major: numbers.next()??, minor: numbers.next()?? })
    }
}

impl fmt::Display for Line {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}.{}", self.major, self.minor)
    }
}

/// Bytes of the longest header.
const LONGEST: usize = 17;

/// The line of releases that saved a file; none where its first bytes are no header of a .blend, which Blender explains.
pub fn saved_by(path: &Path) -> Option<Line> {
    let mut start = Vec::new();
    let mut file = std::fs::File::open(path).ok()?;
    file.by_ref().take(4).read_to_end(&mut start).ok()?;
    let whole = Cursor::new(start.clone()).chain(file);
    let mut header = Vec::new();
    match start.as_slice() {
        [0x28, 0xB5, 0x2F, 0xFD] => {
            let frame = ruzstd::decoding::StreamingDecoder::new(whole).ok()?;
            frame.take(LONGEST as u64).read_to_end(&mut header).ok()?;
        }
        [0x1F, 0x8B, ..] => {
            flate2::read::GzDecoder::new(whole).take(LONGEST as u64).read_to_end(&mut header).ok()?;
        }
        _ => {
            whole.take(LONGEST as u64).read_to_end(&mut header).ok()?;
        }
    }
    line_of(&header)
}

/// The line of releases that a header names.
fn line_of(header: &[u8]) -> Option<Line> {
    let rest = header.strip_prefix(b"BLENDER")?;
    let digits = match rest {
        [b'_' | b'-', b'v' | b'V', digits @ ..] => digits.get(..3)?,
        [b'0'..=b'9', b'0'..=b'9', b'-', b'0'..=b'9', b'0'..=b'9', b'v', digits @ ..] => digits.get(..4)?,
        _ => return None,
    };
    let number: u32 =
        std::str::from_utf8(digits).ok().filter(|text| text.bytes().all(|byte| byte.is_ascii_digit()))?.parse().ok()?;
    Some(Line::new(number / 100, number % 100))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn every_form_of_the_header_is_read() {
        for (header, expected) in [
            ("BLENDER-v402REND", Some(Line::new(4, 2))),
            ("BLENDER_V276", Some(Line::new(2, 76))),
            ("BLENDER-v293", Some(Line::new(2, 93))),
            ("BLENDER17-01v0500REND", Some(Line::new(5, 0))),
            ("BLENDER17-01v0503", Some(Line::new(5, 3))),
            ("BLENDER17-01v1001", Some(Line::new(10, 1))),
            ("BLENDER-v4", None),
            ("BLENDER-v4x2", None),
            ("BLENDER", None),
            ("BLENDER17-01v05", None),
            ("{\"format\": 1}", None),
            ("", None),
        ] {
            assert_eq!(line_of(header.as_bytes()), expected, "{header}");
        }
    }

    #[test]
    fn compressed_files_are_read_as_plain_ones() {
        let folder = tempfile::tempdir().expect("a folder");
        let content = [b"BLENDER-v283REND".as_slice(), &[7; 40_000]].concat();
        let zipped = |bytes: &[u8]| {
            let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(bytes).expect("memory");
            encoder.finish().expect("memory")
        };
        let packed = ruzstd::encoding::compress_to_vec(
            [b"BLENDER17-01v0502".as_slice(), &[7; 400_000]].concat().as_slice(),
            ruzstd::encoding::CompressionLevel::Fastest,
        );
        let cut = |bytes: &[u8]| bytes[..9].to_vec();
        for (name, bytes, expected) in [
            ("plain", content.clone(), Some(Line::new(2, 83))),
            ("gzip", zipped(&content), Some(Line::new(2, 83))),
            ("zstd", packed.clone(), Some(Line::new(5, 2))),
            ("cut gzip", cut(&zipped(&content)), None),
            ("cut zstd", cut(&packed), None),
            ("short", b"BL".to_vec(), None),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).expect("a file");
            assert_eq!(saved_by(&path), expected, "{name}");
        }
        assert_eq!(saved_by(&folder.path().join("none")), None);
        assert_eq!(saved_by(folder.path()), None);
    }

    #[test]
    fn lines_are_told_from_releases() {
        assert_eq!(Line::of("5.2.3 LTS"), Some(Line::new(5, 2)));
        assert_eq!(Line::of("4.5"), Some(Line::new(4, 5)));
        assert_eq!(Line::of("five"), None);
        assert!(Line::new(2, 93) < Line::new(4, 2) && Line::new(5, 3) < Line::new(10, 0));
        assert_eq!(Line::new(5, 3).to_string(), "5.3");
    }
}
