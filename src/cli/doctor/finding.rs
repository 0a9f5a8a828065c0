//! What `pelical doctor` says: findings, each with its grade, and where something is wrong its cause and its cure.

use serde::Serialize;

use crate::cli::output::text::table;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// As it should be, or of no matter here.
    Ok,
    /// Works, but worse than it could, or may stop working.
    Warning,
    /// Does not work.
    Problem,
}

impl Grade {
    fn name(self) -> &'static str {
        match self {
            Grade::Ok => "ok",
            Grade::Warning => "warning",
            Grade::Problem => "PROBLEM",
        }
    }
}

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Which check: one of a closed list.
    pub check: &'static str,
    /// How bad it is.
    pub grade: Grade,
    /// What was found.
    pub finding: String,
    /// Why that is so, or why it matters; null where nothing is wrong.
    pub cause: Option<String>,
    /// What to do; null where nothing is wrong.
    pub cure: Option<String>,
}

impl Finding {
    /// As it should be.
    pub fn ok(check: &'static str, finding: impl Into<String>) -> Self {
        Self { check, grade: Grade::Ok, finding: finding.into(), cause: None, cure: None }
    }

    /// Worse than it could be: cause and cure.
    pub fn warning(
        check: &'static str,
        finding: impl Into<String>,
        (cause, cure): (impl Into<String>, impl Into<String>),
    ) -> Self {
        let (cause, cure) = (Some(cause.into()), Some(cure.into()));
        Self { check, grade: Grade::Warning, finding: finding.into(), cause, cure }
    }

    /// Does not work: cause and cure.
    pub fn problem(
        check: &'static str,
        finding: impl Into<String>,
        why: (impl Into<String>, impl Into<String>),
    ) -> Self {
        Self { grade: Grade::Problem, ..Self::warning(check, finding, why) }
    }
}

/// `pelical.doctor/1`.
#[derive(Debug, Serialize)]
pub struct DoctorDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// The worst grade of all findings.
    pub grade: Grade,
    /// In the order of the checks.
    pub findings: Vec<Finding>,
}

impl DoctorDocument {
    /// The document of findings.
    pub fn new(findings: Vec<Finding>) -> Self {
        let grade = findings.iter().map(|finding| finding.grade).max().unwrap_or(Grade::Ok);
        Self { schema: "pelical.doctor/1", grade, findings }
    }

    /// For people: all findings, then causes and cures, ending with a line break.
    pub fn text(&self) -> String {
        let row = |finding: &Finding| {
            vec![finding.grade.name().to_owned(), finding.check.to_owned(), finding.finding.clone()]
        };
        let mut text =
            table(&["grade", "check", "finding"], &self.findings.iter().map(row).collect::<Vec<_>>());
        for finding in self.findings.iter().filter(|finding| finding.grade > Grade::Ok) {
            let [cause, cure] =
                [&finding.cause, &finding.cure].map(|text| text.as_deref().unwrap_or_default());
            text += &format!(
                "\n{}: {}: {}\n  cause: {cause}\n  cure:  {cure}\n",
                finding.grade.name(),
                finding.check,
                finding.finding
            );
        }
        let count = |grade| self.findings.iter().filter(|finding| finding.grade == grade).count();
        text + &format!("\n{} problems, {} warnings\n", count(Grade::Problem), count(Grade::Warning))
    }
}
