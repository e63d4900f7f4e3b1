//! Three numbers with the few operations that the plant needs; frame and unit stand in the name of the variable.

/// A vector of three `f64`.
pub type Vector3 = [f64; 3];

/// Vector product, right-handed.
#[inline(always)]
pub(crate) fn cross(a: Vector3, b: Vector3) -> Vector3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Euclidean length.
#[inline(always)]
pub(crate) fn length(a: Vector3) -> f64 {
    (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt()
}
