//! The heat map: which panels it has, where they stand, and what colour an error has. How it is written is in `drawing`.

use super::document::PaperDocument;
use super::drawing::Drawing;
use super::grid::Spread;
use crate::cli::canvas::Rgb;

const CELL_PX: [u32; 2] = [64, 26];
/// Room for the labels of the rows.
const LABEL_PX: u32 = 64;
/// Room for the title and the labels of the columns.
const HEAD_PX: u32 = 46;
/// Between panels and around them.
const GAP_PX: u32 = 28;
const INK: Rgb = [30, 30, 30];
const PAPER: Rgb = [255, 255, 255];
/// A step or configuration without a converged trial.
const MISSING: Rgb = [225, 225, 225];
/// From no error to the largest of a panel: light yellow, orange, brown.
const SCALE: [Rgb; 4] = [[255, 255, 229], [254, 196, 79], [217, 95, 14], [102, 37, 6]];

/// One panel.
struct Panel {
    title: String,
    columns: Vec<String>,
    /// Largest first, as in the paper's tables.
    rows: Vec<(String, Vec<Option<f64>>)>,
    digits: usize,
}

impl Panel {
    fn largest(&self) -> f64 {
        self.rows.iter().flat_map(|(_, values)| values).flatten().copied().fold(0.0, f64::max)
    }

    fn size_px(&self) -> [u32; 2] {
        let (columns, rows) = (self.columns.len() as u32, self.rows.len() as u32);
        let title_px = 8 * self.title.chars().count() as u32;
        [(LABEL_PX + columns * CELL_PX[0]).max(title_px), HEAD_PX + rows * CELL_PX[1]]
    }

    /// Draws it with its upper left corner at a place; `largest` has the darkest colour.
    fn draw(&self, drawing: &mut Drawing, [left, top]: [u32; 2], largest: f64) {
        drawing.text([left, top + 10], &self.title, INK);
        let center =
            |column: usize, y: u32| [left + LABEL_PX + column as u32 * CELL_PX[0] + CELL_PX[0] / 2, y];
        for (i, column) in self.columns.iter().enumerate() {
            drawing.centered_text(center(i, top + 34), column, INK);
        }
        for (i, (row, values)) in self.rows.iter().enumerate() {
            let y = top + HEAD_PX + i as u32 * CELL_PX[1];
            drawing.text([left, y + CELL_PX[1] / 2], row, INK);
            for (j, value) in values.iter().enumerate() {
                let share = value.map(|value| if largest > 0.0 { value / largest } else { 0.0 });
                let at = [left + LABEL_PX + j as u32 * CELL_PX[0], y];
                drawing.rectangle(at, [CELL_PX[0] - 1, CELL_PX[1] - 1], share.map_or(MISSING, color));
                let text = value.map_or_else(|| "-".to_owned(), |value| format!("{value:.0$}", self.digits));
                let ink = if share.is_some_and(|share| share > 0.5) { PAPER } else { INK };
                drawing.centered_text(center(j, y + CELL_PX[1] / 2), &text, ink);
            }
        }
    }
}

/// Errors of change beside the paper's in the same colours, and the errors against the truth.
pub fn drawing(document: &PaperDocument) -> Drawing {
    let of_change = [rotation_changes(document), distance_changes(document)];
    let mut placed: Vec<([u32; 2], f64, &Panel)> = Vec::new();
    let truth = [
        errors(document, "rotation error against the truth, deg", 3, |entry| entry.rotation_error_deg),
        errors(document, "translation error against the truth, mm", 2, |entry| entry.translation_error_mm),
    ];
    let mut size = [0, GAP_PX];
    for (panels, is_one_scale) in [(&of_change[0], true), (&of_change[1], true), (&truth, false)] {
        let both = panels[0].largest().max(panels[1].largest());
        let mut left = GAP_PX;
        for panel in panels {
            placed.push(([left, size[1]], if is_one_scale { both } else { panel.largest() }, panel));
            left += panel.size_px()[0] + GAP_PX;
        }
        size[0] = size[0].max(left);
        size[1] += panels[0].size_px()[1].max(panels[1].size_px()[1]) + GAP_PX;
    }
    let mut drawing = Drawing::new(size, PAPER);
    placed.iter().for_each(|(at, largest, panel)| panel.draw(&mut drawing, *at, *largest));
    drawing
}

