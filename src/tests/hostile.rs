//! Input that nobody should be trusted with, for the tests of the parsers: valid bytes that a seeded mutator has damaged, and bytes of
//! pure chance. How many cases: `PELICAL_FUZZ_CASES`, a few hundred without it; the same number gives the same cases.

use std::time::{Duration, Instant};

use proptest::test_runner::{Config, RngSeed};

/// Cases of one test where nobody asks for more.
const EVERYDAY: u64 = 300;
const SEED: u64 = 20_240_513;
/// Longest stretch that is cut out or copied, and longest input of pure chance.
const STRETCH: u64 = 60;
const CHANCE_BYTES: u64 = 400;
/// What tends to break parsers of text.
const PIECES: [&str; 38] = [
    "",
    "\0",
    "&a [*a]",
    "*a",
    "<<: *a",
    "!!binary x",
    ".nan",
    "-.inf",
    "1e999",
    "-1",
    "-0",
    "0",
    "1e-320",
    "0x7fffffffffffffff",
    "9223372036854775808",
    "18446744073709551616",
    "~",
    "null",
    "[",
    "]",
    "{",
    "}",
    "- ",
    ":",
    "\n",
    "\t",
    "\"",
    "'",
    "|",
    ">",
    "---\n",
    "...\n",
    "%YAML 9",
    "\u{e9}",
    "../..",
    "[[]]",
    "\\u0000",
    ",",
];
/// What tends to break readers of lengths.
const WORDS: [u32; 6] = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x0001_0000];

/// How many cases a test tries.
pub(crate) fn cases() -> u64 {
    std::env::var("PELICAL_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(EVERYDAY)
}

/// The same for a property test.
pub(crate) fn properties() -> Config {
    let cases = u32::try_from(cases()).unwrap_or(u32::MAX);
    Config { cases, failure_persistence: None, rng_seed: RngSeed::Fixed(SEED), ..Config::default() }
}

/// Gives every case to `accepts`, which says whether the parser took it and panics where its answer is not sound. Some cases must be
/// taken and some refused, or the test would show nothing. Prints the number, the slowest case and the memory of the process.
pub(crate) fn check_any_bytes(what: &str, valid: &[Vec<u8>], mut accepts: impl FnMut(&[u8]) -> bool) {
    for input in valid {
        assert!(accepts(input), "{what}: an undamaged input is refused: {}", String::from_utf8_lossy(input));
    }
    let (cases, mut taken, mut slowest) = (cases(), 0, Duration::ZERO);
    for number in 0..cases {
        let input = damaged(&mut Random(SEED ^ number << 20), valid);
        let told = Told { what, number, input: &input };
        let began = Instant::now();
        taken += u64::from(accepts(&input));
        slowest = slowest.max(began.elapsed());
        drop(told);
    }
    println!("{what}: {cases} cases, {taken} taken, slowest {slowest:?}, {}", peak_memory());
    assert!(taken > 0 && taken < cases, "{what}: {taken} of {cases} were taken");
}

/// Says which case it was when the parser panics.
struct Told<'a> {
    what: &'a str,
    number: u64,
    input: &'a [u8],
}

impl Drop for Told<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("{} case {}: {:?}", self.what, self.number, String::from_utf8_lossy(self.input));
        }
    }
}

fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    format!("peak memory of the process {}", peak.unwrap_or("unknown").trim())
}

/// Splitmix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % (n.max(1) as u64)) as usize
    }

    /// A place and a short stretch from there.
    fn stretch(&mut self, length: usize) -> std::ops::Range<usize> {
        let from = self.below(length + 1);
        from..(from + self.below(STRETCH as usize)).min(length)
    }
}

fn damaged(random: &mut Random, valid: &[Vec<u8>]) -> Vec<u8> {
    if valid.is_empty() || random.below(20) == 0 {
        return (0..random.next() % CHANCE_BYTES).map(|_| random.next() as u8).collect();
    }
    let mut bytes = valid[random.below(valid.len())].clone();
    for _ in 0..=random.below(3) {
        damage(random, &mut bytes, valid);
    }
    bytes
}

fn damage(random: &mut Random, bytes: &mut Vec<u8>, valid: &[Vec<u8>]) {
    let length = bytes.len();
    let at = random.below(length + 1);
    let stretch = random.stretch(length);
    match random.below(9) {
        0 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << (random.next() % 8)),
        1 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte = random.next() as u8),
        2 => drop(bytes.drain(stretch)),
        3 => {
            let copied = bytes[stretch].to_vec();
            drop(bytes.splice(at..at, copied));
        }
        4 => {
            let piece = PIECES[random.below(PIECES.len())];
            let end = if random.below(2) == 0 { at } else { (at + piece.len()).min(length) };
            drop(bytes.splice(at..end, piece.bytes()));
        }
        5 => bytes.truncate(at),
        6 => {
            let word = WORDS[random.below(WORDS.len())];
            let word = if random.below(2) == 0 { word.to_be_bytes() } else { word.to_le_bytes() };
            bytes.iter_mut().skip(at).zip(word).for_each(|(byte, new)| *byte = new);
        }
        7 => {
            let other = &valid[random.below(valid.len())];
            let end = random.below(other.len() + 1);
            bytes.truncate(at);
            bytes.extend_from_slice(&other[end..]);
        }
        _ => replace_number(random, bytes, at),
    }
}

/// The first number behind a place becomes another one.
fn replace_number(random: &mut Random, bytes: &mut Vec<u8>, at: usize) {
    let is_digit = |byte: &u8| byte.is_ascii_digit();
    let Some(from) = bytes.iter().skip(at).position(is_digit).map(|offset| at + offset) else { return };
    let end = bytes[from..].iter().position(|byte| !is_digit(byte)).map_or(bytes.len(), |n| from + n);
    let number = match random.below(3) {
        0 => random.below(20).to_string(),
        1 => random.next().to_string(),
        _ => PIECES[random.below(PIECES.len())].to_owned(),
    };
    drop(bytes.splice(from..end, number.into_bytes()));
}
