//! A recording that converges: two synthetic cameras that look nearly the same way, recorded once by `pelical record`.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::env::TestEnv;

/// Enough views for a verdict, few enough to render and solve in seconds.
const FRAME_SETS: u64 = 10;

/// What the moved camera does: 20 mm to its right and 3 degrees to the right.
pub const MOVED_BY: (f64, f64) = (20.0, 3.0);

fn config(moves: &str) -> String {
    format!(
        "cameras:\n  backend: synthetic\n  synthetic: {{rig: pair, yaw_deg: 15.0, baseline_m: 0.25, seed: 7, pace: unpaced, \
         rate_hz: 2.0, view_step: 1.0, moves: [{moves}]}}\n"
    )
}

/// The folder of the recording; it lives as long as the tests.
pub fn recording() -> &'static Path {
    static RECORDING: OnceLock<(TestEnv, PathBuf)> = OnceLock::new();
    &RECORDING.get_or_init(|| record("")).1
}

/// The same path of the rig, with the right camera moved from the start.
pub fn recording_after_a_move() -> &'static Path {
    static RECORDING: OnceLock<(TestEnv, PathBuf)> = OnceLock::new();
    let (mm, deg) = MOVED_BY;
    let moved = format!(
        "{{serial: synthetic-02, at_frame: 0, by_mm: [{mm:.1}, 0.0, 0.0], turn_deg: [0.0, {deg:.1}, 0.0]}}"
    );
    &RECORDING.get_or_init(|| record(&moved)).1
}

fn record(moves: &str) -> (TestEnv, PathBuf) {
    let env = TestEnv::new();
    env.config(&config(moves));
    let sets = FRAME_SETS.to_string();
    let recorded = env.pelical(&["record", "pair", "--config", "pelicald.yaml", "--sets", &sets, "--json"]);
    assert_eq!(recorded.expect_code(0).json()["frame_sets"], FRAME_SETS);
    let folder = env.path("pair");
    (env, folder)
}
