//! The least certain axis of a covariance, and how to name it for people.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Standard deviation along the worst direction, and that direction.
pub fn worst_axis(covariance: &Matrix3<f64>) -> (f64, Vector3<f64>) {
    let eigen = SymmetricEigen::new(*covariance);
    let worst = eigen.eigenvalues.imax();
    (eigen.eigenvalues[worst].max(0.0).sqrt(), eigen.eigenvectors.column(worst).into_owned())
}

/// An axis of an optical frame for people.
pub fn in_words(axis: &Vector3<f64>) -> String {
    let name = ["x (right)", "y (down)", "z (forward)"][axis.iamax()];
    if axis.amax() > 0.9 {
        name.to_owned()
    } else {
        format!("direction [{:.2}, {:.2}, {:.2}], mostly {name}", axis.x, axis.y, axis.z)
    }
}
