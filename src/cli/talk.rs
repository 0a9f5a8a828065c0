//! What the programs say to people, on stderr. Nobody has to listen: a closed stderr is no reason to fail.

use std::fmt::Display;
use std::io::Write;

/// Says a line.
pub fn say(line: impl Display) {
    // `eprintln!` would panic where stderr is a pipe whose reader has gone, as in `pelical watch 2>&1 | head -1`.
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}
