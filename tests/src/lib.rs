//! Harness of the system tests: starts `rotortwin` as users do, disturbs its processes, and checks the results.
//!
//! ```text
//!  test ── Scratch (folder, iceoryx2 domain) ── Fly ──▶ Run ── Members (supervisor, sim, controller, fdi) ── signals
//!                                                        └──▶ Ended (exit code, output, summary)
//! ```
//! * [`scratch`]: an isolated folder for each test, scenarios in it, and a run's remains in shared memory;
//! * [`program`]: the program under test, its runs and their output;
//! * [`process`]: the processes of a run, found and disturbed through the kernel;
//! * [`random`]: seeded choices of times and victims.
//! * [`server`]: a server under test, its workers, and requests to it;
//! * [`websocket`]: a server's WebSocket messages;
//! * [`postgres`]: a private Postgres;
//! * [`slurm`]: a Slurm cluster of two nodes;
//! * [`ray`]: a Ray cluster of two nodes;
//! * [`python`]: Python with the client and its test dependencies.
//! * [`disk`]: a small disk;
//! * [`cable`]: a connection that can be cut silently;
//! * [`certificates`]: certificates for a test;
//! * [`hosts`]: several hosts on one machine.
//!
//! Every wait has a deadline; a test that misses one fails with the run's output so far. A run left behind by a failing test is
//! killed.
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
