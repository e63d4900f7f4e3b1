//! Flight code that runs bit-identically on the host and on the Pixhawk's Cortex-M7.
//!
//! `no_std`, `f32`, no allocation. All transcendental functions come from [`libm`] on both sides and nothing uses a fused
//! multiply-add, so that host and target agree to the last bit.
//!
//! ```text
//!  Reference ─▶ control ── MotorCommand ─▶ (plant) ── NavState ─┐
//!                 ▲                 │                           │
//!                 └─────────────────┼───────────────────────────┤
//!                                   ▼                           ▼
//!            Measurement { nav, duty, battery_voltage } ─▶ fdi ─▶ FdiOutput
//! ```
//!
//! * [`frames`], [`signals`]: frame-typed vectors, and the signals that cross a boundary.
//! * [`geometry`], [`thrust_map`]: the vehicle model (Eqs. 5–6, 19, 36–39 of the paper).
//! * [`control`]: cascaded PID and control allocation (Table 5).
//! * [`fdi`]: residual generators (Eqs. 31–32), T-test, network, sequential detector.
//!
//! Conventions: SI units, radians, NED world, FRD body, ZYX Euler angles, rotor indices from 0.
//! Equation and table numbers are those of the paper; `docs/paper-map.md` lists them.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod control;
pub mod elementary;
pub mod fdi;
pub mod frames;
pub mod geometry;
mod linear_algebra;
pub mod signals;
#[cfg(test)]
mod test_plant;
pub mod thrust_map;

/// Maximum rotor count. All per-rotor arrays have this length; entries past the vehicle's rotor count are zero.
pub const MAX_ROTORS: usize = 16;
