//! The history of a daemon in a folder, and of the next daemon.

use std::io;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix6, Vector3};

use super::*;
use crate::geometry::motion::Motion;
use crate::solver::{CameraPose, RigCalibration};
use crate::store::Disk;

fn open(folder: &Path, keep: usize) -> Storing {
    let config = StoreConfig { directory: Some(folder.to_owned()), keep };
    Storing::open(&config, &"left_arm".parse().expect("valid"))
}

fn rig(serials: [&str; 2]) -> Vec<CameraIdentity> {
    let identity = |serial: &str| CameraIdentity {
        name: format!("camera {serial}"),
        serial: serial.to_owned(),
        firmware: None,
    };
    serials.map(identity).to_vec()
}

/// A converged calibration, the second camera so far to the right.
fn calibrated(cameras: &[CameraIdentity], right_m: f64) -> CalibrationMessage {
    let pose = |right_m: f64| {
        let reference_from_camera = Motion::new(Vector3::new(right_m, 0.0, 0.0), Vector3::zeros());
        Some(CameraPose { reference_from_camera, covariance: Matrix6::identity() })
    };
    CalibrationMessage {
        sequence: 1,
        stamp_ns: 1_000 + (right_m * 10.0) as u64,
        provenance: Provenance { version: "0.1.0".to_owned(), ..Provenance::default() },
        cameras: cameras.to_vec(),
        calibration: RigCalibration {
            state: State::Converged,
            reason: None,
            reference: 0,
            cameras: vec![pose(0.0), pose(right_m)],
            pairs: Vec::new(),
            frame_sets_used: 3,
        },
    }
}

fn right_m(entry: &StoredCalibration) -> f64 {
    entry.calibration.cameras[1].as_ref().map_or(f64::NAN, |pose| pose.reference_from_camera.translation.x)
}

#[test]
fn the_decision_to_go_back_is_what_the_next_daemon_serves() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut storing = open(folder.path(), 50);
    let cameras = rig(["1", "2"]);
    assert!(storing.newest_for(&cameras).is_none());
    for (number, place_m) in [(1, 0.1), (2, 0.2)] {
        assert_eq!(storing.add(&calibrated(&cameras, place_m), FrameSets::default()), Some(number));
    }
    let back = storing.go_back(1, &cameras, 77).expect("it is there");
    assert_eq!((back.id, back.restored, right_m(&back)), (3, Some(Restored { from: 1, at_ns: 77 }), 0.1));
    let again = storing.go_back(3, &cameras, 78).expect("it is there");
    assert_eq!(again.restored, Some(Restored { from: 1, at_ns: 78 }), "the one that was made");
    assert!(storing.fault().is_none());
    storing.finish();
    let newest = open(folder.path(), 50).newest_for(&cameras).expect("kept");
    assert_eq!(newest, again);
}

#[test]
fn only_the_newest_are_kept_on_disk_and_in_memory() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut storing = open(folder.path(), 2);
    let cameras = rig(["1", "2"]);
    for number in 1..=5 {
        storing.add(&calibrated(&cameras, f64::from(number)), FrameSets::default());
    }
    let id = |storing: &Storing, below| match storing.archived_below(below) {
        Archived::Found(message) => message.provenance.id,
        _ => None,
    };
    assert_eq!([u64::MAX, 5, 4].map(|below| id(&storing, below)), [Some(5), Some(4), None]);
    storing.finish();
    let files = std::fs::read_dir(folder.path().join("left_arm")).expect("made").count();
    assert_eq!(files, 2);
    assert_eq!(open(folder.path(), 2).add(&calibrated(&cameras, 6.0), FrameSets::default()), Some(6));
}

#[test]
fn going_back_is_refused_for_a_reason() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut storing = open(folder.path(), 50);
    storing.add(&calibrated(&rig(["1", "2"]), 0.1), FrameSets::default());
    let refused =
        |storing: &mut Storing, id| storing.go_back(id, &rig(["1", "3"]), 0).expect_err("refused").0;
    assert_eq!(refused(&mut storing, 1), RefusalCode::OtherRig);
    assert_eq!(refused(&mut storing, 2), RefusalCode::UnknownCalibration);
    assert_eq!(refused(&mut Storing::default(), 1), RefusalCode::UnknownCalibration);
    assert!(matches!(Storing::default().archived_below(1), Archived::NotKept { .. }));
}

#[test]
fn the_same_fault_is_said_once_and_ends_when_the_disk_works_again() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("left_arm"), "no folder").expect("written");
    let storing = open(folder.path(), 2);
    let fault = storing.fault().expect("it cannot be listed");
    assert!(fault.contains("left_arm") && fault.contains("started again"), "{fault}");
    let mut fault = Some("the disk is full".to_owned());
    take(Report::Saved { id: 1 }, &mut fault);
    assert_eq!(fault, None);
}

#[test]
fn the_firmware_of_the_cameras_is_kept_and_served_before_any_camera_is_opened() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut cameras = rig(["1", "2"]);
    cameras[1].firmware = Some("5.16.0.1".to_owned());
    let mut storing = open(folder.path(), 50);
    storing.add(&calibrated(&cameras, 0.1), FrameSets::default());
    storing.finish();
    let next = open(folder.path(), 50).newest_for(&rig(["1", "2"])).expect("it was kept");
    let served = message(&next, State::Stored);
    assert_eq!(served.cameras[1].firmware.as_deref(), Some("5.16.0.1"));
    assert_eq!(served.cameras[0].firmware, None);
}

/// A disk whose first call is a bug.
struct Broken;

impl Disk for Broken {
    type File = ();

    fn make_folder(&self, _: &Path) -> io::Result<()> {
        panic!("a bug, for this test")
    }

    fn list(&self, _: &Path) -> io::Result<Vec<PathBuf>> {
        Ok(Vec::new())
    }

    fn read(&self, _: &Path) -> io::Result<Vec<u8>> {
        Ok(Vec::new())
    }

    fn create(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, _: &mut (), _: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn sync(&self, _: &()) -> io::Result<()> {
        Ok(())
    }

    fn rename(&self, _: &Path, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn sync_folder(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn remove(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_thread_that_writes_no_more_is_a_fault_that_stays() {
    let writer = Writer::start(Store::on(Broken, "/nowhere".into())).expect("a thread");
    let kept = Kept { history: History::default(), writer, keep: 50 };
    let mut storing = Storing { kept: Some(kept), fault: None };
    let cameras = rig(["1", "2"]);
    storing.poll();
    assert!(storing.fault().is_none());
    storing.add(&calibrated(&cameras, 0.1), FrameSets::default());
    while storing.fault().is_none() {
        std::thread::yield_now();
        storing.poll();
    }
    storing.add(&calibrated(&cameras, 0.2), FrameSets::default());
    storing.poll();
    let fault = storing.fault().expect("it stays");
    assert!(fault.contains("which is a bug") && fault.contains("started again"), "{fault}");
    let kept = storing.kept.take().expect("there");
    assert!(!kept.writer.finish(FINISH_WITHIN).1, "nothing was written");
}
