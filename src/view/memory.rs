//! Refuses pictures that memory cannot hold, before anything is computed.

use crate::base::error::{Error, Result};

/// Gibibytes, for messages.
fn gibibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1_u32 << 30)
}

/// An error where a picture of `size` pixels, of which each takes so many bytes while it is made, needs more than what is
/// available. Where the system does not tell, nothing is refused.
pub(crate) fn check(size: [u32; 2], bytes_per_pixel: u64) -> Result<()> {
    match available() {
        0 => Ok(()),
        available => check_against(size, bytes_per_pixel, available),
    }
}

/// Bytes that are free; 0 where nobody tells, as in a browser.
fn available() -> u64 {
    #[cfg(feature = "tools")]
    {
        let mut system = sysinfo::System::new();
        system.refresh_memory();
        system.available_memory()
    }
    #[cfg(not(feature = "tools"))]
    0
}

fn check_against([width, height]: [u32; 2], bytes_per_pixel: u64, available: u64) -> Result<()> {
    let needed = u64::from(width) * u64::from(height) * bytes_per_pixel;
    if needed <= available {
        return Ok(());
    }
    Err(Error::new(
        "$.film.resolution",
        format!("{width} x {height} pixels, which take {:.1} GiB of memory", gibibytes(needed)),
        format!("a picture that fits into the {:.1} GiB that are free", gibibytes(available)),
        "Render at a lower resolution.",
    )
    .with_setting("resolution"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_does_not_fit_is_refused_with_what_it_needs() {
        let gibibyte = 1 << 30;
        assert!(check_against([16384, 16384], 64, 16 * gibibyte).is_ok(), "exactly full");
        let error = check_against([16384, 16384], 65, 16 * gibibyte).expect_err("more than there is");
        assert!(error.found.contains("16.2 GiB") && error.expected.contains("16.0 GiB"), "{error}");
    }

    #[test]
    fn a_small_picture_fits() {
        check([64, 64], 1).expect("this machine has 4 KiB");
    }
}
