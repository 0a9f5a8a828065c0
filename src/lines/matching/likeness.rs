//! How much two lines differ in looks, with what the pictures differ by taken out.

use super::tone::ToneShift;
use crate::lines::describe::{LineDescriptor, SideLook};

/// Differences of the logarithm of light, colour and spread count up to here: beyond, it is another surface.
const MAX_LIGHT: f32 = 0.6;
const MAX_COLOUR: f32 = 0.4;
/// Less of a side than this in the image says nothing.
const MIN_SEEN: f32 = 0.3;
/// What an unseen side counts as.
const UNSEEN: f32 = 1.0;

/// 0 for lines that look the same; infinite where a line has no looks.
pub(super) fn unlikeness(target: &LineDescriptor, source: &LineDescriptor, shift: &ToneShift) -> f32 {
    if target.n_pieces == 0 || source.n_pieces == 0 {
        return f32::INFINITY;
    }
    [0, 1].iter().map(|&side| of_side(&target.whole[side], &source.whole[side], shift)).sum::<f32>() * 0.5
}

fn of_side(target: &SideLook, source: &SideLook, shift: &ToneShift) -> f32 {
    if target.seen.min(source.seen) < MIN_SEEN {
        return UNSEEN;
    }
    mean_gap((&target.light, &source.light), shift.light, MAX_LIGHT)
        + 2.0 * mean_gap((&target.red_green, &source.red_green), shift.red_green, MAX_COLOUR)
        + 2.0 * mean_gap((&target.blue_green, &source.blue_green), shift.blue_green, MAX_COLOUR)
        + mean_gap((&target.spread, &source.spread), 0.0, MAX_LIGHT)
}

fn mean_gap<const N: usize>((target, source): (&[f32; N], &[f32; N]), shift: f32, most: f32) -> f32 {
    let gaps = target.iter().zip(source).map(|(a, b)| (a - b - shift).abs().min(most));
    gaps.sum::<f32>() / N as f32
}
