//! Source files as the rules read them: comments, literals and test modules blanked, lines kept; and the paths named in them.
//!
//! Reads text, not meaning: macros are not expanded and `use ... as` is not followed.

use std::fs;
use std::path::Path;

/// A text file of the package.
pub struct TextFile {
    /// As seen from the package, with `/`.
    pub path: String,
    /// As it is.
    pub text: String,
}

impl TextFile {
    /// Whether it holds tests and nothing else.
    pub fn is_test(&self) -> bool {
        self.path.starts_with("tests/") || self.path.ends_with("/tests.rs") || self.path.contains("/tests/")
    }

    /// What the compiler sees of it outside tests; empty for a file of tests.
    pub fn code(&self) -> String {
        if self.is_test() { String::new() } else { without_test_modules(&without_comments(&self.text)) }
    }
}

/// A file or every file below a folder of the package, by path; what is not text is left out.
pub fn files(path: &str) -> Vec<TextFile> {
    let mut found = Vec::new();
    collect(&Path::new(env!("CARGO_MANIFEST_DIR")).join(path), path, &mut found);
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

fn collect(place: &Path, path: &str, found: &mut Vec<TextFile>) {
    if let Ok(entries) = fs::read_dir(place) {
        for entry in entries.map(|entry| entry.expect("a folder that can be read")) {
            let name = entry.file_name().into_string().expect("a name in UTF-8");
            collect(&entry.path(), &format!("{path}/{name}"), found);
        }
    } else if let Ok(text) = fs::read_to_string(place) {
        found.push(TextFile { path: path.to_owned(), text });
    }
}

/// The same text with comments, strings and characters blanked; lines stay where they are.
pub fn without_comments(text: &str) -> String {
    let (mut code, mut rest) = (String::with_capacity(text.len()), text);
    while !rest.is_empty() {
        let (length, is_code) = piece(rest);
        let (now, later) = rest.split_at(length);
        if is_code {
            code.push_str(now)
        } else {
            code.push_str(&blank(now))
        }
        rest = later;
    }
    code
}

fn blank(text: &str) -> String {
    text.chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect()
}

/// Length of the first piece of the text, and whether it is code.
fn piece(rest: &str) -> (usize, bool) {
    if rest.starts_with("//") {
        return (rest.find('\n').unwrap_or(rest.len()), false);
    }
    if rest.starts_with("/*") {
        return (block_comment(rest), false);
    }
    if let Some(length) = raw_string(rest).or_else(|| string(rest)).or_else(|| character(rest)) {
        return (length, false);
    }
    let word = rest.find(|c: char| !is_word(c)).unwrap_or(rest.len());
    (word.max(rest.chars().next().map_or(0, char::len_utf8)), true)
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn block_comment(rest: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < rest.len() {
        let step = match &rest[at..] {
            open if open.starts_with("/*") => {
                depth += 1;
                2
            }
            close if close.starts_with("*/") => {
                depth -= 1;
                2
            }
            other => other.chars().next().map_or(1, char::len_utf8),
        };
        at += step;
        if depth == 0 {
            break;
        }
    }
    at
}

fn raw_string(rest: &str) -> Option<usize> {
    let prefix = ["r", "br", "cr"].into_iter().find(|prefix| {
        rest.strip_prefix(prefix).is_some_and(|tail| tail.trim_start_matches('#').starts_with('"'))
    })?;
    let hashes = rest[prefix.len()..].len() - rest[prefix.len()..].trim_start_matches('#').len();
    let end = format!("\"{}", "#".repeat(hashes));
    let body = prefix.len() + hashes + 1;
    Some(rest[body..].find(&end).map_or(rest.len(), |at| body + at + end.len()))
}

fn string(rest: &str) -> Option<usize> {
    let start = ["\"", "b\"", "c\""].into_iter().find(|start| rest.starts_with(start))?;
    Some(closed_by('"', rest, start.len()))
}

/// A character, as opposed to a lifetime.
fn character(rest: &str) -> Option<usize> {
    let body = rest.strip_prefix('\'')?;
    let is_character = body.starts_with('\\') || body.chars().nth(1) == Some('\'');
    is_character.then(|| closed_by('\'', rest, 1))
}

fn closed_by(quote: char, rest: &str, from: usize) -> usize {
    let mut is_escaped = false;
    for (at, c) in rest[from..].char_indices() {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            _ if c == quote => return from + at + 1,
            _ => {}
        }
    }
    rest.len()
}

/// The same code with every item behind `#[cfg(test)]` blanked.
pub fn without_test_modules(code: &str) -> String {
    const MARK: &str = "#[cfg(test)]";
    let (mut kept, mut rest) = (String::with_capacity(code.len()), code);
    while let Some(at) = rest.find(MARK) {
        let end = at + item_length(&rest[at..]);
        kept.push_str(&rest[..at]);
        kept.push_str(&blank(&rest[at..end]));
        rest = &rest[end..];
    }
    kept.push_str(rest);
    kept
}

/// Up to the end of the first block, or to the first semicolon before any block.
fn item_length(item: &str) -> usize {
    let mut depth = 0;
    for (at, c) in item.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 && (c == ';' || c == '}') {
            return at + 1;
        }
    }
    item.len()
}

/// A word of code and the line it stands on, from 1.
pub struct Word<'a> {
    /// One identifier, `::`, or any other single character.
    pub text: &'a str,
    /// Line.
    pub line: usize,
}

/// All words of code.
pub fn words(code: &str) -> Vec<Word<'_>> {
    let (mut found, mut rest, mut line) = (Vec::new(), code, 1);
    while let Some(first) = rest.chars().next() {
        let word = rest.find(|c: char| !is_word(c)).unwrap_or(rest.len());
        let length = if rest.starts_with("::") { 2 } else { word.max(first.len_utf8()) };
        let (text, later) = rest.split_at(length);
        line += usize::from(first == '\n');
        if !first.is_whitespace() {
            found.push(Word { text, line });
        }
        rest = later;
    }
    found
}

/// A path such as `crate::solver::State`, without its root, and its line.
pub type NamedPath = (Vec<String>, usize);

/// Every path that starts with `root`; groups in braces are spread out.
pub fn paths(code: &str, root: &str) -> Vec<NamedPath> {
    let words = words(code);
    let mut found = Vec::new();
    for at in 0..words.len() {
        let starts = words[at].text == root && text(&words, at + 1) == "::";
        if starts && (at == 0 || words[at - 1].text != "::") {
            let (branches, _) = branches(&words, at + 2);
            found.extend(branches.into_iter().map(|path| (path, words[at].line)));
        }
    }
    found
}

fn text<'a>(words: &[Word<'a>], at: usize) -> &'a str {
    words.get(at).map_or("", |word| word.text)
}

/// The paths of a use tree that starts at a word, and the first word behind it.
fn branches(words: &[Word<'_>], at: usize) -> (Vec<Vec<String>>, usize) {
    if text(words, at) == "{" {
        let (mut found, mut next) = (Vec::new(), at + 1);
        while !matches!(text(words, next), "}" | "") {
            let (branch, behind) = branches(words, next);
            found.extend(branch);
            next = behind + usize::from(text(words, behind) == ",").max(usize::from(behind == next));
        }
        return (found, next + 1);
    }
    if !text(words, at).starts_with(is_word) {
        return (vec![Vec::new()], at);
    }
    let first = text(words, at).to_owned();
    let (tails, next) =
        if text(words, at + 1) == "::" { branches(words, at + 2) } else { (vec![Vec::new()], at + 1) };
    let joined = tails.into_iter().map(|tail| [vec![first.clone()], tail].concat());
    (joined.collect(), next)
}
