//! Which depth image belongs to which colour image of one camera: the streams run at one rate but start and stutter apart. Whoever
//! reads a camera or its recording, with the SDK or without, decides it here.

use std::collections::VecDeque;

/// Images of one stream that wait for their partner, at most. The SDK has 16 buffers a stream and gives no new image while all are held.
const MAX_WAITING: usize = 6;

/// The streams of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Colour.
    Color,
    /// Depth.
    Depth,
}

/// How far apart two images of one moment may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaxGap {
    ns: i64,
}

impl MaxGap {
    /// For colour of this rate: half the time between two frames.
    pub fn for_rate(rate_hz: f64) -> Self {
        Self { ns: (0.5e9 / rate_hz.max(0.1)) as i64 }
    }

    /// Which of the oldest two images is too old for the other, and has lost its own partner; `None` where the two are of one moment.
    pub fn too_old(self, color_ns: i64, depth_ns: i64) -> Option<Stream> {
        let gap_ns = color_ns.saturating_sub(depth_ns);
        if gap_ns > self.ns {
            return Some(Stream::Depth);
        }
        (gap_ns < -self.ns).then_some(Stream::Color)
    }
}

/// Images that wait for their partner, oldest first, with their stamps in ns.
#[derive(Debug)]
pub struct Pairing<C, D> {
    color: VecDeque<(i64, C)>,
    depth: VecDeque<(i64, D)>,
    max_gap: MaxGap,
}

impl<C, D> Pairing<C, D> {
    /// For streams of this rate.
    pub fn for_rate(rate_hz: f64) -> Self {
        let waiting = MAX_WAITING + 1;
        let (color, depth) = (VecDeque::with_capacity(waiting), VecDeque::with_capacity(waiting));
        Self { color, depth, max_gap: MaxGap::for_rate(rate_hz) }
    }

    /// Takes an image; where too many wait, the oldest is given up.
    pub fn add_color(&mut self, stamp_ns: i64, image: C) {
        add(&mut self.color, (stamp_ns, image));
    }

    /// Takes an image; where too many wait, the oldest is given up.
    pub fn add_depth(&mut self, stamp_ns: i64, image: D) {
        add(&mut self.depth, (stamp_ns, image));
    }

    /// Whether one more image may cost one that waits.
    pub fn is_full(&self) -> bool {
        self.color.len() >= MAX_WAITING || self.depth.len() >= MAX_WAITING
    }

    /// The next two of one moment, with the stamp of colour; or the stream whose next image has to come first.
    pub fn next_pair(&mut self) -> Result<(i64, C, D), Stream> {
        loop {
            let Some(&(color_ns, _)) = self.color.front() else { return Err(Stream::Color) };
            let Some(&(depth_ns, _)) = self.depth.front() else { return Err(Stream::Depth) };
            match self.max_gap.too_old(color_ns, depth_ns) {
                Some(Stream::Depth) => drop(self.depth.pop_front()),
                Some(Stream::Color) => drop(self.color.pop_front()),
                None => {
                    if let (Some((stamp_ns, color)), Some((_, depth))) =
                        (self.color.pop_front(), self.depth.pop_front())
                    {
                        return Ok((stamp_ns, color, depth));
                    }
                }
            }
        }
    }
}

fn add<T>(waiting: &mut VecDeque<T>, image: T) {
    if waiting.len() >= MAX_WAITING {
        waiting.pop_front();
    }
    waiting.push_back(image);
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_NS: i64 = 33_333_333;

    fn pairing() -> Pairing<i64, i64> {
        Pairing::for_rate(30.0)
    }

    /// Colour and depth of one number are of one moment, depth a little earlier.
    fn add(pairing: &mut Pairing<i64, i64>, stream: Stream, number: i64) {
        match stream {
            Stream::Color => pairing.add_color(number * FRAME_NS, number),
            Stream::Depth => pairing.add_depth(number * FRAME_NS - 6_000_000, number),
        }
    }

    #[test]
    fn the_gap_is_half_a_frame_of_any_rate() {
        for (rate_hz, half_ns) in [(15.0, 33_333_333), (30.0, 16_666_666), (90.0, 5_555_555)] {
            let max_gap = MaxGap::for_rate(rate_hz);
            assert_eq!(max_gap.too_old(0, half_ns), None);
            assert_eq!(max_gap.too_old(0, -half_ns), None);
            assert_eq!(max_gap.too_old(0, half_ns + 2), Some(Stream::Color));
            assert_eq!(max_gap.too_old(0, -half_ns - 2), Some(Stream::Depth));
        }
    }

    #[test]
    fn images_of_one_moment_meet_whichever_comes_first() {
        for order in [[Stream::Color, Stream::Depth], [Stream::Depth, Stream::Color]] {
            let mut pairing = pairing();
            for number in 0..5 {
                order.into_iter().for_each(|stream| add(&mut pairing, stream, number));
                assert_eq!(pairing.next_pair(), Ok((number * FRAME_NS, number, number)));
            }
            assert_eq!(pairing.next_pair(), Err(Stream::Color));
        }
    }

    #[test]
    fn an_image_whose_partner_was_lost_is_left_out() {
        let mut pairing = pairing();
        for number in [0, 2, 3] {
            add(&mut pairing, Stream::Color, number);
        }
        for number in [1, 2, 4] {
            add(&mut pairing, Stream::Depth, number);
        }
        assert_eq!(pairing.next_pair(), Ok((2 * FRAME_NS, 2, 2)));
        assert_eq!(pairing.next_pair(), Err(Stream::Color), "3 has no partner and will get none");
        add(&mut pairing, Stream::Color, 4);
        assert_eq!(pairing.next_pair(), Ok((4 * FRAME_NS, 4, 4)));
    }

    #[test]
    fn a_stream_that_starts_later_is_waited_for_with_bounded_memory() {
        let mut pairing = pairing();
        (0..100).for_each(|number| add(&mut pairing, Stream::Depth, number));
        assert_eq!(pairing.next_pair(), Err(Stream::Color));
        assert!(pairing.is_full() && pairing.depth.len() == MAX_WAITING);
        add(&mut pairing, Stream::Color, 99);
        assert_eq!(pairing.next_pair(), Ok((99 * FRAME_NS, 99, 99)));
    }
}
