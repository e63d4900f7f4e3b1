//! The blind bench's generator: an independent simulator that writes logs with hidden effects.
//!
//! It must be independent. It depends on no physics crate of the product, so the compiler keeps physics, integrator,
//! lag, random streams, trajectories and controller separate from those of the product; only the numbers in the vehicle
//! documents are shared. A diagnosis that recovers a hidden effect from these logs has not merely recovered its own
//! equations.
//!
//! ```text
//!  vehicle.toml ─┐
//!  effects, seed ┼─▶ FlightPlan ─▶ reference ─▶ pilot ─▶ world ─▶ sensors ─▶ log.parquet   (all that the diagnosis sees)
//!  flight script ┘                    ▲                    │          │
//!                                     └────── noisy state ◀┘          └────▶ truth.json    (for the score only)
//! ```
//!
//! Same seed, same bytes. Limits: flat ground at height 0, rigid rotors, one wind everywhere; the equations of catalogue effects
//! are those of the catalogue, so a wrong equation there is not found by this bench.

pub mod bench;
pub mod catalogue;
pub mod command;
pub mod draw;
pub mod error;
pub mod example;
pub mod flight;
pub mod hidden;
pub mod log_file;
pub mod pilot;
pub mod random;
pub mod script;
pub mod truth;
pub mod vehicle;
pub mod world;
