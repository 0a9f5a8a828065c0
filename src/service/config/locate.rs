//! Finds the line of a key in the text of a YAML file, so that an error about a value can name its place.
//!
//! Reads block style by its indentation. Where a part of the path is absent or in flow style (`{a: 1}`), the line of the
//! innermost part that was found is the answer, which is the line to look at.

/// One step of a dotted path.
enum Step<'a> {
    Key(&'a str),
    Index(usize),
}

/// One line with content.
#[derive(Clone, Copy)]
struct Line<'a> {
    number: usize,
    indent: usize,
    content: &'a str,
}

/// The line (counted from 1) of a dotted path such as `cameras.list[1].serial`.
pub fn line_of(text: &str, path: &str) -> usize {
    block_of(text, path).0
}

/// The line (counted from 1) at which a key stands for the second time in the section of a dotted path; an empty path is the
/// whole file. `None` in flow style.
pub fn second_line_of(text: &str, section: &str, key: &str) -> Option<usize> {
    let (_, block) = block_of(text, section);
    let indent = block.first()?.indent;
    let entries = block.iter().filter(|line| line.indent == indent && line.is_entry_of(key));
    entries.map(|line| line.number).nth(1)
}

/// The innermost part of a dotted path that was found: its line and what is in it.
fn block_of<'a>(text: &'a str, path: &str) -> (usize, Vec<Line<'a>>) {
    let mut block: Vec<Line<'_>> = content_lines(text);
    let mut found = block.first().map_or(1, |line| line.number);
    for step in steps(path) {
        let inner = match step {
            Step::Key(key) => value_of_key(&block, key),
            Step::Index(index) => nth_item(&block, index),
        };
        let Some((line, inner)) = inner else { break };
        found = line;
        block = inner;
    }
    (found, block)
}

impl Line<'_> {
    /// Whether it says `key: ...`, the key in quotes or not.
    fn is_entry_of(&self, key: &str) -> bool {
        let (found, value) = match self.content.strip_prefix(['"', '\'']) {
            Some(quoted) => quoted.split_once(['"', '\'']).unwrap_or_default(),
            None => self.content.split_once(':').map_or(("", ""), |(found, _)| (found.trim_end(), ":")),
        };
        found == key && value.trim_start().starts_with(':')
    }
}

fn steps(path: &str) -> Vec<Step<'_>> {
    let parts = path.split(['.', '[']).filter(|part| !part.is_empty());
    parts
        .map(|part| match part.strip_suffix(']').and_then(|index| index.parse().ok()) {
            Some(index) => Step::Index(index),
            None => Step::Key(part),
        })
        .collect()
}

fn content_lines(text: &str) -> Vec<Line<'_>> {
    let lines = text.lines().enumerate().map(|(index, line)| {
        let content = line.trim_start();
        Line { number: index + 1, indent: line.len() - content.len(), content }
    });
    lines.filter(|line| !line.content.is_empty() && !line.content.starts_with(['#', '%'])).collect()
}

/// The line of `key:` among the entries of a block, and the lines of its value.
fn value_of_key<'a>(block: &[Line<'a>], key: &str) -> Option<(usize, Vec<Line<'a>>)> {
    let indent = block.first()?.indent;
    let is_entry = |line: &Line<'_>| line.indent == indent && line.is_entry_of(key);
    let start = block.iter().position(is_entry)?;
    // A sequence may stand as deep as its own key.
    let is_inner =
        |line: &&Line<'_>| line.indent > indent || (line.indent == indent && line.content.starts_with("- "));
    let inner = block[start + 1..].iter().take_while(is_inner).copied().collect();
    Some((block[start].number, inner))
}

/// The line of item `index` of a sequence, and the lines of the item without its dash.
fn nth_item<'a>(block: &[Line<'a>], index: usize) -> Option<(usize, Vec<Line<'a>>)> {
    let indent = block.first()?.indent;
    let is_item = |line: &Line<'_>| line.indent == indent && line.content.starts_with("- ");
    let (start, first) = block.iter().enumerate().filter(|(_, line)| is_item(line)).nth(index)?;
    let content = first.content[1..].trim_start();
    let opened = Line { number: first.number, indent: indent + first.content.len() - content.len(), content };
    let rest = block[start + 1..].iter().take_while(|line| line.indent > indent).copied();
    Some((first.number, std::iter::once(opened).chain(rest).collect()))
}

#[cfg(test)]
mod tests {
    use super::line_of;

    const TEXT: &str = "# head\nlog:\n  level: info\ncameras:\n  backend: replay\n  list:\n    - name: a\n      serial: \"1\"\n\n    - serial: \"2\" # second\n      name: b\n  flow: {one: 1, two: 2}\nsync:\n  level: 3\ntight:\n- x: 1\n- x: 2\n";

    #[track_caller]
    fn check_line(path: &str, expected: usize) {
        assert_eq!(line_of(TEXT, path), expected, "{path}");
    }

    #[test]
    fn a_key_is_found_in_its_own_section() {
        check_line("log.level", 3);
        check_line("sync.level", 14);
        check_line("cameras", 4);
    }

    #[test]
    fn items_of_sequences_are_counted() {
        check_line("cameras.list[0].name", 7);
        check_line("cameras.list[0].serial", 8);
        check_line("cameras.list[1].serial", 10);
        check_line("cameras.list[1].name", 11);
        check_line("tight[1].x", 17);
    }

    #[test]
    fn what_is_not_there_is_the_line_of_what_it_would_be_in() {
        check_line("cameras.flow.two", 12);
        check_line("cameras.list[7].name", 6);
        check_line("nothing.at.all", 2);
        assert_eq!(line_of("", "a.b"), 1);
    }
}
