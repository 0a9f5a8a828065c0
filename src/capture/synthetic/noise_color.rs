//! From linear light to the 8-bit picture of a small colour camera: blur, vignetting, automatic exposure, shot and read
//! noise, a tone curve.

use super::random::Random;
use super::texture::Rgb;

/// Half width of the lens blur, px.
const RADIUS: usize = 2;
/// Entries of the tone table over signals 0..`TONE_RANGE`.
const TONES: usize = 1 << 14;
const TONE_RANGE: f32 = 2.0;
/// Linear signal the automatic exposure brings the mean to: 0.43 after the sRGB curve.
const MEAN_SIGNAL: f32 = 0.155;

/// What a camera's colour picture suffers from.
#[derive(Debug)]
pub(super) struct ColorNoise {
    kernel: [f32; 2 * RADIUS + 1],
    /// Share of light lost at the middle of the left and right border.
    vignetting: f32,
    balance: Rgb,
    exposure_ev: f32,
    /// Electrons at signal 1.
    full_well: f32,
    read_noise: f32,
}

impl ColorNoise {
    /// Draws one camera's faults.
    pub(super) fn new(random: &mut Random) -> Self {
        let sigma_px = random.between(0.45, 0.7) as f32;
        let mut kernel: [f32; 2 * RADIUS + 1] = std::array::from_fn(|i| {
            let at = i as f32 - RADIUS as f32;
            (-0.5 * (at / sigma_px).powi(2)).exp()
        });
        let sum: f32 = kernel.iter().sum();
        kernel.iter_mut().for_each(|k| *k /= sum);
        Self {
            kernel,
            vignetting: random.between(0.08, 0.2) as f32,
            balance: std::array::from_fn(|_| random.between(0.95, 1.05) as f32),
            exposure_ev: random.between(-0.15, 0.15) as f32,
            full_well: random.between(2000.0, 9000.0) as f32,
            read_noise: random.between(0.0015, 0.004) as f32,
        }
    }

    /// Exposure of one frame, f-stops from the nominal.
    fn frame_ev(&self, random: &mut Random) -> f32 {
        self.exposure_ev + random.between(-0.35, 0.35) as f32
    }
}

/// Turns linear planes into an 8-bit picture; owns its scratch memory.
#[derive(Debug)]
pub(super) struct Developer {
    width: usize,
    tones: Vec<u8>,
    scratch: Vec<f32>,
}

impl Developer {
    pub(super) fn new((width, height): (usize, usize)) -> Self {
        let tone = |i: usize| (255.0 * display(i as f32 * TONE_RANGE / TONES as f32) + 0.5) as u8;
        Self { width, tones: (0..TONES).map(tone).collect(), scratch: vec![0.0; width * height] }
    }

    /// Overwrites `rgb`; without noise only exposure and tone curve apply. The planes are used up.
    pub(super) fn develop(
        &mut self,
        planes: &mut [Vec<f32>; 3],
        noise: Option<(&ColorNoise, &mut Random)>,
        rgb: &mut [u8],
    ) {
        let sum: f64 = planes.iter().flatten().map(|value| f64::from(*value)).sum();
        let mean = (sum / (3 * planes[0].len()) as f64).max(1e-6) as f32;
        let gain = MEAN_SIGNAL / mean;
        match noise {
            None => self.write(planes, rgb, |signal| signal * gain),
            Some((camera, random)) => {
                for plane in planes.iter_mut() {
                    self.blur(plane, &camera.kernel);
                }
                let gain = gain * camera.frame_ev(random).exp2();
                self.write_noisy(planes, (camera, random, gain), rgb);
            }
        }
    }

    fn tone(&self, signal: f32) -> u8 {
        // Negative signals saturate to 0 in the cast.
        let place = (signal * (TONES as f32 / TONE_RANGE)) as usize;
        self.tones[place.min(TONES - 1)]
    }

