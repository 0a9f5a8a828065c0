//! Learned likeness of lines, through ONNX Runtime: what a network says of which lines of two images are one edge.
//!
//! The runtime's library is loaded when a matcher is; without it, or without models, everything else goes on. What a model is for
//! is told by the names of its inputs (`contract`); docs/models.md says which models fit and how they are made. Of each image the
//! network sees, the result is kept as [`ImageFeatures`], so that it runs once per image, whatever the number of pairs.

mod calibration;
mod contract;
mod dense;
mod error;
mod glue;
mod model;
mod picture;
mod runtime;
mod samples;
mod scores;
mod sequence;
#[cfg(test)]
mod tests;
mod whole_pair;
mod wireframe;

use std::path::PathBuf;

use crate::geometry::{ScoredMatch, Segment};
use crate::image::GrayView;
use calibration::Calibration;
use contract::Contract;
use dense::DescriptorMap;
pub use error::LearnedError;
use model::Model;
use picture::Picture;
use samples::Samples;
use scores::Scores;

/// What a learned matcher is made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LearnedOptions {
    /// The library of ONNX Runtime; `None`: the environment variable `ORT_DYLIB_PATH`, else the system's default name.
    pub runtime: Option<PathBuf>,
    /// Model files, in any order; empty: there is no learned matcher.
    pub models: Vec<PathBuf>,
    /// Where the models run, the preferred one first; the CPU is always the last resort.
    pub providers: Vec<Provider>,
    /// Threads on the CPU; 0 takes one per core.
    pub threads: usize,
}

impl Default for LearnedOptions {
    fn default() -> Self {
        // One thread: it is in time, and leaves the other cores to the frame path.
        Self { runtime: None, models: Vec::new(), providers: vec![Provider::Cpu], threads: 1 }
    }
}

/// Where a model runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Provider {
    /// Here.
    Cpu,
    /// A graphics processor, through CUDA.
    Cuda,
    /// A graphics processor, through TensorRT.
    TensorRt,
}

impl Provider {
    /// As in the config.
    pub fn name(self) -> &'static str {
        match self {
            Provider::Cpu => "cpu",
            Provider::Cuda => "cuda",
            Provider::TensorRt => "tensorrt",
        }
    }
}

/// What the network saw in one image; good for any number of pairs, with the matcher that made it.
#[derive(Debug, Clone)]
pub struct ImageFeatures {
    size_px: (usize, usize),
    seen: Seen,
}

#[derive(Debug, Clone)]
enum Seen {
    /// For all that compare descriptors.
    Map(DescriptorMap),
    /// For models that take whole images.
    Picture(Picture),
}

impl ImageFeatures {
    /// The descriptors, as long as `model` wants them.
    fn map(&self, model: &Model) -> Result<&DescriptorMap, LearnedError> {
        match &self.seen {
            Seen::Map(map) if model.facts.descriptor_len.is_none_or(|len| len == map.len) => Ok(map),
            Seen::Map(map) => Err(model.failure(format!(
                "it wants descriptors of {} numbers, and the model `dense` gives {}",
                model.facts.descriptor_len.unwrap_or(map.len),
                map.len
            ))),
            Seen::Picture(_) => Err(model.failure(FOREIGN.to_owned())),
        }
    }

    fn picture(&self, model: &Model) -> Result<&Picture, LearnedError> {
        match &self.seen {
            Seen::Picture(picture) => Ok(picture),
            Seen::Map(_) => Err(model.failure(FOREIGN.to_owned())),
        }
    }
}

/// One image of a pair: what the network saw in it, its lines, and the points along those that are compared.
struct Sampled<'a> {
    features: &'a ImageFeatures,
    segments: &'a [Segment],
    samples: Samples,
}

impl<'a> Sampled<'a> {
    fn new((features, segments): (&'a ImageFeatures, &'a [Segment])) -> Self {
        Self { features, segments, samples: Samples::along(segments) }
    }

    /// Indices of the lines that are compared.
    fn lines(&self) -> &[usize] {
        &self.samples.lines
    }
}

const FOREIGN: &str = "these image features were made by another matcher";

/// Compares lines of two images by learned appearance.
#[derive(Debug)]
pub struct LearnedMatcher {
    method: Method,
}

