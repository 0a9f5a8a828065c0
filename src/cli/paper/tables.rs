//! The document as tables, for the terminal and for the page.

use std::fmt::Write as _;

use super::document::{ConfigurationEntry, MetricsEntry, PaperDocument};
use super::grid::Spread;
use crate::cli::output::text;

/// A table with its title.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    title: String,
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// For the terminal.
    pub fn as_text(&self) -> String {
        let header: Vec<&str> = self.header.iter().map(String::as_str).collect();
        format!("{}\n{}", self.title, text::table(&header, &self.rows))
    }

    /// For the page.
    pub fn as_markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let mut markdown = format!("## {}\n\n{}", self.title, line(&self.header));
        let _ = writeln!(markdown, "|{}", " --- |".repeat(self.header.len()));
        self.rows.iter().for_each(|row| markdown += &line(row));
        markdown
    }
}

/// All tables, in the paper's order.
pub fn all(document: &PaperDocument) -> Vec<Table> {
    let mut tables = vec![rotation_changes(document), distance_changes(document)];
    tables.push(errors(document));
    tables.push(convergence(document));
    if !document.stereo.is_empty() {
        tables.push(stereo(document));
    }
    tables
}

/// What the whole comes to, in three sentences.
pub fn summary(document: &PaperDocument) -> String {
    let worst = &document.worst;
    let of_paper = "paper 1.208 deg and 13.9 mm";
    format!(
        "{} of {} trials converged, {} with a wrong converged solution at any time (0.5 deg or 15 mm).\n\
         Worst error of change {} deg and {} mm ({of_paper}).\n\
         Worst error against the truth {} deg and {} mm.\n",
        document.converged,
        document.trials,
        document.wrong,
        number(worst.rotation_change_deg, 3),
        number(worst.distance_change_mm, 2),
        number(worst.rotation_error_deg, 3),
        number(worst.translation_error_mm, 2),
    )
}

fn rotation_changes(document: &PaperDocument) -> Table {
    let cells = document.rotation_changes.iter().map(|change| Cell {
        row: change.distance_cm,
        column: change.step_deg,
        text: beside_paper(change.error_deg, change.paper_deg, 3),
    });
    let title = format!("Error of the change of rotation, deg: {}", form(document));
    stepped(title, cells.collect(), ("distance", "cm"))
}

fn distance_changes(document: &PaperDocument) -> Table {
    let cells = document.distance_changes.iter().map(|change| Cell {
        row: change.angle_deg,
        column: change.step_cm,
        text: beside_paper(change.error_mm, change.paper_mm, 2),
    });
    let title = format!("Error of the change of distance, mm: {}", form(document));
    stepped(title, cells.collect(), ("angle", "deg"))
}

fn form(document: &PaperDocument) -> String {
    format!("{} (paper)", over_rooms(document))
}

fn over_rooms(document: &PaperDocument) -> String {
    let rooms = if document.seeds == 1 { "room" } else { "rooms" };
    format!("median / worst of {} {rooms}", document.seeds)
}

/// One cell of a table of steps.
struct Cell {
    row: u32,
    column: [u32; 2],
    text: String,
}

/// As in the paper, the largest fixed setting comes first.
fn stepped(title: String, cells: Vec<Cell>, (fixed, unit): (&str, &str)) -> Table {
    let mut rows: Vec<u32> = cells.iter().map(|cell| cell.row).collect();
    rows.dedup();
    let columns: Vec<[u32; 2]> =
        cells.iter().take_while(|cell| Some(&cell.row) == rows.first()).map(|cell| cell.column).collect();
    let step = |[from, to]: &[u32; 2]| format!("{from} -> {to}");
    let row = |fixed: &u32| {
        let texts = cells.iter().filter(|cell| cell.row == *fixed).map(|cell| cell.text.clone());
        std::iter::once(format!("{fixed} {unit}")).chain(texts).collect()
    };
    Table {
        title,
        header: std::iter::once(fixed.to_owned()).chain(columns.iter().map(step)).collect(),
        rows: rows.iter().rev().map(row).collect(),
    }
}

fn errors(document: &PaperDocument) -> Table {
    let cell = |entry: &ConfigurationEntry| {
        format!("{} deg, {} mm", spread(entry.rotation_error_deg, 3), spread(entry.translation_error_mm, 2))
    };
    by_configuration(format!("Error against the truth: {}", over_rooms(document)), document, cell)
}

fn convergence(document: &PaperDocument) -> Table {
    let cell = |entry: &ConfigurationEntry| {
        let percent = entry.converged_share.map(|share| 100.0 * share);
        format!("{} %, {}", number(percent, 0), spread(entry.sets_until_converged, 0))
    };
    let title = format!(
        "Converged after {} frame sets, and frame sets until the first converged solution: median / worst",
        document.sets
    );
    by_configuration(title, document, cell)
}

fn by_configuration(
    title: String,
    document: &PaperDocument,
    cell: impl Fn(&ConfigurationEntry) -> String,
) -> Table {
    let all = &document.configurations;
    let mut angles: Vec<u32> = all.iter().map(|entry| entry.angle_deg).collect();
    angles.dedup();
    let mut distances: Vec<u32> = all.iter().map(|entry| entry.distance_cm).collect();
    distances.sort_unstable();
    distances.dedup();
    let row = |distance: &u32| {
        let cells = all.iter().filter(|entry| entry.distance_cm == *distance).map(&cell);
        std::iter::once(format!("{distance} cm")).chain(cells).collect()
    };
    let angle = |angle: &u32| format!("{angle} deg");
    Table {
        title,
        header: std::iter::once("distance".to_owned()).chain(angles.iter().map(angle)).collect(),
        rows: distances.iter().rev().map(row).collect(),
    }
}

fn stereo(document: &PaperDocument) -> Table {
    let mut rows = Vec::new();
    for entry in &document.stereo {
        let baseline = format!("{} cm", entry.baseline_cm);
        let measured = |name: &str, metrics: &MetricsEntry| {
            let MetricsEntry { l_mm, d_mm, theta_deg } = *metrics;
            vec![baseline.clone(), name.to_owned(), spread(l_mm, 3), spread(d_mm, 2), spread(theta_deg, 3)]
        };
        rows.push(measured("this program", &entry.estimated));
        rows.push(measured("true extrinsics", &entry.exact));
        rows.extend(entry.paper.iter().map(|paper| {
            let figures = [paper.l, paper.d, paper.theta].map(|figure| format!("{figure:.2}"));
            [vec![baseline.clone(), format!("paper: {}", paper.method)], figures.to_vec()].concat()
        }));
    }
    Table {
        title: format!("Stereo experiment: {}", over_rooms(document)),
        header: ["baseline", "extrinsics", "l, mm", "d, mm", "theta, deg"].map(str::to_owned).to_vec(),
        rows,
    }
}

fn beside_paper(ours: Option<Spread>, paper: Option<f64>, digits: usize) -> String {
    match paper {
        Some(paper) => format!("{} ({paper:.digits$})", spread(ours, digits)),
        None => spread(ours, digits),
    }
}

fn spread(value: Option<Spread>, digits: usize) -> String {
    value.map_or_else(
        || "-".to_owned(),
        |Spread { median, worst }| format!("{median:.digits$} / {worst:.digits$}"),
    )
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}
