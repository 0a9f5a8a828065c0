//! The rules of the tree as tests. `rules` says what is wrong with a text, `planted` proves that each rule finds what it is
//! there to find, and the tests here apply the rules to this package.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "clippy's leave for tests stops at #[test]"
)]

mod planted;
mod rules;
mod source;

use std::collections::BTreeSet;

use source::{TextFile, files};

/// Where Rust is written by hand.
const RUST: [&str; 4] = ["src", "tests", "benches", "examples"];
/// What else is written by hand; generated and fetched things are left out.
const TEXTS: [&str; 20] = [
    ".ci",
    ".dockerignore",
    ".gitignore",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "Cargo.toml",
    "Dockerfile",
    "LICENSE-APACHE",
    "LICENSE-MIT",
    "README.md",
    "clippy.toml",
    "config",
    "docs",
    "packaging",
    "rustfmt.toml",
    "scripts",
    "systemd",
    "tests/package",
    "tests/vm",
    "udev",
];

fn rust_files(folders: &[&str]) -> Vec<TextFile> {
    let found = folders.iter().flat_map(|folder| files(folder));
    found.filter(|file| file.path.ends_with(".rs")).collect()
}

fn text(path: &str) -> String {
    files(path).pop().unwrap_or_else(|| panic!("{path} is missing")).text
}

#[track_caller]
fn check(rule: fn(&TextFile) -> Vec<String>, files: &[TextFile]) {
    assert!(!files.is_empty(), "no file to check: is this the package's root?");
    none(&files.iter().flat_map(rule).collect::<Vec<_>>());
}

#[track_caller]
fn none(findings: &[String]) {
    assert!(findings.is_empty(), "{} finding(s):\n  {}", findings.len(), findings.join("\n  "));
}

#[test]
fn modules_use_only_what_the_table_allows() {
    check(rules::uses, &rust_files(&["src"]));
}

#[test]
fn no_path_leads_around_the_table() {
    check(rules::detours, &rust_files(&["src"]));
}

#[test]
fn pure_modules_know_no_files_clocks_threads_logs_or_globals() {
    let pure: Vec<TextFile> = rust_files(&["src"]).into_iter().filter(rules::is_pure).collect();
    for place in rules::PURE {
        assert!(pure.iter().any(|file| file.path.starts_with(place)), "{place} is gone: correct the list");
    }
    check(rules::impurities, &pure);
}

#[test]
fn nothing_outside_tests_unwraps_or_panics() {
    check(rules::panics, &rust_files(&["src", "examples"]));
}

#[test]
fn every_switched_off_lint_has_its_reason() {
    check(rules::unreasoned_allows, &rust_files(&RUST));
}

#[test]
fn no_file_is_longer_than_five_hundred_lines() {
    let files = rust_files(&RUST);
    let mut lengths: Vec<usize> = files.iter().map(|file| file.text.lines().count()).collect();
    lengths.sort_unstable();
    let (n, longest) = (lengths.len(), lengths.last().copied().unwrap_or(0));
    println!("{n} files of Rust, median {} lines, longest {longest}", lengths[n / 2]);
    check(rules::too_long, &files);
}

#[test]
fn no_text_names_a_folder_of_one_machine_or_a_registry() {
    let texts: Vec<TextFile> = RUST.iter().chain(&TEXTS).flat_map(|path| files(path)).collect();
    check(rules::places, &texts);
}

#[test]
fn every_dependency_says_why_it_is_needed() {
    none(&rules::unexplained_dependencies(&text("Cargo.toml")));
}

#[test]
fn the_architecture_names_every_module_and_folder_and_the_same_table() {
    let mut parts = BTreeSet::new();
    for file in rust_files(&["src"]).iter().filter(|file| !file.is_test()) {
        let inside = file.path.trim_start_matches("src/").to_owned();
        let folder = inside.rsplit_once('/').map(|(folder, _)| folder.to_owned());
        parts.insert(folder.unwrap_or_else(|| inside.trim_end_matches(".rs").to_owned()));
    }
    let parts: Vec<String> = parts.into_iter().filter(|part| part != "lib").collect();
    none(&rules::untold(&text("ARCHITECTURE.md"), &parts));
}

#[test]
fn the_first_screen_of_the_readme_shows_the_two_commands() {
    none(&rules::first_screen(&text("README.md")));
}
