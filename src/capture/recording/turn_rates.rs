//! `<camera>/turn_rates.csv`: what the camera's gyro said for each frame. It lies beside the layout: readers that do not know it miss
//! nothing but that, and a recording without it is as good.

use std::path::Path;

use super::{MAX_TEXT_BYTES, read_text};
use crate::capture::{CaptureError, StampNs, TurnRate};

/// Name of the file in the camera's folder.
pub(in crate::capture) const FILE: &str = "turn_rates.csv";
/// Its first line.
pub(in crate::capture) const HEADER: &str = "stamp_ns,max_rad_per_s";

/// One line of the file, for a frame.
pub(in crate::capture) fn line(stamp: StampNs, rate: TurnRate) -> String {
    format!("{},{}\n", stamp.0, rate.max_rad_per_s)
}

/// The rates of a camera, stamps increase; empty without the file.
pub(super) fn read(camera_folder: &Path) -> Result<Vec<(StampNs, TurnRate)>, CaptureError> {
    let file = camera_folder.join(FILE);
    let Some(text) = read_text(&file, MAX_TEXT_BYTES)? else { return Ok(Vec::new()) };
    parse(&text).map_err(|what| CaptureError::bad_data(&file, what))
}

fn parse(text: &str) -> Result<Vec<(StampNs, TurnRate)>, String> {
    let mut lines = text.lines().zip(1..);
    match lines.next() {
        Some((HEADER, _)) => {}
        _ => return Err(format!("line 1 must be \"{HEADER}\"")),
    }
    let mut rates: Vec<(StampNs, TurnRate)> = Vec::new();
    for (text, number) in lines {
        let fields =
            text.split_once(',').and_then(|(stamp, rate)| Some((stamp.parse().ok()?, rate.parse().ok()?)));
        let rate = fields.map(|(stamp, max_rad_per_s)| (StampNs(stamp), TurnRate { max_rad_per_s }));
        let rate = rate.filter(|(_, rate)| rate.max_rad_per_s.is_finite() && rate.max_rad_per_s >= 0.0);
        let Some(rate) = rate else {
            return Err(format!(
                "line {number} is {text:?}; allowed is a stamp in ns, a comma, and rad/s, 0 or more"
            ));
        };
        if rates.last().is_some_and(|before| before.0 >= rate.0) {
            return Err(format!("line {number}: stamps out of order; they increase"));
        }
        rates.push(rate);
    }
    Ok(rates)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let rate = |max_rad_per_s| TurnRate { max_rad_per_s };
        let rates = [(StampNs(5), rate(0.0)), (StampNs(7), rate(1.25e-3))];
        let lines: String = rates.iter().map(|(stamp, rate)| line(*stamp, *rate)).collect();
        assert_eq!(parse(&format!("{HEADER}\n{lines}")), Ok(rates.to_vec()));
        assert_eq!(parse(HEADER), Ok(Vec::new()));
    }

    #[test]
    fn a_broken_line_is_named() {
        for (text, part) in [
            ("", "line 1"),
            ("5,1\n", "line 1"),
            ("stamp_ns,max_rad_per_s\n5,1\n6\n", "line 3"),
            ("stamp_ns,max_rad_per_s\n5,-1\n", "line 2"),
            ("stamp_ns,max_rad_per_s\n5,NaN\n", "line 2"),
            ("stamp_ns,max_rad_per_s\n5.5,1\n", "line 2"),
            ("stamp_ns,max_rad_per_s\n5,1\n5,1\n", "line 3"),
        ] {
            let what = parse(text).expect_err(text);
            assert!(what.contains(part), "{what}");
        }
    }
}
