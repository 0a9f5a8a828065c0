//! The rules. Each takes text and returns what is wrong with it, one sentence a finding; an empty list is a pass.

use crate::source::{NamedPath, TextFile, paths, words};

/// Who may use whom: a module and what it may name of this crate besides itself; `bin` stands for the two programs.
pub const USES: [(&str, &[&str]); 12] = [
    ("geometry", &[]),
    ("image", &["geometry"]),
    ("lines", &["geometry", "image"]),
    ("learned", &["geometry", "image"]),
    ("solver", &["geometry"]),
    ("capture", &["geometry", "image"]),
    ("pipeline", &["geometry", "image", "lines", "learned", "solver", "capture"]),
    ("ipc", &["geometry", "solver"]),
    ("store", &["geometry", "solver"]),
    ("service", &["geometry", "lines", "learned", "solver", "capture", "pipeline", "ipc", "store"]),
    (
        "cli",
        &[
            "geometry",
            "learned",
            "solver",
            "capture",
            "pipeline",
            "ipc",
            "service::config",
            "service::ServiceError",
        ],
    ),
    ("bin", &["service", "cli"]),
];

/// What is pure: modules, and single files of others.
pub const PURE: [&str; 7] = [
    "src/geometry/",
    "src/image/",
    "src/lines/",
    "src/solver/",
    "src/pipeline/matcher.rs",
    "src/pipeline/motion/",
    "src/service/state.rs",
];

/// Parts of `std` that reach outside.
const OUTSIDE: [&str; 7] = ["fs", "thread", "net", "env", "io", "process", "os"];

/// Words that no pure code needs: clocks, talk, globals, locks, an order that differs from run to run, files.
const IMPURE: [&str; 19] = [
    "Instant",
    "SystemTime",
    "println",
    "eprintln",
    "eprint",
    "dbg",
    "tracing",
    "Mutex",
    "RwLock",
    "OnceLock",
    "OnceCell",
    "LazyLock",
    "LazyCell",
    "thread_local",
    "HashMap",
    "HashSet",
    "RandomState",
    "serde",
    "crossbeam_channel",
];

/// Longest file, lines.
pub const MAX_LINES: usize = 500;

/// `src/solver/rig.rs` is in `solver`; the library's own root is in nothing.
fn module(path: &str) -> Option<&str> {
    let inside = path.strip_prefix("src/")?;
    let first = inside.split('/').next()?;
    let module = first.strip_suffix(".rs").unwrap_or(first);
    (module != "lib").then_some(module)
}

/// Uses of modules that the table does not allow.
pub fn uses(file: &TextFile) -> Vec<String> {
    if file.is_test() {
        return Vec::new();
    }
    let Some(module) = module(&file.path) else { return Vec::new() };
    let Some((_, allowed)) = USES.iter().find(|(name, _)| *name == module) else {
        return vec![format!("{}: the module '{module}' is not in the table who-may-use-whom", file.path)];
    };
    let root = if module == "bin" { "pelical" } else { "crate" };
    let is_allowed = |path: &[String]| {
        path.first().is_none_or(|first| first == module)
            || allowed.iter().any(|allowed| {
                let parts: Vec<&str> = allowed.split("::").collect();
                path.len() >= parts.len() && path.iter().zip(&parts).all(|(a, b)| a == b)
            })
    };
    let tell = |(path, line): NamedPath| {
        let path = path.join("::");
        format!("{}:{line}: {module} uses {path}; allowed: {}", file.path, allowed.join(", "))
    };
    paths(&file.code(), root).into_iter().filter(|(path, _)| !is_allowed(path)).map(tell).collect()
}

/// Ways around the table: `super::super`, and `super::` in the root of a module.
pub fn detours(file: &TextFile) -> Vec<String> {
    let code = file.code();
    let words = words(&code);
    let is = |at: usize, text: &str| words.get(at).is_some_and(|word| word.text == text);
    let is_module_root = file.path.ends_with("/mod.rs") && file.path.matches('/').count() == 2;
    let mut found = Vec::new();
    for (at, word) in words.iter().enumerate() {
        if word.text != "super" || !is(at + 1, "::") {
            continue;
        }
        if is(at + 2, "super") {
            found.push(format!("{}:{}: super::super; name the module from crate::", file.path, word.line));
        } else if is_module_root {
            found.push(format!("{}:{}: super:: is the crate here; write crate::", file.path, word.line));
        }
    }
    found
}

/// Whether a file is held to be pure.
pub fn is_pure(file: &TextFile) -> bool {
    PURE.iter().any(|pure| file.path.starts_with(pure))
}

/// What makes code impure.
pub fn impurities(file: &TextFile) -> Vec<String> {
    let code = file.code();
    let tell = |what: &str, line: usize| format!("{}:{line}: {what} in a pure module", file.path);
    let outside = paths(&code, "std").into_iter().filter_map(|(path, line)| {
        let first = path.first()?;
        OUTSIDE.contains(&first.as_str()).then(|| tell(&format!("std::{first}"), line))
    });
    let words = words(&code);
    let named = words.iter().filter(|word| IMPURE.contains(&word.text) || word.text.starts_with("Atomic"));
    let named = named.map(|word| tell(word.text, word.line));
    let globals = words.windows(2).filter(|pair| pair[0].text == "static" && pair[1].text == "mut");
    let globals = globals.map(|pair| tell("static mut", pair[0].line));
    outside.chain(named).chain(globals).collect()
}

