//! Why a camera that is there does not open: because it refuses what is asked of it, or because it fails. The difference decides
//! whether a reset may help.

use crate::capture::CaptureError;

/// Words of the SDK, in lower case, by which another program or the system refuses; `Last Error` of its V4L2 back end is strerror(3), its
/// USB back end tells its own status.
const REFUSALS: [&str; 4] = ["resource busy", "status_busy", "permission denied", "status_access"];

/// Why a camera does not open, in a sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Obstacle {
    /// It stays so, whatever is tried from here.
    Refusal(String),
    /// It may go away.
    Failure(String),
}

impl Obstacle {
    /// What the SDK said when it was asked for something.
    pub fn told(what: impl ToString) -> Self {
        let what = what.to_string();
        let words = what.to_lowercase();
        if REFUSALS.iter().any(|refusal| words.contains(refusal)) {
            let cure = "another program has the camera, or this one may not use it: `pelical doctor`";
            return Self::Refusal(format!("{what} ({cure})"));
        }
        Self::Failure(what)
    }

    /// The same with what it is about in front.
    #[must_use]
    pub fn about(self, thing: &str) -> Self {
        match self {
            Self::Refusal(what) => Self::Refusal(format!("{thing}: {what}")),
            Self::Failure(what) => Self::Failure(format!("{thing}: {what}")),
        }
    }

    /// The sentence.
    pub fn sentence(&self) -> &str {
        let (Self::Refusal(what) | Self::Failure(what)) = self;
        what
    }

    /// As an error of the camera with this serial number.
    pub fn of(self, serial: &str) -> CaptureError {
        match self {
            Self::Refusal(what) => CaptureError::Refused { serial: serial.to_owned(), what },
            Self::Failure(what) => CaptureError::device(serial, what),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_has_or_guards_a_camera_refuses_and_everything_else_is_a_failure() {
        for what in [
            "xioctl(VIDIOC_S_FMT) failed, errno=16 Last Error: Device or resource busy",
            "failed to claim usb interface: 0, error: RS2_USB_STATUS_BUSY",
            "Cannot open '/dev/video2 Last Error: Permission denied",
            "failed to open usb interface: 0, error: RS2_USB_STATUS_ACCESS",
        ] {
            assert!(matches!(Obstacle::told(what).of("12"), CaptureError::Refused { .. }), "{what}");
        }
        for what in [
            "xioctl(VIDIOC_S_FMT) failed, errno=5 Last Error: Input/output error",
            "failed to set power state",
            "hwmon command 0x4f( 5 0 0 0 ) failed",
        ] {
            assert!(matches!(Obstacle::told(what).of("12"), CaptureError::Device { .. }), "{what}");
        }
    }

    #[test]
    fn the_sentence_says_what_it_is_about() {
        let obstacle = Obstacle::Refusal("its lens is not known".to_owned()).about("colour");
        assert_eq!(obstacle.sentence(), "colour: its lens is not known");
        assert_eq!(obstacle.of("12").to_string(), "camera 12: colour: its lens is not known");
    }
}
