//! Colour to gray, once per frame.

/// Replaces `gray` by the BT.601 luma of interleaved 8-bit RGB; a trailing part of a pixel is dropped.
pub fn gray_from_rgb(rgb: &[u8], gray: &mut Vec<u8>) {
    let (pixels, _) = rgb.as_chunks::<3>();
    gray.clear();
    gray.extend(pixels.iter().map(|&[red, green, blue]| {
        // 77 + 150 + 29 = 256: white stays 255, and 128 rounds to the nearest.
        ((77 * u32::from(red) + 150 * u32::from(green) + 29 * u32::from(blue) + 128) >> 8) as u8
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gray_stays_gray_and_colours_weigh_as_the_eye_does() {
        let mut gray = vec![7; 3];
        gray_from_rgb(
            &[0, 0, 0, 255, 255, 255, 100, 100, 100, 255, 0, 0, 0, 255, 0, 0, 0, 255, 9],
            &mut gray,
        );
        assert_eq!(gray, [0, 255, 100, 77, 149, 29]);
    }

    #[test]
    fn a_second_image_reuses_the_buffer() {
        let mut gray = Vec::new();
        gray_from_rgb(&[1; 300], &mut gray);
        let before = gray.as_ptr();
        gray_from_rgb(&[2; 300], &mut gray);
        assert_eq!((gray.as_ptr(), gray.len()), (before, 100));
    }
}
