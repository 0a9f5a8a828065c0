//! Constant tables of polynomials of degree eight: from values to powers, and from powers to Bernstein coefficients.

/// Of a polynomial of degree eight.
pub const N_COEFFICIENTS: usize = 9;

/// Coefficients of `u^i v^(8 - i)`, or of `x^i`.
pub type Octic = [f64; N_COEFFICIENTS];

const COS_20_DEG: f64 = 0.939_692_620_785_908_4;
const SIN_20_DEG: f64 = 0.342_020_143_325_668_7;
const COS_40_DEG: f64 = 0.766_044_443_118_978;
const SIN_40_DEG: f64 = 0.642_787_609_686_539_4;
const SIN_60_DEG: f64 = 0.866_025_403_784_438_6;
const COS_80_DEG: f64 = 0.173_648_177_666_930_33;
const SIN_80_DEG: f64 = 0.984_807_753_012_208;

/// (u, v) every 20 degrees of half a circle: there a homogeneous polynomial is a Fourier sum, which loses no digits.
pub const NODES: [(f64, f64); N_COEFFICIENTS] = [
    (1.0, 0.0),
    (COS_20_DEG, SIN_20_DEG),
    (COS_40_DEG, SIN_40_DEG),
    (0.5, SIN_60_DEG),
    (COS_80_DEG, SIN_80_DEG),
    (-COS_80_DEG, SIN_80_DEG),
    (-0.5, SIN_60_DEG),
    (-COS_40_DEG, SIN_40_DEG),
    (-COS_20_DEG, SIN_20_DEG),
];

/// Row k holds what a value of 1 at node k, and 0 at the others, adds to each coefficient (Lagrange's polynomials).
pub const POWERS_OF_VALUES: [Octic; N_COEFFICIENTS] = powers_of_values();
/// Row k holds the Bernstein coefficients of x^k on -1..1.
pub const BERNSTEIN_OF_POWERS: [Octic; N_COEFFICIENTS] = bernstein_of_powers();

/// The product over the other nodes (u', v') of (u v' - v u'), divided by its value at the node.
const fn powers_of_values() -> [Octic; N_COEFFICIENTS] {
    let mut table = [[0.0; N_COEFFICIENTS]; N_COEFFICIENTS];
    let mut node = 0;
    while node < N_COEFFICIENTS {
        let (u, v) = NODES[node];
        let mut product = [0.0; N_COEFFICIENTS];
        product[0] = 1.0;
        let mut other = 0;
        while other < N_COEFFICIENTS {
            if other != node {
                let (other_u, other_v) = NODES[other];
                let at_node = u * other_v - v * other_u;
                let mut i = N_COEFFICIENTS;
                while i > 0 {
                    i -= 1;
                    let lower = if i > 0 { product[i - 1] } else { 0.0 };
                    product[i] = (lower * other_v - product[i] * other_u) / at_node;
                }
            }
            other += 1;
        }
        table[node] = product;
        node += 1;
    }
    table
}

/// With t = (x + 1) / 2: `x^k = (t - (1 - t))^k (t + (1 - t))^(8 - k)`, expanded in `C(8, i) t^i (1 - t)^(8 - i)`.
const fn bernstein_of_powers() -> [Octic; N_COEFFICIENTS] {
    let degree = N_COEFFICIENTS - 1;
    let mut table = [[0.0; N_COEFFICIENTS]; N_COEFFICIENTS];
    let mut k = 0;
    while k <= degree {
        let mut i = 0;
        while i <= degree {
            let mut j = 0;
            while j <= i && j <= k {
                let sign = if (k - j).is_multiple_of(2) { 1.0 } else { -1.0 };
                let ways = (binomial(k, j) * binomial(degree - k, i - j)) as f64;
                table[k][i] += sign * ways / binomial(degree, i) as f64;
                j += 1;
            }
            i += 1;
        }
        k += 1;
    }
    table
}

const fn binomial(n: usize, k: usize) -> usize {
    if k > n {
        return 0;
    }
    let mut value = 1;
    let mut i = 0;
    while i < k {
        value = value * (n - i) / (i + 1);
        i += 1;
    }
    value
}
