//! Whether a YAML text is nested too deep to be parsed: the parser looks at every open bracket again for each word, so that a file of
//! 200 kB of brackets would take it half a minute.

/// Deepest nesting of `[` and `{`; our own files have three levels.
const MAX_DEPTH: usize = 64;

/// The line (counted from 1) at which brackets are nested too deep. Brackets in quotes count too; whole-line comments do not.
pub fn too_deep(text: &str) -> Option<usize> {
    let mut depth = 0usize;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with('#'));
    for (index, line) in lines {
        for byte in line.bytes() {
            match byte {
                b'[' | b'{' => depth += 1,
                b']' | b'}' => depth = depth.saturating_sub(1),
                _ => {}
            }
            if depth > MAX_DEPTH {
                return Some(index + 1);
            }
        }
    }
    None
}

/// What is wrong with such a text.
pub fn sentence() -> String {
    format!("brackets are nested deeper than {MAX_DEPTH} levels")
}

/// The text itself unless it is nested too deep.
///
/// # Errors
/// Says so, with the line.
pub fn checked(text: &str) -> Result<&str, String> {
    match too_deep(text) {
        Some(line) => Err(format!("{} at line {line}", sentence())),
        None => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_counts_and_length_does_not() {
        assert_eq!(too_deep(&"[1, {a: 2}]\n".repeat(10_000)), None);
        assert_eq!(too_deep(&format!("# {}\na: 1\n", "[".repeat(1000))), None);
        assert_eq!(too_deep(&format!("a: 1\nb: {}\n", "[".repeat(MAX_DEPTH))), None);
        assert_eq!(too_deep(&format!("a: 1\nb: {}\n", "[{".repeat(MAX_DEPTH))), Some(2));
    }
}
