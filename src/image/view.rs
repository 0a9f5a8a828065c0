//! Borrowed gray, colour and depth images with size and stride.

use crate::geometry::DepthCamera;

/// An 8-bit gray image.
#[derive(Debug, Clone, Copy)]
pub struct GrayView<'a> {
    data: &'a [u8],
    width: usize,
    height: usize,
    stride: usize,
}

/// An 8-bit colour image, red, green and blue interleaved.
#[derive(Debug, Clone, Copy)]
pub struct RgbView<'a> {
    data: &'a [u8],
    width: usize,
    height: usize,
    stride: usize,
}

/// A 16-bit depth image; 0 is "no reading".
#[derive(Debug, Clone, Copy)]
pub struct DepthView<'a> {
    data: &'a [u16],
    width: usize,
    height: usize,
    stride: usize,
    unit_m: f64,
    imager: Option<DepthCamera>,
}

/// Whether `len` elements hold `height` rows of `width` at `stride`.
fn fits(len: usize, (width, height): (usize, usize), stride: usize) -> bool {
    width > 0 && height > 0 && stride >= width && len >= (height - 1) * stride + width
}

impl<'a> GrayView<'a> {
    /// A view of `data`; `None` when it is too short for the size and stride (elements).
    pub fn try_new(data: &'a [u8], (width, height): (usize, usize), stride: usize) -> Option<Self> {
        fits(data.len(), (width, height), stride).then_some(Self { data, width, height, stride })
    }

    /// Width, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// One row, `width` long.
    pub fn row(&self, y: usize) -> &'a [u8] {
        let start = y * self.stride;
        &self.data[start..start + self.width]
    }
}

impl<'a> RgbView<'a> {
    /// A view of `data`; `None` when it is too short for the size and stride (bytes from row to row).
    pub fn try_new(data: &'a [u8], (width, height): (usize, usize), stride: usize) -> Option<Self> {
        fits(data.len(), (3 * width, height), stride).then_some(Self { data, width, height, stride })
    }

    /// Width, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// One row, `width` pixels of red, green and blue.
    pub fn row(&self, y: usize) -> &'a [[u8; 3]] {
        let start = y * self.stride;
        self.data[start..start + 3 * self.width].as_chunks().0
    }

    /// Red, green and blue of a pixel; `None` outside the image.
    pub fn pixel(&self, x: usize, y: usize) -> Option<[u8; 3]> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let at = y * self.stride + 3 * x;
        self.data.get(at..at + 3)?.try_into().ok()
    }
}

impl<'a> DepthView<'a> {
    /// A view of `data`; `None` when it is too short for the size and stride (elements), or the unit is not positive.
    pub fn try_new(
        data: &'a [u16],
        (width, height): (usize, usize),
        stride: usize,
        unit_m: f64,
    ) -> Option<Self> {
        let ok = fits(data.len(), (width, height), stride) && unit_m.is_finite() && unit_m > 0.0;
        ok.then_some(Self { data, width, height, stride, unit_m, imager: None })
    }

    /// Width, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The same image as measured by an imager with a geometry of its own, not registered to the colour image.
    #[must_use]
    pub fn measured_by(self, imager: DepthCamera) -> Self {
        Self { imager: Some(imager), ..self }
    }

    /// What measured it; `None` where it is registered to the colour image.
    pub fn imager(&self) -> Option<&DepthCamera> {
        self.imager.as_ref()
    }

    /// Metres per count.
    pub fn unit_m(&self) -> f64 {
        self.unit_m
    }

    /// Depth along z at a pixel, m; `None` outside the image and where the camera has no reading.
    pub fn depth_m(&self, x: i64, y: i64) -> Option<f64> {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        if x >= self.width || y >= self.height {
            return None;
        }
        match self.data[y * self.stride + x] {
            0 => None,
            counts => Some(f64::from(counts) * self.unit_m),
        }
    }
}
