//! One loaded model: its session, what its metadata says of pre-processing, and how it is run.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use ort::environment::Environment;
use ort::session::{Session, SessionInputValue};
use ort::value::{PrimitiveTensorElementType, Tensor};

use super::contract::{Contract, written};
use super::runtime::{self, plain};
use super::{LearnedError, LearnedOptions};

/// Sides of images are multiples of this unless the metadata says otherwise, px: what five halvings need.
const DEFAULT_MULTIPLE_PX: usize = 32;

/// What has to be known of a model to prepare its inputs, from its metadata and the shapes of its inputs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Facts {
    /// Pixels per cell of the descriptor map; `None`: told by the size of the map.
    pub(super) stride_px: Option<usize>,
    /// The sides of an image are padded to multiples of this, px.
    pub(super) multiple_px: usize,
    /// Channels of an image: 1 or 3 equal ones.
    pub(super) channels: usize,
    /// Key points are divided by this times half the longer side of the image.
    pub(super) kpt_scale: f64,
    /// Height and width of images where the graph fixes them, px.
    pub(super) fixed_size_px: [Option<usize>; 2],
    /// Length of a descriptor where the graph fixes it.
    pub(super) descriptor_len: Option<usize>,
    /// Licence of the weights.
    pub(super) licence: Option<String>,
}

/// A model that fits its contract.
#[derive(Debug)]
pub(super) struct Model {
    path: PathBuf,
    session: Session,
    /// What it is for.
    pub(super) contract: Contract,
    /// What its inputs must be like.
    pub(super) facts: Facts,
}

/// Named inputs of one run.
pub(super) type Inputs = Vec<(Cow<'static, str>, SessionInputValue<'static>)>;

/// What a model answered: its shape, and the values row by row.
#[derive(Debug)]
pub(super) struct Answer {
    /// Sizes of the dimensions.
    pub(super) shape: Vec<usize>,
    /// As many as the product of the sizes.
    pub(super) values: Vec<f32>,
}

impl Model {
    /// Reads and checks one model file.
    ///
    /// # Errors
    /// [`LearnedError::Model`] for everything that can be wrong with a file.
    pub(super) fn load(
        environment: &Environment,
        path: &Path,
        options: &LearnedOptions,
    ) -> Result<Self, LearnedError> {
        let session = runtime::open(environment, path, options)?;
        let checked = Contract::of(&session).and_then(|contract| {
            let facts = facts(&session)?;
            Ok((contract, facts))
        });
        let (contract, facts) =
            checked.map_err(|what| LearnedError::Model { path: path.to_owned(), what })?;
        let licence = facts.licence.as_deref().unwrap_or("not said");
        tracing::info!(model = %path.display(), contract = contract.name(), licence, "learned model loaded");
        Ok(Self { path: path.to_owned(), session, contract, facts })
    }

    /// Runs the model and returns its one output that counts, whose shape `is_expected`.
    ///
    /// # Errors
    /// [`LearnedError::Run`] when the runtime fails, or the answer has another shape.
    pub(super) fn run(
        &mut self,
        inputs: Inputs,
        is_expected: impl Fn(&[usize]) -> bool,
    ) -> Result<Answer, LearnedError> {
        let Self { path, session, contract, .. } = self;
        let failed = |what: String| LearnedError::Run { path: path.clone(), what };
        let text = |error: ort::Error| failed(plain(&error.to_string()));
        let outputs = session.run(inputs).map_err(text)?;
        let (name, _) = contract.output();
        let output = outputs.get(name).ok_or_else(|| failed(format!("it gave no {name}")))?;
        let (shape, values) = output.try_extract_tensor::<f32>().map_err(text)?;
        let sizes: Vec<usize> = shape.iter().filter_map(|&size| usize::try_from(size).ok()).collect();
        if sizes.iter().product::<usize>() != values.len() || !is_expected(&sizes) {
            return Err(failed(format!(
                "its output {name} has the shape {}, which does not fit its inputs",
                written(shape)
            )));
        }
        Ok(Answer { shape: sizes, values: values.to_vec() })
    }

    /// An error of this model at run time.
    pub(super) fn failure(&self, what: String) -> LearnedError {
        LearnedError::Run { path: self.path.clone(), what }
    }

    /// A tensor to be fed in.
    ///
    /// # Errors
    /// [`LearnedError::Run`] when the runtime refuses it.
    pub(super) fn tensor<T: PrimitiveTensorElementType + Clone + std::fmt::Debug + 'static>(
        &self,
        shape: &[usize],
        values: Vec<T>,
    ) -> Result<SessionInputValue<'static>, LearnedError> {
        let tensor = Tensor::from_array((shape.to_vec(), values));
        tensor.map(SessionInputValue::from).map_err(|error| self.failure(plain(&error.to_string())))
    }
}

fn facts(session: &Session) -> Result<Facts, String> {
    let metadata = session.metadata().map_err(|error| plain(&error.to_string()))?;
    let whole = |key: &str| {
        let Some(text) = metadata.custom(key) else { return Ok(None) };
        match text.trim().parse() {
            Ok(number @ 1..=4096) => Ok(Some(number)),
            _ => Err(format!("its metadata say {key} = {text:?}; allowed is a whole number from 1 to 4096")),
        }
    };
    let image = shape_of(session, "image").or_else(|| shape_of(session, "image0")).unwrap_or_default();
    let fixed = |at: usize| image.get(at).and_then(|&size| usize::try_from(size).ok());
    let descriptors = shape_of(session, "desc0");
    let at = if shape_of(session, "junc0").is_some() { 1 } else { 2 };
    let descriptor_len = descriptors.and_then(|shape| usize::try_from(*shape.get(at)?).ok());
    Ok(Facts {
        stride_px: whole("pelical.stride")?,
        multiple_px: whole("pelical.multiple")?.unwrap_or(DEFAULT_MULTIPLE_PX),
        channels: channels(metadata.custom("pelical.channels"), fixed(1))?,
        kpt_scale: kpt_scale(metadata.custom("pelical.kpt_scale"))?,
        fixed_size_px: [fixed(2), fixed(3)],
        descriptor_len,
        licence: metadata.custom("pelical.licence"),
    })
}

fn shape_of(session: &Session, input: &str) -> Option<Vec<i64>> {
    let input = session.inputs().iter().find(|found| found.name() == input)?;
    input.dtype().tensor_shape().map(|shape| shape.to_vec())
}

/// 1 or 3: what the graph fixes, else what the metadata say, else grey.
fn channels(said: Option<String>, fixed: Option<usize>) -> Result<usize, String> {
    let said = match said.as_deref().map(str::trim) {
        None => None,
        Some("grey") => Some(1),
        Some("rgb") => Some(3),
        Some(other) => {
            return Err(format!("its metadata say pelical.channels = {other:?}; allowed are grey and rgb"));
        }
    };
    match (said, fixed) {
        (Some(said), Some(fixed)) if said != fixed => {
            Err(format!("its metadata say {said} channels (pelical.channels), its input has {fixed}"))
        }
        _ => Ok(fixed.or(said).unwrap_or(1)),
    }
}

fn kpt_scale(said: Option<String>) -> Result<f64, String> {
    let Some(text) = said else { return Ok(1.0) };
    match text.trim().parse::<f64>() {
        Ok(scale) if (0.01..=100.0).contains(&scale) => Ok(scale),
        _ => Err(format!(
            "its metadata say pelical.kpt_scale = {text:?}; allowed is a number from 0.01 to 100"
        )),
    }
}
