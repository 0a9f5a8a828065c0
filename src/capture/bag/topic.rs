//! Names of the topics under which librealsense records, as far as they are needed.

/// What the messages of a topic are about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Topic {
    /// Name, serial and firmware of a device.
    Device {
        /// Number of the device in the bag.
        device: u32,
    },
    /// Metres per depth count of a sensor's images.
    DepthUnit {
        /// Number of the device in the bag.
        device: u32,
        /// Number of the sensor in the device.
        sensor: u32,
    },
    /// Something about a stream of images.
    Image {
        /// Number of the device in the bag.
        device: u32,
        /// Number of the sensor in the device.
        sensor: u32,
        /// Which images.
        stream: Stream,
        /// What of them.
        part: Part,
    },
    /// Samples of a device's gyro.
    Gyro {
        /// Number of the device in the bag.
        device: u32,
    },
    /// Samples of a device's accelerometer.
    Accel {
        /// Number of the device in the bag.
        device: u32,
    },
    /// How a device's accelerometer is turned, seen from what all extrinsics of this group refer to.
    AccelExtrinsics {
        /// Number of the device in the bag.
        device: u32,
        /// Number of the group.
        group: u32,
    },
}

/// Streams of images; others, as infrared, are passed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stream {
    /// Depth counts.
    Depth,
    /// Colour.
    Color,
}

/// What is recorded about a stream of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Rate and format.
    Info,
    /// Intrinsics.
    CameraInfo,
    /// Where the stream's imager stands, seen from the one that all extrinsics of this group refer to.
    Extrinsics {
        /// Number of the group.
        group: u32,
    },
    /// Pixels.
    Data,
    /// Names and values that belong to the image before.
    Metadata,
}

impl Topic {
    /// The topic of this name; `None` where it does not matter.
    pub(super) fn parse(name: &str) -> Option<Self> {
        let mut parts = name.strip_prefix('/')?.split('/');
        let device = number(parts.next()?, "device_")?;
        let rest: Vec<&str> = parts.collect();
        match *rest.as_slice() {
            ["info"] => Some(Self::Device { device }),
            [sensor, "option", "Depth_Units" | "Depth Units", "value"] => {
                Some(Self::DepthUnit { device, sensor: number(sensor, "sensor_")? })
            }
            [_, "Gyro_0", "imu", "data"] => Some(Self::Gyro { device }),
            [_, "Accel_0", "imu", "data"] => Some(Self::Accel { device }),
            [_, "Accel_0", "tf", group] => Some(Self::AccelExtrinsics { device, group: group.parse().ok()? }),
            [sensor, stream, ref part @ ..] => {
                let stream = match stream {
                    "Depth_0" => Stream::Depth,
                    "Color_0" => Stream::Color,
                    _ => return None,
                };
                let part = match *part {
                    ["info"] => Part::Info,
                    ["info", "camera_info"] => Part::CameraInfo,
                    ["tf", group] => Part::Extrinsics { group: group.parse().ok()? },
                    ["image", "data"] => Part::Data,
                    ["image", "metadata"] => Part::Metadata,
                    _ => return None,
                };
                Some(Self::Image { device, sensor: number(sensor, "sensor_")?, stream, part })
            }
            _ => None,
        }
    }
}

fn number(part: &str, prefix: &str) -> Option<u32> {
    part.strip_prefix(prefix)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_that_count_are_told_from_all_others() {
        let image = |stream, part| Some(Topic::Image { device: 2, sensor: 1, stream, part });
        for (name, topic) in [
            ("/device_0/info", Some(Topic::Device { device: 0 })),
            ("/device_2/sensor_1/option/Depth_Units/value", Some(Topic::DepthUnit { device: 2, sensor: 1 })),
            ("/device_2/sensor_1/Color_0/image/data", image(Stream::Color, Part::Data)),
            ("/device_2/sensor_1/Color_0/info", image(Stream::Color, Part::Info)),
            ("/device_2/sensor_1/Depth_0/info/camera_info", image(Stream::Depth, Part::CameraInfo)),
            ("/device_2/sensor_1/Depth_0/tf/1", image(Stream::Depth, Part::Extrinsics { group: 1 })),
            ("/device_2/sensor_1/Depth_0/image/metadata", image(Stream::Depth, Part::Metadata)),
            ("/device_1/sensor_2/Gyro_0/imu/data", Some(Topic::Gyro { device: 1 })),
            ("/device_1/sensor_2/Accel_0/imu/data", Some(Topic::Accel { device: 1 })),
            ("/device_1/sensor_2/Accel_0/tf/0", Some(Topic::AccelExtrinsics { device: 1, group: 0 })),
            ("/device_1/sensor_2/Accel_0/info", None),
            ("/device_2/sensor_1/Infrared_1/image/data", None),
            ("/device_x/sensor_1/Color_0/image/data", None),
            ("/device_2/sensor_1/Depth_0/tf/99999999999", None),
            ("/file_version", None),
            ("", None),
        ] {
            assert_eq!(Topic::parse(name), topic, "{name}");
        }
    }
}
