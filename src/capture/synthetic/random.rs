//! The seeded generator behind everything that looks random in the synthetic room.
//!
//! A stream is named by a seed and a list of keys (camera, frame, purpose), so what one camera draws never depends on
//! which camera was opened first or on which thread.

/// splitmix64 (Steele, Lea, Flood 2014).
#[derive(Debug, Clone)]
pub(super) struct Random {
    state: u64,
}

impl Random {
    /// The stream named by a seed and keys; other keys give an unrelated stream.
    pub(super) fn keyed(seed: u64, keys: &[u64]) -> Self {
        let mut random = Self { state: seed };
        for key in keys {
            let mixed = random.next_u64() ^ key.wrapping_mul(0xD6E8_FEB8_6659_FD93);
            random.state = mixed;
        }
        random
    }

    /// 64 uniform bits.
    #[inline]
    pub(super) fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        low + unit * (high - low)
    }

    /// Uniform below `count` (at least 1).
    pub(super) fn below(&mut self, count: usize) -> usize {
        (self.next_u64() % count.max(1) as u64) as usize
    }

    /// Mean 0, variance 1, from four 16-bit uniforms (Irwin-Hall): one draw of the generator, tails to 3.5 sigma.
    #[inline]
    pub(super) fn gaussian(&mut self) -> f32 {
        let bits = self.next_u64();
        let sum = (bits & 0xFFFF) + (bits >> 16 & 0xFFFF) + (bits >> 32 & 0xFFFF) + (bits >> 48);
        // The sum of four uniforms on 0..65536 has variance 4/12 * 65536².
        (sum as f32 - 131_070.0) * (1.732_050_8 / 65_536.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussians_have_mean_zero_and_variance_one() {
        let mut random = Random::keyed(3, &[1, 2]);
        let draws: Vec<f64> = (0..100_000).map(|_| f64::from(random.gaussian())).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|d| d * d).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "mean {mean}, variance {variance}");
    }

    #[test]
    fn other_keys_give_another_stream() {
        let first = Random::keyed(1, &[0, 1]).next_u64();
        assert_ne!(first, Random::keyed(1, &[1, 0]).next_u64());
        assert_eq!(first, Random::keyed(1, &[0, 1]).next_u64());
    }
}
