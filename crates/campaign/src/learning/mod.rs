//! Training of shallow networks: f64, bit-identical on every machine and for every number of threads.
//!
//! ```text
//!  Samples ─▶ split (70/30, stratified) ─▶ z-score of the training part ─▶ epochs of mini-batches ─▶ Trained
//! ```
//!
//! * [`samples`]: features and labels, the stratified split, the z-score. * [`network`]: one hidden layer, forward and gradient.
//! * [`optimiser`]: SGDM as in Table 5, and Adam. * [`training`]: the loop over epochs. * [`matrix`]: the products behind it.
//!
//! Sums are taken in a fixed order, without fused multiply-add; transcendental functions come from `libm`; random numbers come from
//! a named stream of the seed. Inference in flight is `flight-core`'s, in f32.

pub mod matrix;
pub mod network;
pub mod optimiser;
pub mod samples;
pub mod training;
