//! What two pictures differ by in exposure and white balance: what the lines that look most alike without regard to it say.

use super::packed::{PackedLine, gap};
use super::table::Table;
use crate::lines::describe::{LineDescriptor, SideLook};

/// Both sides have to be seen this well.
const MIN_SEEN: f32 = 0.7;
/// Lines of each image that are asked; the longest come first.
const MAX_ASKED: usize = 120;

/// Logarithms of light, of red over green and of blue over green.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Tone {
    pub(super) light: f32,
    pub(super) red_green: f32,
    pub(super) blue_green: f32,
}

impl Tone {
    /// The mean over both sides of a line.
    fn of(look: &LineDescriptor) -> Self {
        let mean = |values: fn(&SideLook) -> &[f32]| {
            let [left, right] = [0, 1].map(|side| values(&look.whole[side]));
            (left.iter().sum::<f32>() + right.iter().sum::<f32>()) / (left.len() + right.len()) as f32
        };
        Self {
            light: mean(|side| &side.light),
            red_green: mean(|side| &side.red_green),
            blue_green: mean(|side| &side.blue_green),
        }
    }

    pub(super) fn scaled(&self, factor: f32) -> Self {
        Self {
            light: factor * self.light,
            red_green: factor * self.red_green,
            blue_green: factor * self.blue_green,
        }
    }

    /// What the target's picture has more than the source's; `None` where no two lines can be compared.
    pub(super) fn shift_between(target: &[LineDescriptor], source: &[LineDescriptor]) -> Option<Self> {
        let [target, source] = [target, source].map(|looks| &looks[..looks.len().min(MAX_ASKED)]);
        let [toneless_target, toneless_source] = [target, source].map(toneless);
        let table = Table::new((target.len(), source.len()), |t, s| {
            match (&toneless_target[t], &toneless_source[s]) {
                (Some(a), Some(b)) => gap(&a.whole, &b.whole),
                _ => f32::INFINITY,
            }
        });
        let shifts: Vec<Tone> = table
            .mutual_best()
            .map(|(t, s)| {
                let (a, b) = (Tone::of(&target[t]), Tone::of(&source[s]));
                Tone {
                    light: a.light - b.light,
                    red_green: a.red_green - b.red_green,
                    blue_green: a.blue_green - b.blue_green,
                }
            })
            .collect();
        Some(Self {
            light: median(&shifts, |tone| tone.light)?,
            red_green: median(&shifts, |tone| tone.red_green)?,
            blue_green: median(&shifts, |tone| tone.blue_green)?,
        })
    }
}

/// Each line less its own tone; `None` where a side is missing.
fn toneless(looks: &[LineDescriptor]) -> Vec<Option<PackedLine>> {
    let usable =
        |look: &LineDescriptor| look.n_pieces > 0 && look.whole.iter().all(|side| side.seen >= MIN_SEEN);
    looks.iter().map(|look| usable(look).then(|| PackedLine::of(look, &Tone::of(look)))).collect()
}

/// Of an even number the mean of the middle two, so that swapped roles give exactly the opposite.
fn median(shifts: &[Tone], part: fn(&Tone) -> f32) -> Option<f32> {
    let mut values: Vec<f32> = shifts.iter().map(part).collect();
    values.sort_unstable_by(f32::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}
