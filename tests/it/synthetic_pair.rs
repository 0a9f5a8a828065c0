//! A recording that converges: two synthetic cameras that look nearly the same way, recorded once by `pelical record`.

use std::path::Path;
use std::sync::OnceLock;

use crate::env::TestEnv;

/// Enough views for a verdict, few enough to render and solve in seconds.
const FRAME_SETS: u64 = 10;

const CONFIG: &str = "\
cameras:
  backend: synthetic
  synthetic: {rig: pair, yaw_deg: 15.0, baseline_m: 0.25, seed: 7, pace: unpaced, rate_hz: 2.0, view_step: 1.0}
";

/// The folder of the recording; it lives as long as the tests.
pub fn recording() -> &'static Path {
    static RECORDING: OnceLock<(TestEnv, std::path::PathBuf)> = OnceLock::new();
    let (_, folder) = RECORDING.get_or_init(|| {
        let env = TestEnv::new();
        env.config(CONFIG);
        let sets = FRAME_SETS.to_string();
        let recorded =
            env.pelical(&["record", "pair", "--config", "pelicald.yaml", "--sets", &sets, "--json"]);
        assert_eq!(recorded.expect_code(0).json()["frame_sets"], FRAME_SETS);
        let folder = env.path("pair");
        (env, folder)
    });
    folder
}
