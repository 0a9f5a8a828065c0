//! Which cameras are left out of a list, and why: told once, however often the list is asked for.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Serial numbers and the reason that was told last.
#[derive(Debug, Default)]
pub struct LeftOut(Mutex<BTreeMap<String, String>>);

impl LeftOut {
    /// Notes why a camera is left out now, or `None` where it is not; whether there is something new to tell.
    pub fn is_news(&self, serial: &str, reason: Option<&str>) -> bool {
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if told.get(serial).map(String::as_str) == reason {
            return false;
        }
        match reason {
            Some(reason) => told.insert(serial.to_owned(), reason.to_owned()),
            None => told.remove(serial),
        };
        reason.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_is_told_once_and_again_when_the_camera_was_fine_meanwhile() {
        let left_out = LeftOut::default();
        for (reason, is_news) in [
            (None, false),
            (Some("no colour"), true),
            (Some("no colour"), false),
            (Some("no lens"), true),
            (None, false),
            (Some("no lens"), true),
        ] {
            assert_eq!(left_out.is_news("12", reason), is_news, "{reason:?}");
        }
        assert!(left_out.is_news("13", Some("no lens")), "another camera");
    }
}
