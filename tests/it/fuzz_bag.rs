//! Damaged bags by the thousand: whatever the bytes, the reader answers. `PELICAL_FUZZ_CASES` says how many are tried.

use std::path::Path;

use pelical::capture::RgbdFrame;
use pelical::capture::recording::Recording;

use crate::bag_bytes::{Compression, Message, bag, fixture, messages};
use crate::hostile::check_any_bytes;

/// The first two frames of the small bag, packed and not.
fn seeds() -> Vec<Vec<u8>> {
    let mut images = 0;
    let mut few: Vec<Message> = messages(&fixture("single/wrap.bag"));
    few.retain(|(topic, _)| {
        images += usize::from(topic.ends_with("image/data"));
        !topic.ends_with("image/data") || images <= 4
    });
    let sdk = std::fs::read(fixture("single/wrap.bag")).unwrap();
    vec![sdk, bag(&few, Compression::None), bag(&few, Compression::Lz4)]
}

/// Opens and reads like a calibration does.
fn read_all(path: &Path) -> usize {
    let Ok(recording) = Recording::open(path) else { return 0 };
    let mut frame = RgbdFrame::default();
    let mut n_read = 0;
    for set in recording.frame_sets() {
        for (camera_idx, stamp) in set.iter().enumerate() {
            if recording.read_frame(camera_idx, *stamp, &mut frame).is_ok() {
                assert!(frame.is_of(&recording.cameras()[camera_idx].camera));
                n_read += 1;
            }
        }
    }
    n_read
}

#[test]
fn a_bag_of_any_bytes_is_refused_or_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.bag");
    check_any_bytes("bag", &seeds(), |bytes| {
        std::fs::write(&path, bytes).unwrap();
        read_all(&path) > 0
    });
}
