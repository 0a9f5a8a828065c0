//! Image files of a recording: which file belongs to a stamp, and what it may hold.
//!
//! An image is used only when it is whole and of the type and size that `recording.yaml` promises; sizes are compared before
//! anything is decoded, so a forged header cannot make the reader allocate.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{ColorType, ImageDecoder, ImageFormat, ImageReader};

use super::read_file;
use crate::capture::{CaptureError, StampNs};
use crate::geometry::Camera;

/// Folder of a camera's colour images.
pub(in crate::capture) const COLOR_FOLDER: &str = "color";
/// Folder of a camera's depth images.
pub(in crate::capture) const DEPTH_FOLDER: &str = "depth";
/// Bytes a file may have beyond its pixels uncompressed: headers, colour profile, comments.
const MAX_OVERHEAD_BYTES: u64 = 1 << 20;

/// Width and height of a camera's images, px.
pub(super) fn size_px(camera: &Camera) -> (usize, usize) {
    (camera.width_px() as usize, camera.height_px() as usize)
}

/// Reads `color/<stamp>.jpg` or `.png` as 8-bit RGB.
pub(super) fn read_color(
    camera_folder: &Path,
    stamp: StampNs,
    camera: &Camera,
    rgb: &mut Vec<u8>,
) -> Result<(), CaptureError> {
    let folder = camera_folder.join(COLOR_FOLDER);
    let max_bytes = max_file_bytes(camera, 3);
    let jpg = folder.join(format!("{}.jpg", stamp.0));
    let png = jpg.with_extension("png");
    let (file, format, bytes) = match read_file(&jpg, max_bytes)? {
        Some(bytes) => (jpg, ImageFormat::Jpeg, bytes),
        None => match read_file(&png, max_bytes)? {
            Some(bytes) => (png, ImageFormat::Png, bytes),
            None => return Err(missing(&jpg, " or .png")),
        },
    };
    decode(&Source { file: &file, bytes: &bytes, format, camera, wanted: ColorType::Rgb8 }, rgb)
}

/// Reads `depth/<stamp>.png` as 16-bit counts.
pub(super) fn read_depth(
    camera_folder: &Path,
    stamp: StampNs,
    camera: &Camera,
    depth: &mut Vec<u16>,
) -> Result<(), CaptureError> {
    let file = camera_folder.join(DEPTH_FOLDER).join(format!("{}.png", stamp.0));
    let bytes = read_file(&file, max_file_bytes(camera, 2))?.ok_or_else(|| missing(&file, ""))?;
    let source =
        Source { file: &file, bytes: &bytes, format: ImageFormat::Png, camera, wanted: ColorType::L16 };
    let mut counts = Vec::new();
    decode(&source, &mut counts)?;
    depth.clear();
    depth.extend(counts.as_chunks().0.iter().map(|pair| u16::from_ne_bytes(*pair)));
    Ok(())
}

/// An encoded image and what it has to be.
struct Source<'a> {
    file: &'a Path,
    bytes: &'a [u8],
    format: ImageFormat,
    camera: &'a Camera,
    wanted: ColorType,
}

/// Decodes into `pixels`, once the header is known to say the wanted type and size.
fn decode(source: &Source<'_>, pixels: &mut Vec<u8>) -> Result<(), CaptureError> {
    let unreadable = |error: image::ImageError| {
        CaptureError::bad_data(source.file, format!("the image is truncated or damaged: {error}"))
    };
    if source.format == ImageFormat::Jpeg && !is_whole_jpeg(source.bytes) {
        let what = "the image is truncated: the end mark of JPEG is missing";
        return Err(CaptureError::bad_data(source.file, what));
    }
    let reader = ImageReader::with_format(Cursor::new(source.bytes), source.format);
    let decoder = reader.into_decoder().map_err(unreadable)?;
    let (width, height) = decoder.dimensions();
    let (wanted_width, wanted_height) = (source.camera.width_px(), source.camera.height_px());
    if (width, height) != (wanted_width, wanted_height) {
        let what =
            format!("the image has {width} x {height} px; the camera has {wanted_width} x {wanted_height}");
        return Err(CaptureError::bad_data(source.file, what));
    }
    let found = decoder.color_type();
    if found != source.wanted {
        let what = format!("the image is {}; {} is allowed here", in_words(found), in_words(source.wanted));
        return Err(CaptureError::bad_data(source.file, what));
    }
    let (width, height) = size_px(source.camera);
    pixels.resize(width * height * usize::from(found.bytes_per_pixel()), 0);
    decoder.read_image(pixels).map_err(unreadable)
}

