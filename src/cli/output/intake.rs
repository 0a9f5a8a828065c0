//! What became of frame sets before their lines were compared: why they were refused, and how far apart the cameras' frames are.

use serde::Serialize;

use super::text::table;
use crate::ipc::{self, TurnSense, Turning};
use crate::pipeline::PairSkew;
use crate::pipeline::offline::RefusedSets;

/// Why frame sets were refused; together they are all that were.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RefusedFor {
    /// Fewer than two frames; a daemon forms no such set.
    pub incomplete: u64,
    /// Stamps further apart than `sync.max_skew_ms`.
    pub skew: u64,
    /// A gyro said that the rig turned faster than `sync.max_turn_deg_per_s`.
    pub gyro: u64,
    /// An image moved as fast as that.
    pub image: u64,
    /// Nothing new in it; an offline run uses such sets too.
    pub nothing_new: u64,
}

impl From<RefusedSets> for RefusedFor {
    fn from(refused: RefusedSets) -> Self {
        let RefusedSets { incomplete, skew, gyro, image } = refused;
        let [incomplete, skew, gyro, image] = [incomplete, skew, gyro, image].map(|count| count as u64);
        Self { incomplete, skew, gyro, image, nothing_new: 0 }
    }
}

impl From<ipc::RefusedCounts> for RefusedFor {
    fn from(refused: ipc::RefusedCounts) -> Self {
        let ipc::RefusedCounts { skew, gyro, image, repeated } = refused;
        Self { incomplete: 0, skew, gyro, image, nothing_new: repeated }
    }
}

impl RefusedFor {
    /// All of them.
    pub fn total(self) -> u64 {
        self.incomplete + self.skew + self.gyro + self.image + self.nothing_new
    }

    /// For people: `2 skew, 5 turning fast (gyro)`; empty where nothing was refused.
    pub fn text(&self) -> String {
        let parts = [
            (self.incomplete, "incomplete"),
            (self.skew, "skew"),
            (self.gyro, "turning fast (gyro)"),
            (self.image, "moving fast (image)"),
            (self.nothing_new, "nothing new"),
        ];
        let said = parts.iter().filter(|(count, _)| *count > 0);
        said.map(|(count, why)| format!("{count} {why}")).collect::<Vec<_>>().join(", ")
    }
}

/// How far apart the frames of two cameras are, over the whole run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SkewEntry {
    /// Frame sets that both are in.
    pub sets: u64,
    /// Median, to 1/16.
    pub p50_ms: f64,
    /// 99 of 100 are not larger, to 1/16.
    pub p99_ms: f64,
    /// Largest.
    pub max_ms: f64,
    /// How often the nearest frames were further apart than the limit.
    pub beyond: u64,
    /// How far apart they were the last time; null before the first.
    pub last_beyond_ms: Option<f64>,
}

impl From<&PairSkew> for SkewEntry {
    fn from(pair: &PairSkew) -> Self {
        let within = pair.within;
        Self {
            sets: within.count,
            p50_ms: within.p50_ms,
            p99_ms: within.p99_ms,
            max_ms: within.max_ms,
            beyond: pair.beyond,
            last_beyond_ms: (pair.beyond > 0).then_some(pair.last_beyond_ms),
        }
    }
}

impl From<&ipc::PairSkew> for SkewEntry {
    fn from(pair: &ipc::PairSkew) -> Self {
        let ms = |ns: u64| ns as f64 * 1e-6;
        Self {
            sets: pair.sets,
            p50_ms: ms(pair.p50_ns),
            p99_ms: ms(pair.p99_ns),
            max_ms: ms(pair.max_ns),
            beyond: pair.beyond,
            last_beyond_ms: (pair.beyond > 0).then(|| ms(pair.last_beyond_ns)),
        }
    }
}

impl SkewEntry {
    /// Median, p99, largest, count beyond the limit, and the last of these; a dash where there is none.
    pub fn cells(&self) -> Vec<String> {
        let ms = |value: f64| if self.sets > 0 { format!("{value:.2}") } else { "-".to_owned() };
        let beyond = self
            .last_beyond_ms
            .map_or_else(|| self.beyond.to_string(), |last| format!("{} (last {last:.1} ms)", self.beyond));
        vec![ms(self.p50_ms), ms(self.p99_ms), ms(self.max_ms), beyond]
    }
}

/// Two cameras and their skew.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairSkewEntry {
    /// Their names.
    pub cameras: [String; 2],
    /// How far apart their frames are.
    #[serde(flatten)]
    pub skew: SkewEntry,
}

/// The table of all pairs, ending with a line break.
pub fn skew_table(pairs: &[PairSkewEntry]) -> String {
    let row = |pair: &PairSkewEntry| [vec![pair.cameras.join(", ")], pair.skew.cells()].concat();
    let header = ["time between frames", "median ms", "p99 ms", "largest ms", "beyond limit"];
    table(&header, &pairs.iter().map(row).collect::<Vec<_>>())
}

/// How fast the rig turns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TurnEntry {
    /// In the newest frame set.
    pub deg_per_s: f64,
    /// gyro or image.
    pub by: &'static str,
}

impl From<Turning> for TurnEntry {
    fn from(turning: Turning) -> Self {
        let by = match turning.sense {
            TurnSense::Gyro => "gyro",
            TurnSense::Image => "image",
        };
        Self { deg_per_s: turning.rad_per_s.to_degrees(), by }
    }
}