/// Calls that end the program where a message is due, but for those whose clippy lint is switched off for a reason just above.
pub fn panics(file: &TextFile) -> Vec<String> {
    let code = file.code();
    let lines: Vec<&str> = file.text.lines().collect();
    let has_reason = |line: usize| {
        lines[line.saturating_sub(3)..line].iter().any(|above| above.contains("_used, reason = "))
    };
    let words = words(&code);
    let is = |at: usize, texts: &[&str]| words.get(at).is_some_and(|word| texts.contains(&word.text));
    let panics = |at: usize| {
        let is_call = is(at, &["."]) && is(at + 1, &["unwrap", "expect"]) && is(at + 2, &["("]);
        is_call || is(at, &["todo", "unimplemented", "panic"]) && is(at + 1, &["!"])
    };
    let tell = |at: usize| {
        let what = if words[at].text == "." { words[at + 1].text } else { words[at].text };
        let line = words[at].line;
        format!("{}:{line}: {what} outside tests; return an Option, an outcome or an error", file.path)
    };
    (0..words.len()).filter(|&at| panics(at) && !has_reason(words[at].line)).map(tell).collect()
}

/// `#[allow(...)]` and `#[expect(...)]` without `reason = ` inside or a comment on the same line or above.
pub fn unreasoned_allows(file: &TextFile) -> Vec<String> {
    let code = crate::source::without_comments(&file.text);
    let lines: Vec<&str> = file.text.lines().collect();
    let starts = ["#[allow(", "#![allow(", "#[expect(", "#![expect("];
    let starts = starts.iter().flat_map(|start| code.match_indices(start)).map(|(at, _)| at);
    let mut found = Vec::new();
    for at in starts {
        let line = code[..at].matches('\n').count();
        let attribute = &code[at..at + code[at..].find(']').unwrap_or(0)];
        let above = line.checked_sub(1).map_or("", |above| lines[above].trim_start());
        let has_comment = lines[line].contains("//") || above.starts_with("//");
        if !attribute.contains("reason") && !has_comment {
            let line = line + 1;
            found.push(format!("{}:{line}: a lint is switched off without a reason beside it", file.path));
        }
    }
    found
}

/// Files that are too long.
pub fn too_long(file: &TextFile) -> Vec<String> {
    let lines = file.text.lines().count();
    let tell =
        || format!("{}: {lines} lines, at most {MAX_LINES}; move a part into a file of its own", file.path);
    (lines > MAX_LINES).then(tell).into_iter().collect()
}

/// Paths that exist on one machine only. Put together here so that this file does not name them.
const MACHINE_PATHS: [&str; 3] = [concat!("/", "work"), concat!("/", "root"), concat!("/", "home")];

/// Hosts of package registries, likewise.
const HOSTS: [&str; 5] = [
    concat!("crates", ".io"),
    concat!("pypi", ".org"),
    concat!("npmjs", ".com"),
    concat!("debian", ".org"),
    concat!("docker", ".io"),
];

/// What ties a text to one machine or one registry.
pub fn places(file: &TextFile) -> Vec<String> {
    let mut found = Vec::new();
    for (index, line) in file.text.lines().enumerate() {
        let named = HOSTS.iter().filter(|host| line.contains(**host));
        let named = named.chain(MACHINE_PATHS.iter().filter(|path| names_path(line, path)));
        found.extend(named.map(|place| format!("{}:{}: names {place}", file.path, index + 1)));
    }
    found
}

/// Whether an absolute path stands in the line, not the middle of a relative one or of a longer name.
fn names_path(line: &str, path: &str) -> bool {
    line.match_indices(path).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let behind = line[at + path.len()..].chars().next();
        let continues = |c: char| c.is_alphanumeric() || "._-~})>".contains(c);
        !before.is_some_and(continues) && !behind.is_some_and(|c| c.is_alphanumeric() || c == '_')
    })
}

/// Dependencies in Cargo.toml without a comment line above.
pub fn unexplained_dependencies(manifest: &str) -> Vec<String> {
    let (mut found, mut is_dependencies, mut above) = (Vec::new(), false, "");
    for line in manifest.lines() {
        if let Some(section) = line.strip_prefix('[') {
            is_dependencies = section.trim_end_matches(']').ends_with("dependencies");
        } else if is_dependencies
            && line.starts_with(|c: char| c.is_alphanumeric())
            && !above.starts_with('#')
        {
            found.push(format!("Cargo.toml: no comment above '{line}' says why it is needed"));
        }
        above = line;
    }
    found
}

/// Parts of the tree that ARCHITECTURE.md does not name, and lines of the table that it tells otherwise.
pub fn untold(architecture: &str, parts: &[String]) -> Vec<String> {
    let missing = parts.iter().filter(|part| !architecture.contains(&format!("`{part}`")));
    let missing = missing.map(|part| format!("ARCHITECTURE.md does not name `{part}`"));
    let told: Vec<String> =
        architecture.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
    let table = USES.iter().map(|(module, allowed)| {
        let allowed = if allowed.is_empty() { "nothing".to_owned() } else { allowed.join(", ") };
        format!("{module} -> {allowed}")
    });
    let other = table.filter(|line| !told.contains(line));
    let other = other.map(|line| format!("ARCHITECTURE.md lacks the line '{line}' in who may use whom"));
    missing.chain(other).collect()
}

/// Commands that the first screen of the README does not show.
pub fn first_screen(readme: &str) -> Vec<String> {
    let screen: Vec<&str> = readme.lines().take(25).map(str::trim).collect();
    let lacks = ["cargo run --release -- demo", "cargo test"].into_iter().filter(|command| {
        !screen.iter().any(|line| line.split("  ").next().is_some_and(|start| start.trim() == *command))
    });
    lacks.map(|command| format!("README.md does not show '{command}' in its first 25 lines")).collect()
}
