//! The table of the campaign: what was done, what was expected, what was seen.

use std::fmt::Write;
use std::time::Duration;

/// What one row has shown.
#[derive(Debug, Default)]
pub struct Seen {
    /// What happened, with its numbers.
    pub parts: Vec<String>,
    /// Time to recover, where that is one time.
    pub recovery: Option<Duration>,
    /// What should not have happened.
    pub failures: Vec<String>,
    /// Why the row could not be tried on this machine.
    pub skipped: Option<String>,
}

impl Seen {
    /// Not tried, and why.
    pub fn skipped(why: impl Into<String>) -> Self {
        Self { skipped: Some(why.into()), ..Self::default() }
    }

    pub fn say(&mut self, part: impl Into<String>) {
        self.parts.push(part.into());
    }

    /// Fails the row unless this holds.
    pub fn require(&mut self, holds: bool, otherwise: impl Into<String>) {
        if !holds {
            self.failures.push(otherwise.into());
        }
    }

    /// The row took this long to recover; the longest counts.
    pub fn recovered(&mut self, took: Duration, limit: Duration) {
        self.recovery = self.recovery.max(Some(took));
        self.require(took <= limit, format!("recovered after {}, allowed are {}", time(took), time(limit)));
    }
}

/// One line of the table.
#[derive(Debug)]
pub struct Row {
    pub fault: String,
    pub expected: String,
    pub seen: Seen,
}

impl Row {
    pub fn verdict(&self) -> &'static str {
        match (&self.seen.skipped, self.seen.failures.is_empty()) {
            (Some(_), _) => "skipped",
            (None, true) => "passed",
            (None, false) => "FAILED",
        }
    }

    /// What was seen, in one line.
    pub fn told(&self) -> String {
        let mut text = match &self.seen.skipped {
            Some(why) => format!("skipped: {why}"),
            None => self.seen.parts.join("; "),
        };
        for failure in &self.seen.failures {
            let _ = write!(text, "; **FAILED: {failure}**");
        }
        text.replace('|', "/").replace('\n', " ")
    }
}

/// People read 0.3 s and 12 ms.
pub fn time(time: Duration) -> String {
    match time.as_secs_f64() {
        s if s >= 10.0 => format!("{s:.0} s"),
        s if s >= 1.0 => format!("{s:.1} s"),
        s => format!("{:.0} ms", s * 1e3),
    }
}

/// The table as Markdown.
pub fn markdown(rows: &[Row]) -> String {
    let mut text = String::from("| fault | expected | seen | time to recover |\n|---|---|---|---|\n");
    for row in rows {
        let recovery = row.seen.recovery.map_or_else(|| "-".to_owned(), time);
        let _ = writeln!(text, "| {} | {} | {} | {recovery} |", row.fault, row.expected, row.told());
    }
    text
}

/// The middle and the worst of some times.
pub fn median_and_worst(times: &[Duration]) -> (Duration, Duration) {
    let mut sorted = times.to_vec();
    sorted.sort();
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
    (median, sorted.last().copied().unwrap_or_default())
}