fn in_words(color: ColorType) -> String {
    let channels = match color.channel_count() {
        1 => "gray",
        2 => "gray with alpha",
        3 => "RGB",
        _ => "RGB with alpha",
    };
    format!("{}-bit {channels}", color.bits_per_pixel() / u16::from(color.channel_count()))
}

/// Decoders of JPEG fill up what is missing; only the end mark (FF D9) tells. Some writers pad with zeros.
fn is_whole_jpeg(bytes: &[u8]) -> bool {
    let end = bytes.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
    bytes.get(..end).is_some_and(|image| image.ends_with(&[0xFF, 0xD9]))
}

fn max_file_bytes(camera: &Camera, bytes_per_pixel: u64) -> u64 {
    u64::from(camera.width_px()) * u64::from(camera.height_px()) * bytes_per_pixel * 2 + MAX_OVERHEAD_BYTES
}

fn missing(file: &Path, alternative: &str) -> CaptureError {
    let what = format!("no such file{alternative}: a frame set of the recording names it");
    CaptureError::BadData { path: PathBuf::from(file), what }
}

#[cfg(test)]
mod tests {
    use image::{DynamicImage, ImageBuffer, Luma, Rgb};

    use super::*;
    use crate::geometry::Distortion;
    use crate::geometry::camera::Pinhole;
    use crate::tests::hostile::check_any_bytes;

    const SIZE_PX: (u32, u32) = (24, 16);

    fn camera() -> Camera {
        let pinhole = Pinhole { fx_px: 20.0, fy_px: 20.0, cx_px: 12.0, cy_px: 8.0 };
        Camera::try_new(SIZE_PX, pinhole, Distortion::None).expect("valid intrinsics")
    }

    fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).expect("encoded");
        bytes.into_inner()
    }

    fn color() -> DynamicImage {
        ImageBuffer::from_fn(SIZE_PX.0, SIZE_PX.1, |x, y| Rgb([x as u8 * 9, y as u8 * 13, (x * y) as u8]))
            .into()
    }

    fn depth() -> DynamicImage {
        ImageBuffer::from_fn(SIZE_PX.0, SIZE_PX.1, |x, y| Luma([(700 + 31 * x * y) as u16])).into()
    }

    /// Each case is refused by the name of the file, or has every pixel.
    fn check((format, wanted): (ImageFormat, ColorType), valid: &[Vec<u8>]) {
        let (camera, file) = (camera(), Path::new("left/7.img"));
        check_any_bytes(&format!("{format:?} {wanted:?}"), valid, |bytes| {
            let mut pixels = Vec::new();
            let decoded = decode(&Source { file, bytes, format, camera: &camera, wanted }, &mut pixels);
            let n_bytes = SIZE_PX.0 as usize * SIZE_PX.1 as usize * usize::from(wanted.bytes_per_pixel());
            assert!(pixels.is_empty() || pixels.len() == n_bytes);
            if let Err(error) = &decoded {
                assert!(error.to_string().contains("left/7.img"), "{error}");
            }
            decoded.is_ok()
        });
    }

    #[test]
    fn a_jpeg_of_any_bytes_is_refused_or_whole() {
        check((ImageFormat::Jpeg, ColorType::Rgb8), &[encoded(&color(), ImageFormat::Jpeg)]);
    }

    #[test]
    fn a_png_of_any_bytes_is_refused_or_whole() {
        check((ImageFormat::Png, ColorType::Rgb8), &[encoded(&color(), ImageFormat::Png)]);
        check((ImageFormat::Png, ColorType::L16), &[encoded(&depth(), ImageFormat::Png)]);
    }
}
