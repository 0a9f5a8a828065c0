//! What two pictures differ by in exposure and white balance.

use crate::lines::describe::{LineDescriptor, SideLook};

/// Both sides have to be seen this well.
const MIN_SEEN: f32 = 0.7;

/// Target minus source, as logarithms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ToneShift {
    pub(super) light: f32,
    pub(super) red_green: f32,
    pub(super) blue_green: f32,
    /// Between the quartiles of light over the lines asked.
    pub(super) disagreement: f32,
}

/// Logarithms of light, red over green, blue over green, over both sides.
type Tone = [f32; 3];

impl ToneShift {
    /// From the lines that are mutually most alike without regard to tone; `None` where there are none.
    pub(super) fn between(target: &[LineDescriptor], source: &[LineDescriptor]) -> Option<Self> {
        let [target, source] = [target, source].map(|looks| looks.iter().map(Shape::of).collect::<Vec<_>>());
        let mut nearest_source = vec![(f32::INFINITY, 0); target.len()];
        let mut nearest_target = vec![(f32::INFINITY, 0); source.len()];
        for (t, a) in target.iter().enumerate() {
            for (s, b) in source.iter().enumerate() {
                let gap = a.gap(b);
                if gap < nearest_source[t].0 {
                    nearest_source[t] = (gap, s);
                }
                if gap < nearest_target[s].0 {
                    nearest_target[s] = (gap, t);
                }
            }
        }
        let mutual = nearest_source
            .iter()
            .enumerate()
            .filter(|(t, (gap, s))| gap.is_finite() && nearest_target[*s].1 == *t);
        let shifts: Vec<Tone> = mutual
            .map(|(t, (_, s))| std::array::from_fn(|i| target[t].tone[i] - source[*s].tone[i]))
            .collect();
        Self::median(&shifts)
    }

    fn median(shifts: &[Tone]) -> Option<Self> {
        if shifts.is_empty() {
            return None;
        }
        let sorted = |i: usize| {
            let mut values: Vec<f32> = shifts.iter().map(|shift| shift[i]).collect();
            values.sort_unstable_by(f32::total_cmp);
            values
        };
        let light = sorted(0);
        let at = |values: &[f32], quarter: usize| values[(values.len() - 1) * quarter / 4];
        Some(Self {
            light: at(&light, 2),
            red_green: at(&sorted(1), 2),
            blue_green: at(&sorted(2), 2),
            disagreement: at(&light, 3) - at(&light, 1),
        })
    }

    /// 1 where the lines agree on the shift, 0 where they are no lines of one place.
    pub(super) fn trust(&self) -> f64 {
        f64::from(1.5 - 3.0 * self.disagreement).clamp(0.0, 1.0)
    }
}

/// A line's looks with its mean tone taken out.
struct Shape {
    tone: Tone,
    values: [f32; Shape::N],
}

impl Shape {
    const N: usize = 30;

    fn of(look: &LineDescriptor) -> Self {
        let mut values = [0.0; Self::N];
        let [left, right] = &look.whole;
        let usable = look.n_pieces > 0 && left.seen.min(right.seen) >= MIN_SEEN;
        let tone = [
            mean([&left.light, &right.light]),
            mean([&left.red_green, &right.red_green]),
            mean([&left.blue_green, &right.blue_green]),
        ];
        for (side, values) in look.whole.iter().zip(values.chunks_exact_mut(Self::N / 2)) {
            fill(side, &tone, values);
        }
        if !usable {
            // Not a number is nearer to nothing.
            values[0] = f32::NAN;
        }
        Self { tone, values }
    }

    fn gap(&self, other: &Self) -> f32 {
        self.values.iter().zip(&other.values).map(|(a, b)| (a - b).abs()).sum()
    }
}

fn mean<const N: usize>(sides: [&[f32; N]; 2]) -> f32 {
    sides.iter().flat_map(|side| side.iter()).sum::<f32>() / (2 * N) as f32
}

/// Each of light, colours and spread weighs the same, however many numbers it has.
fn fill(side: &SideLook, tone: &Tone, values: &mut [f32]) {
    let light = side.light.iter().map(|value| 0.5 * (value - tone[0]));
    let red_green = side.red_green.iter().map(|value| value - tone[1]);
    let blue_green = side.blue_green.iter().map(|value| value - tone[2]);
    let all = light.chain(red_green).chain(blue_green).chain(side.spread.iter().copied());
    for (slot, value) in values.iter_mut().zip(all) {
        *slot = value;
    }
}
