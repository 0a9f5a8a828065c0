//! Every rule on text that breaks it, and on its nearest text that does not.

use crate::rules;
use crate::source::{TextFile, without_comments, without_test_modules};

fn file(path: &str, text: &str) -> TextFile {
    TextFile { path: path.to_owned(), text: text.to_owned() }
}

/// The rule finds `n` things wrong with the text as a file of the solver.
#[track_caller]
fn finds(rule: fn(&TextFile) -> Vec<String>, text: &str, n: usize) {
    finds_in("src/solver/planted.rs", rule, text, n);
}

#[track_caller]
fn finds_in(path: &str, rule: fn(&TextFile) -> Vec<String>, text: &str, n: usize) {
    let findings = rule(&file(path, text));
    assert_eq!(findings.len(), n, "{path}: {text}\n{findings:?}");
}

#[test]
fn a_forbidden_use_is_found_alone_in_groups_and_inside_code() {
    finds(rules::uses, "use crate::geometry::motion::Motion;\nuse crate::solver::result::State;", 0);
    finds(rules::uses, "use crate::capture::RgbdFrame;", 1);
    finds(rules::uses, "use crate::{geometry::{camera, motion::Motion}, pipeline::{self, stats}, lines};", 3);
    finds(rules::uses, "fn f() { let a = crate::ipc::names::default(); }", 1);
    finds(rules::uses, "use crate::*;", 0);
}

#[test]
fn an_unknown_module_and_the_wrong_half_of_a_module_are_found() {
    finds_in("src/helpers/mod.rs", rules::uses, "", 1);
    finds_in("src/cli/demo.rs", rules::uses, "use crate::service::config::Config;", 0);
    finds_in("src/cli/demo.rs", rules::uses, "use crate::service::run;", 1);
    finds_in("src/bin/pelicald.rs", rules::uses, "use pelical::{cli::args, service};", 0);
    finds_in("src/bin/pelicald.rs", rules::uses, "use pelical::pipeline::Pipeline;", 1);
}

#[test]
fn comments_strings_and_tests_use_whatever_they_like() {
    finds(
        rules::uses,
        "// crate::capture\n/* crate::ipc /* crate::cli */ */ const A: &str = \"crate::cli\";",
        0,
    );
    finds(rules::uses, "#[cfg(test)]\nmod tests {\n fn f() { use crate::capture; }\n}", 0);
    finds(rules::uses, "#[cfg(test)]\nmod tests;\nuse crate::capture;", 1);
    finds_in("src/solver/residual/tests.rs", rules::uses, "use crate::capture;", 0);
}

#[test]
fn detours_through_super_are_found() {
    finds(rules::detours, "use super::result::State; pub(super) fn f() {}", 0);
    finds(rules::detours, "use super::super::capture;", 1);
    finds_in("src/solver/mod.rs", rules::detours, "use super::capture;", 1);
    finds_in("src/solver/mod.rs", rules::detours, "pub(super) mod a;", 0);
    finds_in("src/ipc/wire/mod.rs", rules::detours, "use super::message;", 0);
}

#[test]
fn every_kind_of_impurity_is_found() {
    let planted = [
        "use std::fs;",
        "use std::{collections::BTreeMap, thread};",
        "let a = std::env::var(b);",
        "let now = Instant::now();",
        "use std::time::SystemTime;",
        "println!();",
        "tracing::info!(a);",
        "static mut COUNT: u32 = 0;",
        "static A: Mutex<u32> = b;",
        "use std::collections::HashMap;",
        "#[derive(serde::Serialize)] struct A;",
        "static N: AtomicU64 = b;",
    ];
    for text in planted {
        finds(rules::impurities, text, 1);
    }
    let pure =
        "use std::collections::BTreeMap;\n/// Instant, std::fs\nstatic NAMES: [&str; 1] = [\"println\"];";
    finds(rules::impurities, pure, 0);
}

#[test]
fn a_panic_outside_tests_is_found() {
    finds(rules::panics, "let a = b.unwrap();", 1);
    finds(rules::panics, "let a = b\n    .expect(\"c\");", 1);
    finds(rules::panics, "todo!()", 1);
    finds(rules::panics, "let a = b.unwrap_or(c).expect_err; // .unwrap()", 0);
    finds(rules::panics, "#[cfg(test)]\nmod tests { fn f() { a.unwrap(); } }", 0);
    finds(rules::panics, "#[allow(clippy::expect_used, reason = \"r\")]\nlet a = b.expect(\"c\");", 0);
}

