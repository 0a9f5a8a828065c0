//! A number for every pair of lines of two images, small for alike ones, and what is best in its rows and columns.

/// Rows are lines of the target, columns of the source; infinite entries are no pair.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    values: Vec<f32>,
    n_columns: usize,
}

/// The least two of a row or column; infinite where there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LeastTwo {
    pub(super) first: f32,
    pub(super) at: usize,
    pub(super) second: f32,
}

impl Default for LeastTwo {
    fn default() -> Self {
        Self { first: f32::INFINITY, at: usize::MAX, second: f32::INFINITY }
    }
}

impl LeastTwo {
    fn of(values: impl Iterator<Item = f32>) -> Self {
        let mut least = Self::default();
        values.enumerate().for_each(|(at, value)| least.take(at, value));
        least
    }

    pub(super) fn take(&mut self, at: usize, value: f32) {
        if value < self.first {
            *self = Self { first: value, at, second: self.first };
        } else if value < self.second {
            self.second = value;
        }
    }

    /// The least of all others than this entry.
    pub(super) fn other_than(&self, at: usize) -> f32 {
        if self.at == at { self.second } else { self.first }
    }
}

impl Table {
    pub(super) fn new((n_rows, n_columns): (usize, usize), value: impl Fn(usize, usize) -> f32) -> Self {
        let mut values = Vec::with_capacity(n_rows * n_columns);
        for row in 0..n_rows {
            values.extend((0..n_columns).map(|column| value(row, column)));
        }
        Self { values, n_columns }
    }

    pub(super) fn at(&self, row: usize, column: usize) -> f32 {
        self.values[row * self.n_columns + column]
    }

    fn n_rows(&self) -> usize {
        self.values.len().checked_div(self.n_columns).unwrap_or(0)
    }

    fn column(&self, column: usize) -> impl Iterator<Item = f32> {
        self.values.iter().copied().skip(column).step_by(self.n_columns)
    }

    pub(super) fn least_of_rows(&self) -> Vec<LeastTwo> {
        self.values.chunks(self.n_columns.max(1)).map(|row| LeastTwo::of(row.iter().copied())).collect()
    }

    pub(super) fn least_of_columns(&self) -> Vec<LeastTwo> {
        (0..self.n_columns).map(|column| LeastTwo::of(self.column(column))).collect()
    }

    /// Entries that are the least of their row and of their column.
    pub(super) fn mutual_best(&self) -> impl Iterator<Item = (usize, usize)> {
        let columns = self.least_of_columns();
        let rows = self.least_of_rows().into_iter().enumerate();
        rows.filter_map(move |(row, least)| (columns.get(least.at)?.at == row).then_some((row, least.at)))
    }

    /// The `n` least of each row and of each column, row by row; no entry twice.
    pub(super) fn shortlist(&self, n: usize) -> Vec<(usize, usize)> {
        let mut is_kept = vec![false; self.values.len()];
        let mut order = Vec::new();
        let mut keep = |entries: &mut dyn Iterator<Item = usize>| {
            order.clear();
            order.extend(entries.filter(|idx| self.values[*idx].is_finite()));
            let by_value = |a: &usize, b: &usize| self.values[*a].total_cmp(&self.values[*b]).then(a.cmp(b));
            if order.len() > n {
                order.select_nth_unstable_by(n, by_value);
            }
            order.iter().take(n).for_each(|idx| is_kept[*idx] = true);
        };
        (0..self.n_rows()).for_each(|row| keep(&mut (row * self.n_columns..(row + 1) * self.n_columns)));
        (0..self.n_columns).for_each(|column| keep(&mut (column..self.values.len()).step_by(self.n_columns)));
        let kept = is_kept.iter().enumerate().filter(|(_, is_kept)| **is_kept);
        kept.map(|(idx, _)| (idx / self.n_columns, idx % self.n_columns)).collect()
    }
}
