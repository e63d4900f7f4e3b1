//! Harness of the system tests: they start `rotortwin` as people do, disturb its processes, and look at what is left.
//!
//! ```text
//!  test ── Scratch (folder, iceoryx2 domain) ── Fly ──▶ Run ── Members (supervisor, sim, controller, fdi) ── signals
//!                                                        └──▶ Ended (exit code, output, summary)
//! ```
//! * [`scratch`]: a place of its own for each test, scenarios in it, and what a run leaves in shared memory;
//! * [`program`]: the program under test, runs of it, what they print and leave;
//! * [`process`]: the processes of a run, found and disturbed through the kernel;
//! * [`random`]: seeded choices of moments and victims.
//! * [`server`]: a server under test, its workers, and requests to it;
//! * [`websocket`]: what a server tells by WebSocket;
//! * [`postgres`]: a Postgres of one's own;
//! * [`slurm`]: a Slurm cluster of two nodes;
//! * [`ray`]: a Ray cluster of two nodes;
//! * [`python`]: Python with the client and what its tests need.
//! * [`disk`]: a disk that is soon full;
//! * [`cable`]: a connection that is cut without a word;
//! * [`certificates`]: certificates of a test;
//! * [`hosts`]: several hosts on one machine.
//!
//! Every wait has a deadline; a test that misses one fails with what the run has printed so far. A run that a failing test leaves
//! behind is killed.
//!
//! Linux only: processes are looked up in `/proc`, shared memory in `/dev/shm`.

pub mod accepted;
pub mod bucket;
pub mod cable;
pub mod certificates;
pub mod clock;
pub mod columns;
pub mod disk;
pub mod foxglove;
pub mod hosts;
pub mod postgres;
pub mod process;
pub mod program;
pub mod python;
pub mod random;
pub mod ray;
pub mod scratch;
pub mod server;
mod skip;
pub mod slurm;
pub mod telemetry;
pub mod websocket;

pub use skip::skip;
