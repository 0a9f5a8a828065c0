//! The RealSense D400 family as it shows on the bus: which products are cameras that may be used, and what they are called. The udev
//! rules of the package list the same products; a test holds them to this table.
//!
//! Source of the numbers: librealsense's public header `d400-private.h`.

/// USB vendor id of every model.
pub const VENDOR_ID: u16 = 0x8086;

/// One product.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// As people call it.
    pub name: &'static str,
    /// USB product id.
    pub product_id: u16,
    /// Whether it has gyroscope and accelerometer, as further devices of the same USB device.
    pub has_imu: bool,
}

/// Every model, by ascending product id.
pub const MODELS: [Model; 26] = [
    model("D400", 0x0ad1),
    model("D410", 0x0ad2),
    model("D415", 0x0ad3),
    model("D430", 0x0ad4),
    with_imu("D430-tracking", 0x0ad5),
    model("D4xx-USB2", 0x0ad6),
    model("D4xx-recovery", 0x0adb),
    model("D4xx-USB2-recovery", 0x0adc),
    with_imu("D4xx-IMU", 0x0af2),
    model("D420", 0x0af6),
    with_imu("D420-tracking", 0x0afe),
    with_imu("D410-tracking", 0x0aff),
    with_imu("D400-tracking", 0x0b00),
    with_imu("D430-tracking-RGB", 0x0b01),
    model("D460", 0x0b03),
    model("D435", 0x0b07),
    model("D405U", 0x0b0c),
    with_imu("D435i", 0x0b3a),
    model("D416", 0x0b49),
    with_imu("D430i", 0x0b4b),
    model("D416-RGB", 0x0b52),
    model("D405", 0x0b5b),
    with_imu("D455", 0x0b5c),
    model("D421", 0x1155),
    with_imu("D457", 0xabcd),
    model("D457-recovery", 0xbbcd),
];

const fn model(name: &'static str, product_id: u16) -> Model {
    Model { name, product_id, has_imu: false }
}

const fn with_imu(name: &'static str, product_id: u16) -> Model {
    Model { name, product_id, has_imu: true }
}

/// The model with these ids; `None` for every other device.
pub fn find(vendor_id: u16, product_id: u16) -> Option<&'static Model> {
    MODELS.iter().find(|model| (VENDOR_ID, model.product_id) == (vendor_id, product_id))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_product_stands_once_and_is_found() {
        assert!(MODELS.is_sorted_by(|a, b| a.product_id < b.product_id));
        for model in &MODELS {
            assert_eq!(find(0x8086, model.product_id), Some(model));
        }
        assert_eq!(find(0x8086, 0x0b3a).map(|model| (model.name, model.has_imu)), Some(("D435i", true)));
        assert_eq!(find(0x8087, 0x0b3a), None, "another vendor's product");
        assert_eq!(find(0x8086, 0x0b3b), None);
    }
}
