//! Moments and ages, for people and scripts.

/// The machine's clock, ns since 1970; 0 where it stands before that.
pub fn now_ns() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |since| u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}

/// A moment as RFC 3339 in UTC, to the millisecond: `2026-11-22T09:33:29.000Z`.
pub fn utc(ns: u64) -> String {
    let (ms, seconds) = (ns / 1_000_000 % 1000, ns / 1_000_000_000);
    let (year, month, day) = date(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{ms:03}Z")
}

/// The date so many days after 1970-01-01. In years that begin with March the leap day is the last one, and five months have 153
/// days, over and over.
fn date(days: u64) -> (u64, u64, u64) {
    const DAYS_OF_400_YEARS: u64 = 146_097;
    // From 0000-03-01.
    let days = days + 719_468;
    let (era, day_of_era) = (days / DAYS_OF_400_YEARS, days % DAYS_OF_400_YEARS);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (month, is_next_year) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    (400 * era + year_of_era + is_next_year, month, day)
}

/// How long ago, s; `None` when the machine's clock stands before that moment, as without a battery after a start.
pub fn age_s(made_ns: u64, now_ns: u64) -> Option<f64> {
    now_ns.checked_sub(made_ns).map(|age_ns| age_ns as f64 * 1e-9)
}

/// An age in its largest unit: `3 h`.
pub fn age_in_words(age_s: Option<f64>) -> String {
    match age_s {
        None => "of an unknown age: the clock stands before that".to_owned(),
        Some(age) if age < 120.0 => format!("{age:.0} s ago"),
        Some(age) if age < 7_200.0 => format!("{:.0} min ago", age / 60.0),
        Some(age) if age < 172_800.0 => format!("{:.0} h ago", age / 3600.0),
        Some(age) => format!("{:.0} days ago", age / 86_400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00.000Z"),
            (951_782_399, "2000-02-28T23:59:59.000Z"),
            (951_782_400, "2000-02-29T00:00:00.000Z"),
            (1_709_251_199, "2024-02-29T23:59:59.000Z"),
            (1_795_340_009, "2026-11-22T09:33:29.000Z"),
            (4_107_542_400, "2100-03-01T00:00:00.000Z"),
        ] {
            assert_eq!(utc(seconds * 1_000_000_000), text);
        }
        assert_eq!(utc(1_987_654_321), "1970-01-01T00:00:01.987Z");
    }

    #[test]
    fn ages_have_a_unit_and_a_clock_that_went_back_has_none() {
        assert_eq!(age_s(5_000_000_000, 8_500_000_000), Some(3.5));
        assert_eq!(age_s(5, 4), None);
        let words = [90.0, 600.0, 9000.0, 900_000.0].map(|age| age_in_words(Some(age)));
        assert_eq!(words, ["90 s ago", "10 min ago", "2 h ago", "10 days ago"]);
    }
}
