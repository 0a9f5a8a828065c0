//! From the bytes of a device, whose rows may be padded, to the buffers of a frame.

/// How an image lies in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// px.
    pub width_px: usize,
    /// px.
    pub height_px: usize,
    /// Bytes from the start of a row to that of the next.
    pub stride_bytes: usize,
}

impl Layout {
    /// The rows of an image of so many bytes a pixel; `None` where the bytes are too few or the stride too small.
    fn rows(self, bytes: &[u8], bytes_per_pixel: usize) -> Option<impl Iterator<Item = &[u8]>> {
        let row_bytes = self.width_px.checked_mul(bytes_per_pixel)?;
        let last_row = self.stride_bytes.checked_mul(self.height_px.checked_sub(1)?)?;
        let is_whole = row_bytes > 0
            && self.stride_bytes >= row_bytes
            && last_row.checked_add(row_bytes)? <= bytes.len();
        is_whole.then(|| {
            bytes.chunks(self.stride_bytes).take(self.height_px).filter_map(move |row| row.get(..row_bytes))
        })
    }
}

/// Copies 8-bit RGB; `None`, with `rgb` empty, where the bytes are not such an image.
pub fn copy_rgb(bytes: &[u8], layout: Layout, rgb: &mut Vec<u8>) -> Option<()> {
    rgb.clear();
    layout.rows(bytes, 3)?.for_each(|row| rgb.extend_from_slice(row));
    Some(())
}

/// Copies 16-bit depth in the order of bytes of the SDK, little-endian; `None`, with `depth` empty, where the bytes are not such an
/// image.
pub fn copy_depth(bytes: &[u8], layout: Layout, depth: &mut Vec<u16>) -> Option<()> {
    depth.clear();
    for row in layout.rows(bytes, 2)? {
        depth.extend(row.as_chunks::<2>().0.iter().map(|&pair| u16::from_le_bytes(pair)));
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PADDED: Layout = Layout { width_px: 2, height_px: 2, stride_bytes: 8 };

    #[test]
    fn padding_between_rows_is_left_out() {
        let bytes: Vec<u8> = (0..16).collect();
        let mut rgb = vec![9; 100];
        assert_eq!(copy_rgb(&bytes, PADDED, &mut rgb), Some(()));
        assert_eq!(rgb, [0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 12, 13]);
        let mut depth = vec![9; 100];
        assert_eq!(copy_depth(&bytes, PADDED, &mut depth), Some(()));
        assert_eq!(depth, [0x0100, 0x0302, 0x0908, 0x0b0a]);
    }

    #[test]
    fn the_last_row_needs_no_padding() {
        let bytes: Vec<u8> = (0..14).collect();
        let mut rgb = Vec::new();
        assert_eq!(copy_rgb(&bytes, PADDED, &mut rgb), Some(()));
        assert_eq!(rgb.len(), 12);
    }

    #[test]
    fn bytes_that_are_no_such_image_give_nothing() {
        let bytes: Vec<u8> = (0..13).collect();
        let (mut rgb, mut depth) = (vec![1], vec![1]);
        assert_eq!(copy_rgb(&bytes, PADDED, &mut rgb), None, "a byte short");
        assert!(rgb.is_empty());
        for layout in [
            Layout { stride_bytes: 3, ..PADDED },
            Layout { width_px: 0, ..PADDED },
            Layout { height_px: 0, ..PADDED },
            Layout { width_px: usize::MAX, ..PADDED },
            Layout { height_px: usize::MAX, ..PADDED },
        ] {
            assert_eq!(copy_depth(&bytes, layout, &mut depth), None, "{layout:?}");
            assert!(depth.is_empty());
        }
    }

    #[test]
    fn buffers_are_used_again() {
        let bytes = [7; 16];
        let mut rgb = Vec::with_capacity(12);
        let before = rgb.as_ptr();
        assert_eq!(copy_rgb(&bytes, PADDED, &mut rgb), Some(()));
        assert_eq!(rgb.as_ptr(), before);
    }
}
