//! What `pelical match` tells people.

use std::fmt::Write as _;

use super::matching::{Counts, MatchDocument, MatchTiming};
use super::text::table;
use crate::cli::matching::score::Tally;

/// The document as text, ending with a line break.
pub fn text(document: &MatchDocument) -> String {
    let header = [
        "set",
        "pair",
        "segments",
        "lifted",
        "shared",
        "matches",
        "right",
        "wrong",
        "unjudged",
        "precision",
        "recall",
    ];
    let mut rows = Vec::new();
    for set in &document.sets {
        for pair in &set.pairs {
            let name = format!("{} <- {}", pair.target, pair.source);
            rows.push(row([set.set.to_string(), name], &pair.counts));
        }
    }
    rows.push(row(["all".to_owned(), String::new()], &document.counts));
    let mut text = table(&header, &rows);
    let MatchTiming { detect, lift, describe, matching } = document.timing_ms;
    let per_image = 1.0 / document.counts.images.max(1) as f64;
    let _ = writeln!(
        text,
        "\n{}; an image: detect {:.2} ms, lift {:.2} ms, describe {:.2} ms; a frame set: match {:.1} ms",
        document.association,
        detect * per_image,
        lift * per_image,
        describe * per_image,
        matching / document.sets.len().max(1) as f64
    );
    text
}

/// One line about a frame set, for its picture.
pub fn title(document: &MatchDocument, set: usize) -> String {
    let mut title = format!("{}, frame set {set}, {}", document.recording, document.association);
    let Some(entry) = document.sets.iter().find(|entry| entry.set == set) else { return title };
    let _ = write!(title, ": {} matches", entry.counts.matches);
    if let Some(Tally { shared, shared_found, right, wrong, unjudged }) = entry.counts.truth {
        let _ = write!(title, ", {right} right, {wrong} wrong, {unjudged} not to be judged");
        let _ = write!(title, "; {shared_found} of {shared} shared edges found");
    }
    title
}

fn row(names: [String; 2], counts: &Counts) -> Vec<String> {
    let of_truth = |count: fn(Tally) -> usize| {
        counts.truth.map_or_else(|| "-".to_owned(), |truth| count(truth).to_string())
    };
    let share = |share: Option<f64>| share.map_or_else(|| "-".to_owned(), |share| format!("{share:.2}"));
    let cells = [
        counts.segments.to_string(),
        counts.lifted.to_string(),
        of_truth(|truth| truth.shared),
        counts.matches.to_string(),
        of_truth(|truth| truth.right),
        of_truth(|truth| truth.wrong),
        of_truth(|truth| truth.unjudged),
        share(counts.precision()),
        share(counts.recall()),
    ];
    [names.to_vec(), cells.to_vec()].concat()
}
