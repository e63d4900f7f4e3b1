//! Our own controller and FDI engine in parallel with the board, on the same inputs: finds the first differing bit.

use rotortwin_proto::Role;
use rotortwin_wire::frames::{CommandFrame, FdiReport, LossEstimate, SensorFrame};
use rotortwin_wire::link::{ControllerPeer, FdiPeer, LinkError, RunSetup};
use rotortwin_wire::peers::{FdiEnginePeer, PidPeer};

/// First difference between board and host.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// First step that differs.
    pub step: u64,
    /// First differing signal.
    pub signal: String,
    /// Value of the board.
    pub board: f64,
    /// Value of the host.
    pub host: f64,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            step,
            signal,
            board,
            host,
        } = self;
        write!(
            out,
            "board and host first differ in step {step}, {signal}: board {board:e}, host {host:e}"
        )
    }
}

/// See the module documentation.
#[derive(Default)]
pub(crate) struct Shadow {
    controller: PidPeer,
    fdi: FdiEnginePeer,
    compared: u64,
    first: Option<Difference>,
}

impl Shadow {
    pub(crate) fn setup(&mut self, setup: &RunSetup) -> Result<(), LinkError> {
        let refused = |role| move |reason| LinkError::Refused { role, reason };
        self.controller
            .setup(&setup.controller)
            .map_err(refused(Role::Controller))?;
        self.fdi.setup(&setup.fdi).map_err(refused(Role::Fdi))
    }

    pub(crate) fn first_difference(&self) -> Option<Difference> {
        self.first.clone()
    }

    pub(crate) fn compared(&self) -> u64 {
        self.compared
    }

    /// Compares with the host's result for the same inputs; the FDI engine gets the host's own command.
    pub(crate) fn compare(&mut self, sensors: &SensorFrame, command: &CommandFrame, report: &FdiReport) {
        if self.first.is_some() {
            return;
        }
        self.compared += 1;
        let host_command = self.controller.step(sensors).canonical();
        let host_report = self.fdi.step(sensors, &host_command).canonical();
        let board = command_values(command).chain(report_values(report));
        let host = command_values(&host_command).chain(report_values(&host_report));
        let difference = board.zip(host).find(|((_, a), (_, b))| a.to_bits() != b.to_bits());
        self.first = difference.map(|((signal, board), (_, host))| Difference {
            step: sensors.stamp.step,
            signal: signal.name(),
            board,
            host,
        });
    }
}

/// A number of a frame, whose name is only formatted on demand.
struct Signal(&'static str, Option<usize>);

impl Signal {
    fn name(&self) -> String {
        match self.1 {
            Some(index) => format!("{}[{index}]", self.0),
            None => self.0.to_owned(),
        }
    }
}

fn row<'a>(name: &'static str, values: &'a [f32]) -> impl Iterator<Item = (Signal, f64)> + 'a {
    values
        .iter()
        .enumerate()
        .map(move |(index, value)| (Signal(name, Some(index)), f64::from(*value)))
}

fn command_values(frame: &CommandFrame) -> impl Iterator<Item = (Signal, f64)> + '_ {
    row("duty", &frame.duty)
        .chain(row("attitude_setpoint_rad", &frame.attitude_setpoint_rad))
        .chain(std::iter::once((
            Signal("saturated_rotors", None),
            f64::from(frame.saturated_rotors),
        )))
}

fn report_values(frame: &FdiReport) -> impl Iterator<Item = (Signal, f64)> + '_ {
    let loss = |name: &'static str, loss: &LossEstimate| {
        let values = loss.values();
        (0..values.len()).map(move |index| (Signal(name, Some(index)), f64::from(values[index])))
    };
    let numbers = [
        ("t_test", f64::from(frame.t_test)),
        ("network", f64::from(frame.network)),
        ("sequential", f64::from(frame.sequential)),
        ("sequential_probability", f64::from(frame.sequential_probability)),
        ("suspect_rotors", f64::from(frame.suspect_rotors)),
        ("hypothesis_count", f64::from(frame.hypothesis_count)),
        ("window_end", f64::from(frame.window_end)),
    ];
    let sets = frame.hypothesis_rotors.iter().enumerate();
    row("wrench_residual", &frame.wrench_residual)
        .chain(row("residuals_nms", frame.residuals_nms.as_flattened()))
        .chain(numbers.into_iter().map(|(name, value)| (Signal(name, None), value)))
        .chain(loss("thrust_loss", &frame.thrust_loss))
        .chain(loss("second_thrust_loss", &frame.second_thrust_loss))
        .chain(sets.map(|(index, set)| (Signal("hypothesis_rotors", Some(index)), f64::from(*set))))
}
