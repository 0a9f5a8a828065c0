//! What a model is for: told by the names of its inputs, and checked against the shapes and types that this use needs.
//!
//! A graph that does not fit is refused when it is loaded, with the input or output that is wrong and what is allowed.

use ort::session::Session;
use ort::value::{Outlet, TensorElementType, ValueType};

/// The uses of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Contract {
    /// One image in, a map of descriptors out.
    Dense,
    /// Key points and descriptors of two images in, their assignment out.
    Glue,
    /// Two images and their segments in, scores of pairs of lines out.
    Lines,
    /// Wireframes of two images in, the logarithm of the assignment of their lines out.
    Wireframe,
}

/// One dimension of an input or output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Dim {
    /// This many.
    Exactly(i64),
    /// 1 or 3.
    Channels,
    /// Any fixed size, or free.
    Any,
    /// Free: it differs from image to image.
    Free,
}

type Shape = &'static [Dim];
/// Name, whether it holds whole numbers (else 32-bit floats), shape.
type Input = (&'static str, bool, Shape);

const ONE: Dim = Dim::Exactly(1);
const TWO: Dim = Dim::Exactly(2);
const POINTS: Shape = &[ONE, Dim::Free, TWO];
const GREY_OR_COLOUR: Shape = &[ONE, Dim::Channels, Dim::Any, Dim::Any];
const SEGMENTS: Shape = &[ONE, Dim::Free, TWO, TWO];

impl Contract {
    const ALL: [Contract; 4] = [Contract::Dense, Contract::Glue, Contract::Lines, Contract::Wireframe];

    /// As in the docs.
    pub(super) fn name(self) -> &'static str {
        match self {
            Contract::Dense => "dense",
            Contract::Glue => "glue",
            Contract::Lines => "lines",
            Contract::Wireframe => "wireframe",
        }
    }

    /// Name and number of dimensions of the one output that is used.
    pub(super) fn output(self) -> (&'static str, usize) {
        match self {
            Contract::Dense => ("descriptors", 4),
            Contract::Glue => ("scores", 3),
            Contract::Lines => ("line_scores", 3),
            Contract::Wireframe => ("line_log_assignment", 3),
        }
    }

    /// Every input; of those that come twice the one of the first image, without its 0.
    fn inputs(self) -> &'static [Input] {
        match self {
            Contract::Dense => &[("image", false, GREY_OR_COLOUR)],
            Contract::Glue => &[("kpts", false, POINTS), ("desc", false, &[ONE, Dim::Free, Dim::Any])],
            Contract::Lines => &[("image", false, GREY_OR_COLOUR), ("lines", false, SEGMENTS)],
            Contract::Wireframe => &[
                ("kpts", false, POINTS),
                ("kpt_scores", false, &[ONE, Dim::Free]),
                ("desc", false, &[ONE, Dim::Any, Dim::Free]),
                ("lines", false, SEGMENTS),
                ("line_scores", false, &[ONE, Dim::Free]),
                ("junc", true, &[ONE, Dim::Free, TWO]),
                ("size", false, &[ONE, TWO]),
            ],
        }
    }

    /// The same with the names as in the graph, sorted.
    fn named_inputs(self) -> Vec<(String, bool, Shape)> {
        let of = |suffix: &'static str| {
            self.inputs().iter().map(move |&(name, whole, shape)| (format!("{name}{suffix}"), whole, shape))
        };
        let mut inputs: Vec<_> = match self {
            Contract::Dense => of("").collect(),
            _ => of("0").chain(of("1")).collect(),
        };
        inputs.sort_by(|a, b| a.0.cmp(&b.0));
        inputs
    }

    /// The contract of a session, by the names of its inputs; the shapes and types are checked.
    ///
    /// # Errors
    /// One sentence: the names, type or shape that do not fit, and what is allowed.
    pub(super) fn of(session: &Session) -> Result<Self, String> {
        let mut names: Vec<&str> = session.inputs().iter().map(Outlet::name).collect();
        names.sort_unstable();
        let fits = |contract: &Contract| {
            contract.named_inputs().iter().map(|input| &*input.0).eq(names.iter().copied())
        };
        let Some(contract) = Self::ALL.into_iter().find(fits) else {
            let allowed: Vec<String> = Self::ALL.into_iter().map(Self::signature).collect();
            return Err(format!("its inputs are {}; allowed are {}", names.join(", "), allowed.join(" or ")));
        };
        for (name, whole, shape) in contract.named_inputs() {
            let found = session.inputs().iter().find(|input| input.name() == name);
            found.map_or(Ok(()), |found| check_input(found, whole, shape))?;
        }
        let (name, rank) = contract.output();
        let Some(output) = session.outputs().iter().find(|output| output.name() == name) else {
            let names: Vec<&str> = session.outputs().iter().map(Outlet::name).collect();
            let contract = contract.name();
            return Err(format!(
                "as a model `{contract}` it needs the output {name}, but has {}",
                names.join(", ")
            ));
        };
        check_output(output, rank)?;
        Ok(contract)
    }

    fn signature(self) -> String {
        let names: Vec<String> = self.named_inputs().into_iter().map(|(name, ..)| name).collect();
        format!("{} (`{}`)", names.join(", "), self.name())
    }
}

fn check_input(input: &Outlet, whole: bool, shape: Shape) -> Result<(), String> {
    let name = input.name();
    let wanted = if whole { TensorElementType::Int64 } else { TensorElementType::Float32 };
    let ValueType::Tensor { ty, shape: found, .. } = input.dtype() else {
        return Err(format!("its input {name} is not a tensor"));
    };
    if *ty != wanted {
        return Err(format!("its input {name} is of type {ty}; it must be {wanted}"));
    }
    let fits = |(&found, dim): (&i64, &Dim)| match *dim {
        Dim::Exactly(size) => found == size || found < 0,
        Dim::Channels => found == 1 || found == 3 || found < 0,
        Dim::Any => found != 0,
        Dim::Free => found < 0,
    };
    if found.len() == shape.len() && found.iter().zip(shape).all(fits) {
        return Ok(());
    }
    let dims: Vec<String> = shape.iter().map(|dim| dim.to_string()).collect();
    Err(format!("its input {name} has the shape {}; it must be [{}]", written(found), dims.join(", ")))
}

fn check_output(output: &Outlet, rank: usize) -> Result<(), String> {
    let name = output.name();
    let ValueType::Tensor { ty, shape, .. } = output.dtype() else {
        return Err(format!("its output {name} is not a tensor"));
    };
    if *ty != TensorElementType::Float32 {
        return Err(format!("its output {name} is of type {ty}; it must be {}", TensorElementType::Float32));
    }
    // A graph may leave the shape of an output open altogether.
    if shape.is_empty() || shape.len() == rank {
        return Ok(());
    }
    Err(format!("its output {name} has the shape {}; it must have {rank} dimensions", written(shape)))
}

/// A shape for people.
pub(super) fn written(shape: &[i64]) -> String {
    let dim = |&size: &i64| if size < 0 { "free".to_owned() } else { size.to_string() };
    format!("[{}]", shape.iter().map(dim).collect::<Vec<_>>().join(", "))
}

impl std::fmt::Display for Dim {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Dim::Exactly(size) => write!(f, "{size}"),
            Dim::Channels => write!(f, "1 or 3"),
            Dim::Any => write!(f, "any"),
            Dim::Free => write!(f, "free"),
        }
    }
}
