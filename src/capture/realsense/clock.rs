//! The 32-bit clock of microseconds of a camera, as one that does not start again every 71.6 minutes.

/// ns; after this the counter starts again at 0.
pub const WRAP_NS: i64 = (1 << 32) * 1000;

/// ns from the milliseconds that the SDK gives; `None` where that is no time.
pub fn ns_from_ms(ms: f64) -> Option<i64> {
    // Above 2^53 ns (104 days) a double of milliseconds still resolves 0.2 us up to the year 2100.
    let ns = (ms * 1e6).round();
    (ns.is_finite() && ns.abs() < 9e18).then_some(ns as i64)
}

/// Counts the wraps of one camera's clock. Streams of one camera share it: near a wrap their stamps come in any order.
#[derive(Debug, Clone, Copy, Default)]
pub struct WrappingClock {
    last_ns: Option<i64>,
}

impl WrappingClock {
    /// The stamp on a clock that goes on. A clock that is no 32-bit counter (stamps from 2^32 us on) is left alone.
    pub fn unwrapped(&mut self, stamp_ns: i64) -> i64 {
        let unwrapped = match self.last_ns {
            Some(last_ns) if (0..WRAP_NS).contains(&stamp_ns) => nearest(stamp_ns, last_ns),
            _ => stamp_ns,
        };
        self.last_ns = Some(unwrapped);
        unwrapped
    }
}

/// The stamp in that round of the counter in which it is nearest to `last_ns`, but never before round 0.
fn nearest(stamp_ns: i64, last_ns: i64) -> i64 {
    let rounds = last_ns.saturating_sub(stamp_ns).saturating_add(WRAP_NS / 2).div_euclid(WRAP_NS).max(0);
    stamp_ns.saturating_add(rounds.saturating_mul(WRAP_NS))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_NS: i64 = 33_333_000;

    #[test]
    fn stamps_go_on_over_the_wrap() {
        let mut clock = WrappingClock::default();
        for number in -40..40 {
            let true_ns = WRAP_NS + number * FRAME_NS;
            assert_eq!(clock.unwrapped(true_ns % WRAP_NS), true_ns, "frame {number}");
        }
    }

    #[test]
    fn many_wraps_in_a_row_are_counted() {
        let mut clock = WrappingClock::default();
        for number in 0..1000 {
            let true_ns = number * 1_000_000_000_000;
            assert_eq!(clock.unwrapped(true_ns % WRAP_NS), true_ns);
        }
    }

    #[test]
    fn a_stamp_from_before_the_wrap_that_comes_after_it_stays_before_it() {
        let mut clock = WrappingClock::default();
        assert_eq!(clock.unwrapped(WRAP_NS - FRAME_NS), WRAP_NS - FRAME_NS);
        assert_eq!(clock.unwrapped(1_000), WRAP_NS + 1_000);
        assert_eq!(clock.unwrapped(WRAP_NS - 2_000), WRAP_NS - 2_000, "the other stream, a little late");
        assert_eq!(clock.unwrapped(FRAME_NS), WRAP_NS + FRAME_NS);
    }

    #[test]
    fn a_clock_of_the_host_is_left_alone() {
        let mut clock = WrappingClock::default();
        let now_ns = 1_795_000_000_000_000_000;
        for stamp_ns in [now_ns, now_ns + FRAME_NS, now_ns - 3 * WRAP_NS] {
            assert_eq!(clock.unwrapped(stamp_ns), stamp_ns);
        }
    }

    #[test]
    fn a_small_step_back_is_no_wrap() {
        let mut clock = WrappingClock::default();
        clock.unwrapped(5 * FRAME_NS);
        assert_eq!(clock.unwrapped(2 * FRAME_NS), 2 * FRAME_NS);
    }

    #[test]
    fn milliseconds_become_nanoseconds_and_nonsense_nothing() {
        assert_eq!(ns_from_ms(1_033.25), Some(1_033_250_000));
        let now_ns = ns_from_ms(1_795_000_000_000.125).expect("a time of the host");
        assert!((now_ns - 1_795_000_000_000_125_000).abs() < 1_000, "{now_ns}");
        for nonsense in [f64::NAN, f64::INFINITY, 1e300] {
            assert_eq!(ns_from_ms(nonsense), None);
        }
    }
}
