//! Which cameras are reset, and which never.

use std::sync::atomic::Ordering;
use std::time::Duration;

use pelical::pipeline::{PipelineOptions, RecoveryOptions};

use super::fake::{self, Control, Mode};
use super::{Bench, poll, quick, quick_parts};

/// One reset and no more, after so many openings in vain.
fn one_reset(reopens_before_reset: u32) -> PipelineOptions {
    let recovery = RecoveryOptions {
        reopens_before_reset,
        reset_interval: Duration::from_secs(3600),
        ..RecoveryOptions::default()
    };
    PipelineOptions { recovery, ..quick() }
}

fn resets(control: &Control) -> u64 {
    control.resets.load(Ordering::SeqCst)
}

#[track_caller]
fn wait_for_openings(control: &Control, n_openings: u64) {
    poll("openings", || (control.openings.load(Ordering::SeqCst) >= n_openings).then_some(()));
}

#[test]
fn a_camera_that_refuses_is_never_reset_and_one_that_fails_is() {
    let (cameras, controls) = fake::rig(&["resets-refuses", "resets-fails"]);
    controls[0].set(Mode::Refuse);
    let bench = Bench::start_with(cameras, quick_parts(), &one_reset(1));
    wait_for_openings(&controls[0], 5);
    assert_eq!(resets(&controls[0]), 0);
    controls[1].set(Mode::Fail);
    poll("the only reset", || (resets(&controls[1]) == 1).then_some(()));
    controls.iter().for_each(|control| control.set(Mode::Run));
    drop(bench.pipeline.stop());
}

#[test]
fn a_camera_that_failed_and_was_then_unplugged_leaves_the_reset_to_others() {
    let (cameras, controls) = fake::rig(&["resets-away", "resets-fails-too"]);
    controls[0].set(Mode::Fail);
    let bench = Bench::start_with(cameras, quick_parts(), &one_reset(3));
    wait_for_openings(&controls[0], 3);
    controls[0].set(Mode::Unplugged);
    wait_for_openings(&controls[0], 6);
    controls[1].set(Mode::Fail);
    poll("the only reset", || (resets(&controls[1]) == 1).then_some(()));
    assert_eq!(resets(&controls[0]), 0);
    drop(bench.pipeline.stop());
}
