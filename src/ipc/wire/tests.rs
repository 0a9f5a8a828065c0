use std::mem::{offset_of, size_of};

use super::*;
use crate::ipc::message::CalibrationMessage;

#[test]
fn the_layouts_are_frozen() {
    assert_eq!(size_of::<CalibrationWire>(), 81_264);
    assert_eq!(offset_of!(CalibrationWire, reason), 48);
    assert_eq!(offset_of!(CalibrationWire, cameras), 560);
    assert_eq!(offset_of!(CalibrationWire, pairs), 560 + 16 * 424);
    assert_eq!(size_of::<CameraWire>(), 424);
    assert_eq!(offset_of!(CameraWire, reference_from_camera), 80);
    assert_eq!(offset_of!(CameraWire, covariance), 136);
    assert_eq!(size_of::<PairWire>(), 616);
    assert_eq!(offset_of!(PairWire, residual_px), 32);
    assert_eq!(offset_of!(PairWire, reason), 104);
    assert_eq!(size_of::<ProgressWire>(), 240);
    assert_eq!(offset_of!(ProgressWire, n_cameras), 88);
    assert_eq!(offset_of!(ProgressWire, cameras), 112);
    assert_eq!(size_of::<HealthWire>(), 32 + 16 * 72 + 8 * 56);
    assert_eq!(offset_of!(CameraHealthWire, frames), 40);
    assert_eq!(offset_of!(StageWire, p50_ns), 40);
    assert_eq!(size_of::<RequestWire>(), 16);
    assert_eq!(size_of::<ResponseWire>(), 1088);
    assert_eq!(offset_of!(ResponseWire, activity), 532);
    assert_eq!(offset_of!(ResponseWire, reason), 576);
}
