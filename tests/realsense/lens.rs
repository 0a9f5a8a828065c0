//! Lenses are held to the SDK: what a pixel and a ray are to it, they are here.
#![allow(unsafe_code, reason = "calls two functions of the SDK")]

use pelical::capture::realsense::lens::{Intrinsics, camera};
use pelical::geometry::PixelPoint;
use pelical::geometry::camera::{Pinhole, RayPoint};
use realsense_sys as sys;

const SIZE: (u32, u32) = (640, 480);
const PINHOLE: [f32; 4] = [382.5, 381.75, 321.25, 239.5];
/// As a D455 tells them.
const COEFFS: [f32; 5] = [-0.0565, 0.0682, 0.0004, 0.0007, -0.0218];

fn of_the_sdk(model: u32, coeffs: [f32; 5]) -> sys::rs2_intrinsics {
    let [fx, fy, ppx, ppy] = PINHOLE;
    sys::rs2_intrinsics { width: 640, height: 480, ppx, ppy, fx, fy, model, coeffs }
}

unsafe extern "C" {
    fn rs2_project_point_to_pixel(pixel: *mut f32, lens: *const sys::rs2_intrinsics, point: *const f32);
    fn rs2_deproject_pixel_to_point(
        point: *mut f32,
        lens: *const sys::rs2_intrinsics,
        pixel: *const f32,
        depth: f32,
    );
}

#[test]
fn every_supported_lens_projects_and_deprojects_as_the_sdk_does() {
    let [fx_px, fy_px, cx_px, cy_px] = PINHOLE.map(f64::from);
    let pinhole = Pinhole { fx_px, fy_px, cx_px, cy_px };
    for (model, coeffs) in [(0, [0.0; 5]), (1, COEFFS), (2, COEFFS), (4, COEFFS)] {
        let theirs = of_the_sdk(model, coeffs);
        let ours =
            camera(&Intrinsics { size_px: SIZE, pinhole, model, coeffs: coeffs.map(f64::from) }).unwrap();
        for step in 0..300u16 {
            let (x, y) = (f32::from(step % 20) * 33.0, f32::from(step / 20) * 34.0);
            let ray = ours.ray_from_pixel(PixelPoint { x: x.into(), y: y.into() });
            let (point, mut pixel) = ([ray.x as f32, ray.y as f32, 1.0], [0.0f32; 2]);
            // SAFETY: arrays as long as the functions read and write.
            unsafe { rs2_project_point_to_pixel(pixel.as_mut_ptr(), &theirs, point.as_ptr()) };
            let miss_px = (pixel[0] - x).hypot(pixel[1] - y);
            assert!(miss_px < 0.02, "model {model}: ({x}, {y}) is {pixel:?} to the SDK");
            if model == 1 {
                // The SDK cannot deproject it.
                continue;
            }
            let mut back = [0.0f32; 3];
            // SAFETY: as above.
            unsafe { rs2_deproject_pixel_to_point(back.as_mut_ptr(), &theirs, [x, y].as_ptr(), 1.0) };
            let shown = ours.pixel_from_ray(RayPoint { x: back[0].into(), y: back[1].into() });
            let miss_px = (shown.x - f64::from(x)).hypot(shown.y - f64::from(y));
            assert!(miss_px < 0.1, "model {model}: the SDK's ray of ({x}, {y}) is seen at {shown:?}");
        }
    }
}
