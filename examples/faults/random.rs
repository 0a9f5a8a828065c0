//! Random numbers that are the same for the same seed: splitmix64.

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in 0 to `n` - 1.
    pub fn below(&mut self, n: u64) -> u64 {
        self.next() % n.max(1)
    }

    /// A time between these, as likely in one octave as in the next: short ones matter as much as long ones.
    pub fn time_ms(&mut self, shortest: f64, longest: f64) -> std::time::Duration {
        let share = (self.next() >> 11) as f64 / (1u64 << 53) as f64;
        std::time::Duration::from_secs_f64(shortest * 1e-3 * (longest / shortest).powf(share))
    }
}
