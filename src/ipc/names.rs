//! What things are called in shared memory: the instance of the daemon and its services.
//!
//! A service is `pelical/<instance>/v3/<topic>`; a change of meaning of any payload gets a new version in the name, so that old
//! and new programs do not see each other instead of misreading each other.

use std::fmt;
use std::str::FromStr;

/// Longest instance name, bytes.
const MAX_INSTANCE_BYTES: usize = 32;

/// Which daemon of this machine: 1 to 32 of `a-z 0-9 _ -`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InstanceName(String);

/// Why an instance name was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("instance name '{name}' is not usable: 1 to 32 of a-z, 0-9, _ and - are allowed")]
pub struct InstanceNameError {
    /// What was given.
    pub name: String,
}

impl InstanceName {
    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The full name of one of this instance's services.
    pub(super) fn service(&self, topic: Topic) -> String {
        format!("pelical/{}/v{}/{}", self.0, super::wire::VERSION, topic.name())
    }
}

impl Default for InstanceName {
    /// The instance of a machine that runs one daemon only.
    fn default() -> Self {
        Self("default".to_owned())
    }
}

impl FromStr for InstanceName {
    type Err = InstanceNameError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let allowed = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'_' || c == b'-';
        if (1..=MAX_INSTANCE_BYTES).contains(&name.len()) && name.bytes().all(allowed) {
            Ok(Self(name.to_owned()))
        } else {
            Err(InstanceNameError { name: name.to_owned() })
        }
    }
}

impl fmt::Display for InstanceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The services of one instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Topic {
    /// The newest calibration.
    Calibration,
    /// How collecting goes.
    Progress,
    /// How the daemon and its cameras are.
    Health,
    /// Requests to the daemon and its answers.
    Control,
    /// Questions for older calibrations and the answers.
    Archive,
    /// Event: the daemon published or answered.
    News,
    /// Event: a client joined or asked.
    Calls,
}

impl Topic {
    fn name(self) -> &'static str {
        match self {
            Topic::Calibration => "calibration",
            Topic::Progress => "progress",
            Topic::Health => "health",
            Topic::Control => "control",
            Topic::Archive => "archive",
            Topic::News => "news",
            Topic::Calls => "calls",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_instance_name_keeps_to_its_alphabet_and_length() {
        for good in ["a", "default", "left_arm-2", &"x".repeat(32)] {
            assert_eq!(good.parse::<InstanceName>().expect(good).as_str(), good);
        }
        for bad in ["", "A", "a b", "a/b", "ä", "a.b", "..", &"x".repeat(33)] {
            let error = bad.parse::<InstanceName>().expect_err(bad);
            assert_eq!(error.name, bad);
        }
    }

    #[test]
    fn a_service_name_carries_instance_and_version() {
        let instance: InstanceName = "left_arm".parse().expect("allowed");
        assert_eq!(instance.service(Topic::Calibration), "pelical/left_arm/v3/calibration");
    }
}