#[test]
fn a_lint_switched_off_without_reason_is_found() {
    finds(rules::unreasoned_allows, "fn f() {}\n#[allow(dead_code)]\nfn g() {}", 1);
    finds(rules::unreasoned_allows, "#![expect(\n    dead_code,\n)]", 1);
    finds(rules::unreasoned_allows, "#[allow(dead_code, reason = \"d\")]", 0);
    finds(rules::unreasoned_allows, "// Because.\n#[allow(dead_code)]", 0);
    finds(rules::unreasoned_allows, "#[allow(dead_code)] // because", 0);
}

#[test]
fn a_file_one_line_too_long_is_found() {
    finds(rules::too_long, &"\n".repeat(rules::MAX_LINES), 0);
    finds(rules::too_long, &"\n".repeat(rules::MAX_LINES + 1), 1);
}

#[test]
fn paths_of_one_machine_and_hosts_are_found() {
    let (work, home) = (concat!("/", "work"), concat!("/", "home"));
    finds_in("README.md", rules::places, &format!("cd {work}/main"), 1);
    finds_in("README.md", rules::places, &format!("a file in '{home}'"), 1);
    finds_in("README.md", rules::places, &format!("see https://{}", concat!("crates", ".io")), 1);
    finds_in("README.md", rules::places, &format!("../shared{work}, {work}shop, ~{home}"), 0);
}

#[test]
fn a_dependency_without_a_reason_is_found() {
    let good =
        "[package]\nname = \"a\"\n[dependencies]\n# Why.\nserde = \"1\"\n\n# Why.\nb = { version = \"1\" }\n";
    assert_eq!(rules::unexplained_dependencies(good), Vec::<String>::new());
    let bad =
        "[dev-dependencies]\n# Why.\na = \"1\"\nb = \"1\"\n[target.'cfg(unix)'.dependencies]\nc = \"1\"\n";
    assert_eq!(rules::unexplained_dependencies(bad).len(), 2);
}

#[test]
fn a_module_missing_from_the_architecture_is_found() {
    let table = rules::USES.map(|(module, allowed)| {
        let allowed = if allowed.is_empty() { "nothing".to_owned() } else { allowed.join(", ") };
        format!("    {module:10}->   {allowed}\n")
    });
    let good = format!("`solver` and `capture/recording`\n{}", table.concat());
    let parts = ["solver".to_owned(), "capture/recording".to_owned()];
    assert_eq!(rules::untold(&good, &parts), Vec::<String>::new());
    assert_eq!(rules::untold(&good, &["lines".to_owned()]).len(), 1);
    let other_table = good.replace("ipc       ->   geometry, solver", "ipc -> anything");
    assert_eq!(rules::untold(&other_table, &parts).len(), 1);
}

#[test]
fn a_readme_that_hides_a_command_is_found() {
    let good = "# a\n\n    cargo run --release -- demo   # it runs\n    cargo test\n";
    assert_eq!(rules::first_screen(good), Vec::<String>::new());
    assert_eq!(rules::first_screen(&good.replace("-- demo", "-- demo --json")).len(), 1);
    assert_eq!(rules::first_screen(&format!("{}{good}", "\n".repeat(25))).len(), 2);
}

#[test]
fn comments_literals_and_tests_are_blanked_and_lines_stay() {
    let text = "a /* b\n /* c */ d */ e // f\n\"g \\\" h\" r#\"i \" j\"# 'k' '\\'' '{' <'l> m\n";
    let code = without_comments(text);
    let words: Vec<&str> = code.split_whitespace().collect();
    assert_eq!(words, ["a", "e", "<'l>", "m"]);
    assert_eq!(code.matches('\n').count(), text.matches('\n').count());
    let tested = "a;\n#[cfg(test)]\nmod tests { fn b() { c } }\nd;\n#[cfg(test)]\nmod tests;\ne;";
    let code = without_test_modules(tested);
    assert_eq!(code.split_whitespace().collect::<Vec<_>>(), ["a;", "d;", "e;"]);
}