fn rotation_changes(document: &PaperDocument) -> [Panel; 2] {
    let all = &document.rotation_changes;
    let ours = all.iter().map(|change| (change.distance_cm, change.step_deg, worst(change.error_deg)));
    let paper = all.iter().map(|change| (change.distance_cm, change.step_deg, change.paper_deg));
    [("this program, worst room", ours.collect()), ("paper", paper.collect::<Vec<_>>())]
        .map(|(whose, cells)| stepped(format!("change of rotation, deg: {whose}"), "cm", (cells, 2)))
}

fn distance_changes(document: &PaperDocument) -> [Panel; 2] {
    let all = &document.distance_changes;
    let ours = all.iter().map(|change| (change.angle_deg, change.step_cm, worst(change.error_mm)));
    let paper = all.iter().map(|change| (change.angle_deg, change.step_cm, change.paper_mm));
    [("this program, worst room", ours.collect()), ("paper", paper.collect::<Vec<_>>())]
        .map(|(whose, cells)| stepped(format!("change of distance, mm: {whose}"), "deg", (cells, 1)))
}

/// A step of one setting while the other is fixed: fixed setting, step, error.
type StepCell = (u32, [u32; 2], Option<f64>);

fn stepped(title: String, unit: &str, (cells, digits): (Vec<StepCell>, usize)) -> Panel {
    let first = cells.first().map(|cell| cell.0);
    let columns = cells.iter().take_while(|cell| Some(cell.0) == first);
    let columns = columns.map(|(_, [from, to], _)| format!("{from}->{to}")).collect();
    let rows = cells.chunk_by(|a, b| a.0 == b.0).rev();
    let rows =
        rows.map(|row| (format!("{} {unit}", row[0].0), row.iter().map(|cell| cell.2).collect())).collect();
    Panel { title, columns, rows, digits }
}

fn errors(
    document: &PaperDocument,
    title: &str,
    digits: usize,
    of: impl Fn(&super::document::ConfigurationEntry) -> Option<Spread>,
) -> Panel {
    let mut all: Vec<_> = document.configurations.iter().collect();
    // Stable: angles stay in order within each distance.
    all.sort_by_key(|entry| std::cmp::Reverse(entry.distance_cm));
    let by_distance = || all.chunk_by(|a, b| a.distance_cm == b.distance_cm);
    let columns = by_distance().next().unwrap_or_default();
    Panel {
        title: title.to_owned(),
        columns: columns.iter().map(|entry| format!("{} deg", entry.angle_deg)).collect(),
        rows: by_distance()
            .map(|row| {
                (format!("{} cm", row[0].distance_cm), row.iter().map(|entry| worst(of(entry))).collect())
            })
            .collect(),
        digits,
    }
}

fn worst(spread: Option<Spread>) -> Option<f64> {
    spread.map(|spread| spread.worst)
}

/// The colour of an error as a share of the largest.
fn color(share: f64) -> Rgb {
    let place = share.clamp(0.0, 1.0) * (SCALE.len() - 1) as f64;
    let below = (place as usize).min(SCALE.len() - 2);
    let between = place - below as f64;
    std::array::from_fn(|channel| {
        let [from, to] = [SCALE[below], SCALE[below + 1]].map(|color| f64::from(color[channel]));
        (from + between * (to - from)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_errors_are_darker() {
        let brightness = |share| color(share).iter().map(|&value| u32::from(value)).sum::<u32>();
        let all: Vec<u32> = (0..=20).map(|step| brightness(f64::from(step) / 20.0)).collect();
        assert!(all.windows(2).all(|two| two[1] < two[0]), "{all:?}");
        assert_eq!(color(7.0), SCALE[3]);
    }
}
