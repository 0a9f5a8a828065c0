//! Straight pieces of a chain: a window is fitted, then grown point by point while the points stay on its line.
use super::trace::EdgePoint;

/// Points of the first window of a piece.
const WINDOW: usize = 10;
/// Largest distance of a point from the line of its piece, px.
const TOLERANCE_PX: f64 = 0.7;
/// So many points in a row may stray before the piece ends.
const MAX_STRAYS: usize = 4;

/// A straight piece of an edge; its ends lie on its own line.
#[derive(Debug, Clone, Copy)]
pub struct Fragment {
    /// Start, px: brighter side on the right hand from here.
    pub start: EdgePoint,
    /// End, px.
    pub end: EdgePoint,
}

impl Fragment {
    /// Squared length, px².
    pub fn length_px2(&self) -> f32 {
        (self.end.x - self.start.x).powi(2) + (self.end.y - self.start.y).powi(2)
    }
}

/// Running moments of points and the total-least-squares line through them.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

/// A line as a point and its unit normal.
#[derive(Debug, Clone, Copy)]
struct FittedLine {
    centre: [f64; 2],
    normal: [f64; 2],
}

impl Moments {
    fn add(&mut self, point: EdgePoint) {
        let (x, y) = (f64::from(point.x), f64::from(point.y));
        self.n += 1.0;
        self.x += x;
        self.y += y;
        self.xx += x * x;
        self.xy += x * y;
        self.yy += y * y;
    }

    fn line(&self) -> FittedLine {
        let (x, y) = (self.x / self.n, self.y / self.n);
        let (xx, xy, yy) = (self.xx / self.n - x * x, self.xy / self.n - x * y, self.yy / self.n - y * y);
        // Eigenvector of the smaller eigenvalue, from the row without cancellation.
        let half_gap = 0.5 * (xx - yy);
        let root = (half_gap * half_gap + xy * xy).sqrt();
        let (a, b) = if half_gap > 0.0 { (-xy, half_gap + root) } else { (root - half_gap, -xy) };
        let norm = (a * a + b * b).sqrt().max(1e-12);
        FittedLine { centre: [x, y], normal: [a / norm, b / norm] }
    }
}

impl FittedLine {
    fn distance(&self, point: EdgePoint) -> f64 {
        (f64::from(point.x) - self.centre[0]) * self.normal[0]
            + (f64::from(point.y) - self.centre[1]) * self.normal[1]
    }

    fn foot(&self, point: EdgePoint) -> EdgePoint {
        let distance = self.distance(point);
        EdgePoint {
            x: (f64::from(point.x) - distance * self.normal[0]) as f32,
            y: (f64::from(point.y) - distance * self.normal[1]) as f32,
        }
    }
}

/// Appends the straight pieces of a chain; `fragments` never grows beyond its capacity.
pub fn split(chain: &[EdgePoint], fragments: &mut Vec<Fragment>) {
    let mut start = 0;
    while start + WINDOW <= chain.len() {
        match grow_piece(chain, start) {
            Some((last, line)) => {
                if fragments.len() < fragments.capacity() {
                    fragments.push(Fragment { start: line.foot(chain[start]), end: line.foot(chain[last]) });
                }
                start = last + 1;
            }
            None => start += 2,
        }
    }
}

/// Last point and line of the piece that starts at `start`; `None` where its first window is not straight.
fn grow_piece(chain: &[EdgePoint], start: usize) -> Option<(usize, FittedLine)> {
    let mut moments = Moments::default();
    let window = &chain[start..start + WINDOW];
    window.iter().for_each(|&point| moments.add(point));
    let mut line = moments.line();
    if window.iter().any(|&point| line.distance(point).abs() > TOLERANCE_PX) {
        return None;
    }
    let mut last = start + WINDOW - 1;
    let mut n_fitted = WINDOW;
    for (idx, &point) in chain.iter().enumerate().skip(start + WINDOW) {
        if idx - last > MAX_STRAYS {
            break;
        }
        if line.distance(point).abs() <= TOLERANCE_PX {
            last = idx;
            moments.add(point);
            // The line hardly changes with one more point: refit when a tenth is new.
            if 10 * (moments.n as usize) >= 11 * n_fitted {
                line = moments.line();
                n_fitted = moments.n as usize;
            }
        }
    }
    Some((last, moments.line()))
}
