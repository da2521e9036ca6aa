//! `harmony.toml`.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[allow(dead_code)]
#[path = "../../crates/harmony-cli/src/config.rs"]
mod config;

/// What the module uses of the program's display.
#[allow(dead_code)]
mod display {
    pub fn hinted(message: String, _hint: Option<impl Into<String>>) -> anyhow::Error {
        anyhow::anyhow!(message)
    }
}

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(file) = config::parse(text) {
        file.settings.check().expect("what was parsed was checked");
        // As the program does with it.
        let _ = std::time::Duration::from_secs_f64(file.files.timeout_minutes * 60.0);
    }
});
