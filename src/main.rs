//! The program: reads the command line, calls the library, prints.

use std::process::ExitCode;

fn main() -> ExitCode {
    quiet_device_selection();
    cloudparity::cli::run()
}

/// Mesa's device-selection layer looks for a display and complains on stderr where there is none.
/// The program chooses its adapter by itself, so the layer is switched off.
#[allow(unsafe_code, reason = "setting a variable is unsafe only beside other threads, and there is none yet")]
fn quiet_device_selection() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: this is the first thing that the program does; no other thread exists.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
