//! Looks as weighted rows of numbers, so that comparing two is one loop over lanes.

use super::tone::Tone;
use crate::lines::describe::{BANDS, LineDescriptor, MAX_PIECES, SideLook, ZONES};

/// Lanes of one side: light, two colours and spread are 15, and one is left empty.
pub(super) const LANES: usize = 16;
/// What each kind counts as a whole.
const LIGHT_WEIGHT: f32 = 1.0;
const COLOUR_WEIGHT: f32 = 2.0;
const SPREAD_WEIGHT: f32 = 1.0;
/// Differences of a logarithm count up to here: beyond, it is another surface.
const MAX_LIGHT: f32 = 0.6;
const MAX_COLOUR: f32 = 0.4;
/// Less of a side than this in the image says nothing.
const MIN_SEEN: f32 = 0.3;
/// What a side counts that one of the two images does not show: about as much as two sides taken at random.
const UNSEEN: f32 = 0.8;

const LIGHT_LANE: f32 = LIGHT_WEIGHT / BANDS as f32;
const COLOUR_LANE: f32 = COLOUR_WEIGHT / ZONES as f32;
const SPREAD_LANE: f32 = SPREAD_WEIGHT / ZONES as f32;

/// Largest difference per lane.
const MOST: [f32; LANES] = {
    let mut most = [0.0; LANES];
    let mut lane = 0;
    while lane < BANDS + 3 * ZONES {
        most[lane] = if lane < BANDS {
            MAX_LIGHT * LIGHT_LANE
        } else if lane < BANDS + 2 * ZONES {
            MAX_COLOUR * COLOUR_LANE
        } else {
            MAX_LIGHT * SPREAD_LANE
        };
        lane += 1;
    }
    most
};

/// One side, weighted.
#[derive(Debug, Clone, Copy)]
pub(super) struct PackedSide {
    lanes: [f32; LANES],
    is_seen: bool,
}

impl PackedSide {
    fn of(look: &SideLook, tone: &Tone) -> Self {
        let light = look.light.iter().map(|value| LIGHT_LANE * (value - tone.light));
        let red_green = look.red_green.iter().map(|value| COLOUR_LANE * (value - tone.red_green));
        let blue_green = look.blue_green.iter().map(|value| COLOUR_LANE * (value - tone.blue_green));
        let spread = look.spread.iter().map(|value| SPREAD_LANE * value);
        let mut lanes = [0.0; LANES];
        let values = light.chain(red_green).chain(blue_green).chain(spread);
        lanes.iter_mut().zip(values).for_each(|(lane, value)| *lane = value);
        Self { lanes, is_seen: look.seen >= MIN_SEEN }
    }

    /// 0 for sides that look the same.
    fn gap(&self, other: &Self) -> f32 {
        if !(self.is_seen && other.is_seen) {
            return UNSEEN;
        }
        // Four sums side by side, for vector registers; selected by comparison, which is one instruction and `f32::min` is not.
        let mut sums = [0.0_f32; 4];
        for chunk in 0..LANES / 4 {
            for (lane, sum) in sums.iter_mut().enumerate() {
                let lane = 4 * chunk + lane;
                let gap = (self.lanes[lane] - other.lanes[lane]).abs();
                *sum += if gap < MOST[lane] { gap } else { MOST[lane] };
            }
        }
        (sums[0] + sums[1]) + (sums[2] + sums[3])
    }
}

/// Left and right.
pub(super) type PackedSides = [PackedSide; 2];

/// Mean over both sides.
pub(super) fn gap(a: &PackedSides, b: &PackedSides) -> f32 {
    0.5 * (a[0].gap(&b[0]) + a[1].gap(&b[1]))
}

/// A line with a tone taken off.
#[derive(Debug, Clone)]
pub(super) struct PackedLine {
    pub(super) whole: PackedSides,
    pieces: [PackedSides; MAX_PIECES],
    n_pieces: usize,
    pub(super) piece_m: f32,
}

impl PackedLine {
    /// The look less `tone`.
    pub(super) fn of(look: &LineDescriptor, tone: &Tone) -> Self {
        let sides = |sides: &[SideLook; 2]| [0, 1].map(|side| PackedSide::of(&sides[side], tone));
        let n_pieces = usize::from(look.n_pieces).min(MAX_PIECES);
        let pieces = std::array::from_fn(|idx| sides(&look.pieces[idx]));
        Self { whole: sides(&look.whole), pieces, n_pieces, piece_m: look.piece_m }
    }

    /// From start to end; none for a line that was not described.
    pub(super) fn pieces(&self) -> &[PackedSides] {
        &self.pieces[..self.n_pieces]
    }

    pub(super) fn length_m(&self) -> f32 {
        self.piece_m * self.n_pieces as f32
    }
}
