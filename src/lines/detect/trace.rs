//! Edge drawing: from anchors, follow the ridge of the gradient pixel by pixel.
//!
//! The way along an edge follows from the gradient alone (brighter side on the right hand), so a chain never turns back.
use super::gradient::{BORDER_PX, Gradient};

/// Longest chain, px; a longer edge goes on as another chain.
pub const MAX_CHAIN_PX: usize = 8192;

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
    backward: Vec<EdgePoint>,
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
        self.chain.clear();
        self.chain.reserve(2 * MAX_CHAIN_PX);
        for y in BORDER_PX + 1..gradient.height - BORDER_PX - 1 {
            let row = y * gradient.width;
            // Anchors are looked for on a grid of lines: an edge worth having crosses one.
            let stride = if y % ANCHOR_GRID_PX == 0 { 1 } else { ANCHOR_GRID_PX };
            for x in (BORDER_PX + 1..gradient.width - BORDER_PX - 1).step_by(stride) {
                if gradient.magnitude[row + x] >= limits.anchor
                    && !self.used[row + x]
                    && is_ridge(gradient, row + x)
                {
                    self.draw(gradient, row + x);
                    take(&self.chain);
                }
            }
        }
    }

    /// Replaces the chain by the edge through an anchor.
    fn draw(&mut self, gradient: &Gradient, anchor: usize) {
        self.backward.clear();
        self.chain.clear();
        self.used[anchor] = true;
        let mut at = anchor;
        while let Some(next) = self.step(gradient, at, Way::Backward) {
            self.backward.push(localise(gradient, next));
            at = next;
            if self.backward.len() == MAX_CHAIN_PX {
                break;
            }
        }
        self.chain.extend(self.backward.iter().rev());
        self.chain.push(localise(gradient, anchor));
        at = anchor;
        while let Some(next) = self.step(gradient, at, Way::Forward) {
            self.chain.push(localise(gradient, next));
            at = next;
            if self.chain.len() == 2 * MAX_CHAIN_PX {
                break;
            }
        }
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

/// Part of the parabola's error at `offset` that goes with `offset (1/4 - offset²)`.
const PARABOLA_BIAS: f32 = 0.5;

/// Offset of the maximum from the middle sample, at most one; 0 where there is none.
///
/// The ridge of a step seen through the filters is nearly a Gaussian of 1.4 px, on which a parabola pulls the top towards
/// the middle by up to 0.024 px; that is undone.
pub fn top_of_parabola([before, here, after]: [f32; 3]) -> f32 {
    let curvature = before - 2.0 * here + after;
    if curvature >= 0.0 {
        return 0.0;
    }
    let offset = (0.5 * (before - after) / curvature).clamp(-1.0, 1.0);
    offset + PARABOLA_BIAS * offset * (0.25 - offset * offset).max(0.0)
}