/// What the given models can do together.
#[derive(Debug)]
enum Method {
    /// One model for all.
    WholePair(Model),
    /// Descriptors along the lines, aligned in order.
    Sequence(Model),
    /// Descriptors along the lines, assigned by attention.
    Glue { dense: Model, glue: Model },
    /// Descriptors where lines end, assigned by a graph network.
    Wireframe { dense: Model, wireframe: Model },
}

impl LearnedMatcher {
    /// Loads the runtime and the models, and checks that they fit together.
    ///
    /// # Errors
    /// One sentence that says what is missing or wrong, and what to do.
    pub fn load(options: &LearnedOptions) -> Result<Self, LearnedError> {
        if options.models.is_empty() {
            return Err(LearnedError::Combination { found: "no model".to_owned() });
        }
        let environment = runtime::environment(options.runtime.as_deref())?;
        let load = |path: &PathBuf| Model::load(&environment, path, options);
        let models = options.models.iter().map(load).collect::<Result<Vec<Model>, _>>()?;
        Ok(Self { method: Method::of(models)? })
    }

    /// Lets the network see one image.
    ///
    /// # Errors
    /// [`LearnedError::Run`].
    pub fn image_features(&mut self, image: &GrayView<'_>) -> Result<ImageFeatures, LearnedError> {
        let seen = match &mut self.method {
            Method::WholePair(model) => {
                let picture = Picture::new(image, &model.facts);
                Seen::Picture(picture.map_err(|what| model.failure(what))?)
            }
            Method::Sequence(dense) | Method::Glue { dense, .. } | Method::Wireframe { dense, .. } => {
                Seen::Map(dense::describe(dense, image)?)
            }
        };
        Ok(ImageFeatures { size_px: (image.width(), image.height()), seen })
    }

    /// What appearance says of the lines of two images, many-to-many: candidates with their evidence, by target line, then by
    /// source line. The longest segments are compared, as many as there is time for; indices are those of the given slices.
    ///
    /// # Errors
    /// [`LearnedError::Run`].
    pub fn score_lines(
        &mut self,
        target: (&ImageFeatures, &[Segment]),
        source: (&ImageFeatures, &[Segment]),
    ) -> Result<Vec<ScoredMatch>, LearnedError> {
        let scores = self.scores(target, source)?;
        Ok(calibration::matches(&scores, self.method.calibration()))
    }

    fn scores(
        &mut self,
        target: (&ImageFeatures, &[Segment]),
        source: (&ImageFeatures, &[Segment]),
    ) -> Result<Scores, LearnedError> {
        let (target, source) = (Sampled::new(target), Sampled::new(source));
        if target.lines().is_empty() || source.lines().is_empty() {
            return Ok(Scores::none());
        }
        match &mut self.method {
            Method::WholePair(model) => whole_pair::score(model, &target, &source),
            Method::Sequence(dense) => sequence::score(dense, &target, &source),
            Method::Glue { glue, .. } => glue::score(glue, &target, &source),
            Method::Wireframe { wireframe, .. } => wireframe::score(wireframe, &target, &source),
        }
    }
}

impl Method {
    fn calibration(&self) -> &'static Calibration {
        match self {
            Method::Sequence(_) => &calibration::ALIGNED,
            Method::WholePair(_) | Method::Glue { .. } | Method::Wireframe { .. } => &calibration::ASSIGNED,
        }
    }

    fn of(mut models: Vec<Model>) -> Result<Self, LearnedError> {
        models.sort_by_key(|model| model.contract as u8);
        let contracts: Vec<Contract> = models.iter().map(|model| model.contract).collect();
        let mut models = models.into_iter();
        let method = match (contracts.as_slice(), models.next(), models.next()) {
            ([Contract::Dense], Some(dense), None) => Some(Method::Sequence(dense)),
            ([Contract::Lines], Some(model), None) => Some(Method::WholePair(model)),
            ([Contract::Dense, Contract::Glue], Some(dense), Some(glue)) => {
                Some(Method::Glue { dense, glue })
            }
            ([Contract::Dense, Contract::Wireframe], Some(dense), Some(wireframe)) => {
                Some(Method::Wireframe { dense, wireframe })
            }
            _ => None,
        };
        let names: Vec<String> = contracts.iter().map(|contract| format!("`{}`", contract.name())).collect();
        method.ok_or_else(|| LearnedError::Combination { found: names.join(" and ") })
    }
}
