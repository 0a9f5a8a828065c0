//! Edge drawing: from anchors, follow the ridge of the gradient pixel by pixel.
//!
//! The way along an edge follows from the gradient alone (brighter side on the right hand), so a chain never turns back.
use super::gradient::{BORDER_PX, Gradient};
use super::samples::top_of_parabola;

/// Longest chain, px; a longer edge goes on as another chain.
pub const MAX_CHAIN_PX: usize = 8192;

/// Shorter chains hold no fragment.
const MIN_CHAIN_PX: usize = 9;

/// Spacing of the rows and columns that are searched for anchors, px.
const ANCHOR_GRID_PX: usize = 4;

/// A point of an edge, sub-pixel, px.
#[derive(Debug, Clone, Copy)]
pub struct EdgePoint {
    /// Column.
    pub x: f32,
    /// Row.
    pub y: f32,
}

/// Least gradients, counts.
#[derive(Debug, Clone, Copy)]
pub struct TraceLimits {
    /// To start a chain.
    pub anchor: i16,
    /// To go on.
    pub follow: i16,
}

/// Pixels of a row that are passed over together where none is strong enough.
const SKIP_PX: usize = 16;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    Forward,
    Backward,
}

/// Draws the edges of one gradient image.
#[derive(Debug, Default)]
pub struct Tracer {
    /// Least gradient to go on, counts.
    follow: i16,
    used: Vec<bool>,
    /// Pixels of the chain in work, by index: those before the anchor, in reverse, and those from it on.
    backward: Vec<u32>,
    forward: Vec<u32>,
    chain: Vec<EdgePoint>,
}

impl Tracer {
    /// Calls `take` with each chain of points, in order along the edge.
    pub fn trace(&mut self, gradient: &Gradient, limits: TraceLimits, mut take: impl FnMut(&[EdgePoint])) {
        self.follow = limits.follow;
        self.used.clear();
        self.used.resize(gradient.magnitude.len(), false);
        self.backward.clear();
        self.backward.reserve(MAX_CHAIN_PX);
        self.forward.clear();
        self.forward.reserve(MAX_CHAIN_PX);
        self.chain.clear();
        self.chain.reserve(2 * MAX_CHAIN_PX);
        for y in BORDER_PX + 1..gradient.height - BORDER_PX - 1 {
            let row = y * gradient.width;
            let (first, last) = (row + BORDER_PX + 1, row + gradient.width - BORDER_PX - 1);
            // Anchors are looked for on a grid of lines: an edge worth having crosses one.
            if y % ANCHOR_GRID_PX != 0 {
                for at in (first..last).step_by(ANCHOR_GRID_PX) {
                    self.trace_from(gradient, (at, limits.anchor), &mut take);
                }
                continue;
            }
            for begin in (first..last).step_by(SKIP_PX) {
                let pixels = begin..(begin + SKIP_PX).min(last);
                // A fold without a branch: most of an image is without an edge.
                let strongest = gradient.magnitude[pixels.clone()].iter().fold(0, |a, &b| a.max(b));
                if strongest >= limits.anchor {
                    pixels.for_each(|at| self.trace_from(gradient, (at, limits.anchor), &mut take));
                }
            }
        }
    }

    /// Draws the edge through a pixel if that is an anchor.
    fn trace_from(
        &mut self,
        gradient: &Gradient,
        (at, least): (usize, i16),
        take: &mut impl FnMut(&[EdgePoint]),
    ) {
        if gradient.magnitude[at] < least || self.used[at] || !is_ridge(gradient, at) {
            return;
        }
        self.draw(gradient, at);
        if self.backward.len() + self.forward.len() >= MIN_CHAIN_PX {
            self.localise(gradient);
            take(&self.chain);
        }
    }

    /// Follows the edge through an anchor both ways.
    fn draw(&mut self, gradient: &Gradient, anchor: usize) {
        self.used[anchor] = true;
        self.backward.clear();
        let mut at = anchor;
        while self.backward.len() < MAX_CHAIN_PX
            && let Some(next) = self.step(gradient, at, Way::Backward)
        {
            self.backward.push(next as u32);
            at = next;
        }
        self.forward.clear();
        self.forward.push(anchor as u32);
        at = anchor;
        while self.forward.len() < MAX_CHAIN_PX
            && let Some(next) = self.step(gradient, at, Way::Forward)
        {
            self.forward.push(next as u32);
            at = next;
        }
    }

    /// Replaces the chain by the sub-pixel points of the pixels in work.
    fn localise(&mut self, gradient: &Gradient) {
        let pixels = self.backward.iter().rev().chain(&self.forward);
        self.chain.clear();
        self.chain.extend(pixels.map(|&pixel| localise(gradient, pixel as usize)));
    }

    /// The strongest of the three next pixels, marked as used; `None` where the edge ends.
    fn step(&mut self, gradient: &Gradient, at: usize, way: Way) -> Option<usize> {
        let [gx, gy] = gradient.vector[at].map(i32::from);
        // Along the edge with the brighter side on the right hand: (gy, -gx).
        let (ahead, aside) = if gy.abs() >= gx.abs() {
            (isize::from(gy > 0) * 2 - 1, gradient.width as isize)
        } else {
            ((isize::from(gx < 0) * 2 - 1) * gradient.width as isize, 1)
        };
        let ahead = if way == Way::Forward { ahead } else { -ahead };
        let middle = at.wrapping_add_signed(ahead);
        let candidates = [middle, middle.wrapping_add_signed(-aside), middle.wrapping_add_signed(aside)];
        let mut best: Option<usize> = None;
        for candidate in candidates {
            let magnitude = gradient.magnitude.get(candidate).copied().unwrap_or(0);
            if magnitude >= self.follow && best.is_none_or(|best| magnitude > gradient.magnitude[best]) {
                best = Some(candidate);
            }
        }
        let best = best?;
        let [next_x, next_y] = gradient.vector[best].map(i32::from);
        let agrees = gx * next_x + gy * next_y > 0;
        if self.used[best] || !agrees {
            return None;
        }
        self.used[best] = true;
        Some(best)
    }
}

/// Index distance to the neighbours across the edge.
fn across(gradient: &Gradient, at: usize) -> usize {
    let [x, y] = gradient.vector[at];
    let horizontal = y.unsigned_abs() >= x.unsigned_abs();
    if horizontal { gradient.width } else { 1 }
}

fn is_ridge(gradient: &Gradient, at: usize) -> bool {
    let across = across(gradient, at);
    let magnitude = &gradient.magnitude;
    magnitude[at] > magnitude[at - across] && magnitude[at] >= magnitude[at + across]
}

/// Where the parabola through three magnitudes across the edge has its top.
fn localise(gradient: &Gradient, at: usize) -> EdgePoint {
    let across = across(gradient, at);
    let [before, here, after] =
        [at - across, at, at + across].map(|index| f32::from(gradient.magnitude[index]));
    let (x, y) = ((at % gradient.width) as f32, (at / gradient.width) as f32);
    let offset = top_of_parabola([before, here, after]);
    if across == 1 { EdgePoint { x: x + offset, y } } else { EdgePoint { x, y: y + offset } }
}