    fn write(&self, planes: &[Vec<f32>; 3], rgb: &mut [u8], mut signal: impl FnMut(f32) -> f32) {
        let [red, green, blue] = planes;
        for (((pixel, red), green), blue) in rgb.chunks_exact_mut(3).zip(red).zip(green).zip(blue) {
            pixel[0] = self.tone(signal(*red));
            pixel[1] = self.tone(signal(*green));
            pixel[2] = self.tone(signal(*blue));
        }
    }

    fn write_noisy(
        &self,
        planes: &mut [Vec<f32>; 3],
        (camera, random, gain): (&ColorNoise, &mut Random, f32),
        rgb: &mut [u8],
    ) {
        let half = self.width as f32 / 2.0;
        let height = planes[0].len() / self.width;
        for (plane, balance) in planes.iter_mut().zip(camera.balance) {
            for (y, row) in plane.chunks_exact_mut(self.width).enumerate() {
                let v = (y as f32 - 0.5 * height as f32) / half;
                for (x, value) in row.iter_mut().enumerate() {
                    let u = (x as f32 - half) / half;
                    *value *= gain * balance * (1.0 - camera.vignetting * (u * u + v * v));
                }
            }
        }
        let read_variance = camera.read_noise * camera.read_noise;
        self.write(planes, rgb, |signal| {
            let sigma = (signal / camera.full_well + read_variance).sqrt();
            signal + sigma * random.gaussian()
        });
    }

    /// Separable, the border repeated.
    fn blur(&mut self, plane: &mut [f32], kernel: &[f32; 2 * RADIUS + 1]) {
        let width = self.width;
        let last = plane.len() / width - 1;
        for (y, out) in self.scratch.chunks_exact_mut(width).enumerate() {
            out.fill(0.0);
            for (tap, weight) in kernel.iter().enumerate() {
                let from = (y + tap).saturating_sub(RADIUS).min(last) * width;
                out.iter_mut().zip(&plane[from..from + width]).for_each(|(sum, v)| *sum += weight * v);
            }
        }
        for (line, out) in self.scratch.chunks_exact(width).zip(plane.chunks_exact_mut(width)) {
            for (x, value) in out.iter_mut().enumerate() {
                let at = |tap: usize| line[(x + tap).saturating_sub(RADIUS).min(width - 1)];
                *value = match line.get(x.wrapping_sub(RADIUS)..x + RADIUS + 1) {
                    Some(taps) => taps.iter().zip(kernel).map(|(v, weight)| v * weight).sum(),
                    None => kernel.iter().enumerate().map(|(tap, weight)| at(tap) * weight).sum(),
                };
            }
        }
    }
}

/// sRGB with a shoulder: signals above 0.7 bend towards white.
fn display(signal: f32) -> f32 {
    let bent = if signal > 0.7 { 0.7 + 0.3 * (1.0 - (-(signal - 0.7) / 0.3).exp()) } else { signal };
    if bent < 0.003_130_8 { 12.92 * bent } else { 1.055 * bent.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_exposed_to_mid_gray() {
        let mut planes = [vec![4.0f32; 32 * 20], vec![4.0; 32 * 20], vec![4.0; 32 * 20]];
        let mut rgb = vec![0u8; 3 * 32 * 20];
        Developer::new((32, 20)).develop(&mut planes, None, &mut rgb);
        assert!(rgb.iter().all(|value| (i32::from(*value) - 110).abs() < 2), "{}", rgb[0]);
    }

    #[test]
    fn the_blur_keeps_the_place_of_an_edge() {
        let mut developer = Developer::new((16, 4));
        let mut plane: Vec<f32> = (0..64).map(|i| if i % 16 < 8 { 0.0 } else { 1.0 }).collect();
        developer.blur(&mut plane, &ColorNoise::new(&mut Random::keyed(1, &[])).kernel);
        assert!((plane[7] + plane[8] - 1.0).abs() < 1e-6 && plane[7] > 0.05);
        assert!(plane[0].abs() < 1e-6 && (plane[15] - 1.0).abs() < 1e-6);
    }
}
