//! What appearance says of lines of two cameras: how much likelier they look to be one edge than by chance.

/// One line of the target and one of the source, as indices into the lines of their views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoredMatch {
    /// Index of the target line in its view.
    pub target: u32,
    /// Index of the source line in its view.
    pub source: u32,
    /// Logarithm of how many times likelier such a likeness is for one physical edge than for two, nats; 0 says nothing.
    pub nats: f64,
}

/// The scored lines of two cameras in one frame set; many-to-many. Lines that are not listed have 0 nats.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PairScores {
    /// Index of the target camera, the smaller of both.
    pub target: usize,
    /// Index of the source camera.
    pub source: usize,
    /// Each pair of lines at most once.
    pub matches: Vec<ScoredMatch>,
}
