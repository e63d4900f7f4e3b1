//! Vectors, rotations and 3×3 matrices of the passes; rows first.

use rotortwin_plant::Vector3;

/// R of Eq. 2, rows first.
pub(crate) fn rotation(attitude: Vector3) -> [Vector3; 3] {
    let (sr, cr) = libm::sincos(attitude[0]);
    let (sp, cp) = libm::sincos(attitude[1]);
    let (sy, cy) = libm::sincos(attitude[2]);
    [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
}

/// η̇ = T(η) ω, with the sines and cosines of η taken from R (pitch within ±π/2).
pub(crate) fn euler_rates(ned_from_body: &[Vector3; 3], rates: Vector3) -> Vector3 {
    let [minus_sp, sr_cp, cr_cp] = ned_from_body[2];
    let (sp, cp) = (-minus_sp, (sr_cp * sr_cp + cr_cp * cr_cp).sqrt());
    let (sr, cr) = (sr_cp / cp, cr_cp / cp);
    let across = sr * rates[1] + cr * rates[2];
    [rates[0] + across * sp / cp, cr * rates[1] - sr * rates[2], across / cp]
}

pub(crate) fn to_body(r: &[Vector3; 3], v: Vector3) -> Vector3 {
    [0, 1, 2].map(|i| r[0][i] * v[0] + r[1][i] * v[1] + r[2][i] * v[2])
}

#[inline]
pub(crate) fn times(m: &[Vector3; 3], v: Vector3) -> Vector3 {
    // Not `map`, which the compiler leaves a call in the hottest loop of all.
    let dot = |row: &Vector3| row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
    [dot(&m[0]), dot(&m[1]), dot(&m[2])]
}

pub(crate) fn cross(a: Vector3, b: Vector3) -> Vector3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Inverse of a 3×3 matrix by cofactors.
pub(crate) fn inverted(m: &[Vector3; 3]) -> [Vector3; 3] {
    let rows = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
    let per = 1.0 / (m[0][0] * rows[0][0] + m[0][1] * rows[0][1] + m[0][2] * rows[0][2]);
    [0, 1, 2].map(|i| [rows[0][i] * per, rows[1][i] * per, rows[2][i] * per])
}
