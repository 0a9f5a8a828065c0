//! Which options of the SDK follow from ours, and setting them before a camera streams.

use realsense_rust::kind::Rs2Option;

use super::options::RealsenseOptions;
use super::raw::DeviceSensor;

/// Values of the inter-camera synchronisation.
const SYNC_MASTER: f32 = 1.0;
const SYNC_SLAVE: f32 = 2.0;

/// One option of the SDK.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Setting {
    option: Rs2Option,
    value: f32,
    /// What for, in words.
    purpose: &'static str,
}

/// Sets what the options ask for on every sensor that has it; what no sensor has is told.
pub(super) fn apply(sensors: &[DeviceSensor], options: &RealsenseOptions, serial: &str) {
    for Setting { option, value, purpose } in settings(options, serial) {
        let mut is_set = false;
        for sensor in sensors {
            let mut sensor = sensor.options();
            let Some(range) = sensor.get_option_range(option) else { continue };
            let value = value.clamp(range.min, range.max.max(range.min));
            if sensor.get_option(option) == Some(value) {
                is_set = true;
                continue;
            }
            match sensor.set_option(option, value) {
                Ok(()) => is_set = true,
                Err(error) => tracing::warn!(serial, ?option, value, "cannot set {purpose}: {error}"),
            }
        }
        if !is_set {
            tracing::warn!(serial, ?option, "this camera cannot set {purpose}: it stays as it is");
        }
    }
}

fn settings(options: &RealsenseOptions, serial: &str) -> Vec<Setting> {
    let flag = |is_on: bool| f32::from(u8::from(is_on));
    let mut settings = vec![
        Setting {
            option: Rs2Option::GlobalTimeEnabled,
            value: flag(options.global_time),
            purpose: "cameras.realsense.global_time",
        },
        // Else a dark room halves the rate of colour without a word.
        Setting {
            option: Rs2Option::AutoExposurePriority,
            value: 0.0,
            purpose: "that the exposure must not slow the stream down",
        },
    ];
    if let Some(emitter) = options.emitter {
        let purpose = "cameras.realsense.emitter";
        settings.push(Setting { option: Rs2Option::EmitterEnabled, value: flag(emitter), purpose });
    }
    if let Some(limit) = options.max_exposure {
        let purpose = "cameras.realsense.max_exposure_ms";
        let limit_us = limit.as_secs_f32() * 1e6;
        settings.push(Setting { option: Rs2Option::AutoExposureLimitToggle, value: 1.0, purpose });
        settings.push(Setting { option: Rs2Option::AutoExposureLimit, value: limit_us, purpose });
    }
    if let Some(master) = &options.sync_master {
        let value = if master == serial { SYNC_MASTER } else { SYNC_SLAVE };
        let purpose = "cameras.realsense.sync_master";
        settings.push(Setting { option: Rs2Option::InterCamSyncMode, value, purpose });
    }
    settings
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn value(options: &RealsenseOptions, serial: &str, option: Rs2Option) -> Option<f32> {
        settings(options, serial).into_iter().find(|set| set.option == option).map(|set| set.value)
    }

    #[test]
    fn what_is_not_asked_for_stays_as_it_is() {
        let options = RealsenseOptions { emitter: None, ..RealsenseOptions::default() };
        for option in [Rs2Option::EmitterEnabled, Rs2Option::AutoExposureLimit, Rs2Option::InterCamSyncMode] {
            assert_eq!(value(&options, "1", option), None, "{option:?}");
        }
        assert_eq!(value(&options, "1", Rs2Option::GlobalTimeEnabled), Some(1.0));
    }

    #[test]
    fn one_camera_is_the_master_and_the_others_follow() {
        let options = RealsenseOptions { sync_master: Some("12".into()), ..RealsenseOptions::default() };
        assert_eq!(value(&options, "12", Rs2Option::InterCamSyncMode), Some(SYNC_MASTER));
        assert_eq!(value(&options, "012", Rs2Option::InterCamSyncMode), Some(SYNC_SLAVE));
    }

    #[test]
    fn limits_and_switches_are_in_the_units_of_the_sdk() {
        let options = RealsenseOptions {
            emitter: Some(false),
            max_exposure: Some(Duration::from_micros(8_500)),
            global_time: false,
            ..RealsenseOptions::default()
        };
        assert_eq!(value(&options, "1", Rs2Option::EmitterEnabled), Some(0.0));
        assert_eq!(value(&options, "1", Rs2Option::AutoExposureLimitToggle), Some(1.0));
        assert_eq!(value(&options, "1", Rs2Option::AutoExposureLimit), Some(8_500.0));
        assert_eq!(value(&options, "1", Rs2Option::GlobalTimeEnabled), Some(0.0));
    }
}
