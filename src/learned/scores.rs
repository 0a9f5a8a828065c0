//! How alike the lines of two images are: a matrix over those lines that were looked at.

/// Scores of all pairs of two lists of lines, 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scores {
    /// Indices of the target lines, one a row.
    pub(super) target: Vec<usize>,
    /// Indices of the source lines, one a column.
    pub(super) source: Vec<usize>,
    /// Row by row.
    pub(super) values: Vec<f32>,
}

impl Scores {
    /// The matrix that `score` gives for rows and columns.
    pub(super) fn new(
        target: Vec<usize>,
        source: Vec<usize>,
        mut score: impl FnMut(usize, usize) -> f32,
    ) -> Self {
        let mut values = Vec::with_capacity(target.len() * source.len());
        for row in 0..target.len() {
            values.extend((0..source.len()).map(|col| score(row, col)));
        }
        Self { target, source, values }
    }

    /// No line of one image or the other.
    pub(super) fn none() -> Self {
        Self { target: Vec::new(), source: Vec::new(), values: Vec::new() }
    }

    /// The score of a row and a column.
    pub(super) fn at(&self, row: usize, col: usize) -> f32 {
        self.values[row * self.source.len() + col]
    }

    /// The largest score of each row and of each column; 0 where nothing is larger.
    pub(super) fn best(&self) -> (Vec<f32>, Vec<f32>) {
        let (mut of_row, mut of_col) = (vec![0.0_f32; self.target.len()], vec![0.0_f32; self.source.len()]);
        for (row, values) in self.values.chunks_exact(self.source.len().max(1)).enumerate() {
            for (col, &value) in values.iter().enumerate() {
                of_row[row] = of_row[row].max(value);
                of_col[col] = of_col[col].max(value);
            }
        }
        (of_row, of_col)
    }
}
