//! What one count of depth is, from the single-precision number of the SDK.

/// m; what was meant by this number: 0.001, not 0.0010000000474974513.
///
/// # Errors
/// When no camera counts so.
pub fn depth_unit_m(told_m: f32) -> Result<f64, String> {
    // The shortest decimal that is this number in single precision.
    let unit_m = told_m.to_string().parse().unwrap_or(f64::from(told_m));
    if !(unit_m > 0.0 && unit_m <= 1.0) {
        return Err(format!("a depth unit of {unit_m} m; above 0 and at most 1 is allowed"));
    }
    Ok(unit_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_decimal_that_was_meant_comes_back_and_nonsense_is_refused() {
        for unit_m in [0.001, 0.0005, 0.0001, 1e-6, 1.0] {
            assert_eq!(depth_unit_m(unit_m as f32), Ok(unit_m));
        }
        for nonsense in [0.0, -0.001, 1.5, f32::NAN, f32::INFINITY] {
            assert!(depth_unit_m(nonsense).is_err(), "{nonsense}");
        }
    }
}
