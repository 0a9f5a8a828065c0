//! From the pixels of a message to those of a frame.
//!
//! An image is used only when it is whole and of the size that its intrinsics promise.

use super::message::Image;
use crate::geometry::Camera;

/// Depth as the SDK names it, and as ROS does.
const DEPTH_ENCODINGS: [&str; 3] = ["mono16", "16UC1", "Z16"];

/// How colour is stored.
#[derive(Debug, Clone, Copy)]
enum Layout {
    /// Bytes per pixel, and where red, green and blue are.
    Interleaved(usize, [usize; 3]),
    /// Two pixels share their chroma: where y0, u, y1 and v are.
    Yuv422([usize; 4]),
}

/// Copies a depth image, row by row.
pub(super) fn read_depth(image: &Image<'_>, camera: &Camera, depth: &mut Vec<u16>) -> Result<(), String> {
    if !DEPTH_ENCODINGS.contains(&image.encoding) || image.is_bigendian {
        let order = if image.is_bigendian { ", big-endian" } else { "" };
        return Err(format!(
            "depth is stored as \"{}\"{order}; 16 bit, little-endian, is allowed: {}",
            image.encoding,
            DEPTH_ENCODINGS.join(", ")
        ));
    }
    depth.clear();
    for row in rows(image, camera, 2)? {
        depth.extend(row.as_chunks().0.iter().map(|count| u16::from_le_bytes(*count)));
    }
    Ok(())
}

/// Converts a colour image to RGB, row by row.
pub(super) fn read_color(image: &Image<'_>, camera: &Camera, rgb: &mut Vec<u8>) -> Result<(), String> {
    let layout = match image.encoding {
        "rgb8" => Layout::Interleaved(3, [0, 1, 2]),
        "bgr8" => Layout::Interleaved(3, [2, 1, 0]),
        "rgba8" => Layout::Interleaved(4, [0, 1, 2]),
        "bgra8" => Layout::Interleaved(4, [2, 1, 0]),
        "YUYV" | "yuv422_yuy2" => Layout::Yuv422([0, 1, 2, 3]),
        "UYVY" | "yuv422" => Layout::Yuv422([1, 0, 3, 2]),
        other => {
            return Err(format!(
                "colour is stored as \"{other}\"; rgb8, bgr8, rgba8, bgra8, YUYV and UYVY are allowed: record with one of them"
            ));
        }
    };
    rgb.clear();
    match layout {
        Layout::Interleaved(3, [0, 1, 2]) => {
            rows(image, camera, 3)?.for_each(|row| rgb.extend_from_slice(row))
        }
        Layout::Interleaved(size, order) => {
            for row in rows(image, camera, size)? {
                let channel = |pixel: &[u8], at: usize| pixel.get(at).copied().unwrap_or_default();
                rgb.extend(row.chunks_exact(size).flat_map(|pixel| order.map(|at| channel(pixel, at))));
            }
        }
        Layout::Yuv422(order) => {
            if !camera.width_px().is_multiple_of(2) {
                return Err(format!(
                    "an image of {} px width cannot be stored in pairs of pixels",
                    camera.width_px()
                ));
            }
            for row in rows(image, camera, 2)? {
                rgb.extend(row.as_chunks().0.iter().flat_map(|pair| two_pixels(pair, order)));
            }
        }
    }
    Ok(())
}

/// The rows of an image without the bytes between them.
fn rows<'a>(
    image: &Image<'a>,
    camera: &Camera,
    pixel_bytes: usize,
) -> Result<impl Iterator<Item = &'a [u8]> + use<'a>, String> {
    let Image { width_px, height_px, stride, data, .. } = *image;
    if (width_px, height_px) != (camera.width_px(), camera.height_px()) {
        return Err(format!(
            "an image has {width_px} x {height_px} px; its camera has {} x {}",
            camera.width_px(),
            camera.height_px()
        ));
    }
    let (row_bytes, height) = (width_px as usize * pixel_bytes, height_px as usize);
    let is_whole = stride >= row_bytes && stride.checked_mul(height).is_some_and(|bytes| bytes <= data.len());
    if !is_whole {
        return Err(format!(
            "an image of {width_px} x {height_px} px has {} bytes, {stride} from row to row; {row_bytes} are needed for each row",
            data.len()
        ));
    }
    Ok(data.chunks_exact(stride).take(height).filter_map(move |row| row.get(..row_bytes)))
}

/// BT.601 with headroom, as the SDK converts.
fn two_pixels(pair: &[u8; 4], order: [usize; 4]) -> [u8; 6] {
    let [y0, u, y1, v] = order.map(|at| i32::from(pair.get(at).copied().unwrap_or_default()));
    let (d, e) = (u - 128, v - 128);
    let pixel = |y: i32| {
        let c = 298 * (y - 16) + 128;
        [c + 409 * e, c - 100 * d - 208 * e, c + 516 * d].map(|value| (value >> 8).clamp(0, 255) as u8)
    };
    let ([r0, g0, b0], [r1, g1, b1]) = (pixel(y0), pixel(y1));
    [r0, g0, b0, r1, g1, b1]
}
