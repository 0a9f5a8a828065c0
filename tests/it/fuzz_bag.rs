//! Damaged bags by the thousand: whatever the bytes, the reader answers. `PELICAL_FUZZ_CASES` says how many are tried.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use pelical::capture::RgbdFrame;
use pelical::capture::recording::Recording;

use crate::bag_bytes::{Compression, Message, bag, fixture, messages};

/// Without the variable: a second or two.
const EVERYDAY_CASES: u64 = 400;

/// xorshift64*, seeded by the number of the case.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

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

/// Damages bytes in one to eight places.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..1 + random.below(8) {
        let at = random.below(bytes.len());
        let len = 1 + random.below(64);
        let end = (at + len).min(bytes.len());
        match random.below(8) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..end)),
            2 => {
                let piece = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, piece);
            }
            3 => {
                let number =
                    [0, 1, 0x7F, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFF0, u32::MAX][random.below(8)];
                let number = u32::to_le_bytes(number);
                let end = (at + 4).min(bytes.len());
                bytes[at..end].copy_from_slice(&number[..end - at]);
            }
            4 => bytes[at..end].fill([0, 0xFF, b'='][random.below(3)]),
            _ => bytes[at] ^= 1 << random.below(8),
        }
        if bytes.is_empty() {
            return;
        }
    }
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
fn no_damage_to_a_bag_brings_the_reader_down() {
    let n_cases = std::env::var("PELICAL_FUZZ_CASES").map_or(EVERYDAY_CASES, |text| text.parse().unwrap());
    let seeds = seeds();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.bag");
    let (mut n_whole, mut n_refused) = (0, 0);
    for case in 0..n_cases {
        let mut random = Random(0x9E37_79B9_7F4A_7C15 ^ (case + 1).wrapping_mul(0xD134_2543_DE82_EF95));
        let mut bytes = seeds[random.below(seeds.len())].clone();
        damage(&mut bytes, &mut random);
        std::fs::write(&path, &bytes).unwrap();
        match catch_unwind(AssertUnwindSafe(|| read_all(&path))) {
            Ok(0) => n_refused += 1,
            Ok(_) => n_whole += 1,
            Err(_) => panic!("case {case} of {n_cases} brought the reader down"),
        }
    }
    // Neither does everything fail at the door, nor does the damage never matter.
    assert!(n_whole > n_cases / 100 && n_refused > n_cases / 100, "{n_whole} read, {n_refused} refused");
}
