//! Plant, controller and FDI engine in one process: a step is two function calls.
//!
//! The fastest link, and the reference for the others: no threads, no copies beyond the frames, no clock. It performs the
//! same checks and delivers the same `canonical` frames as the links between processes, so a run has the same hash over
//! each.

use super::{ControllerPeer, FdiPeer, LinkError, PlantLink, RunSetup};
use crate::autopilot::Identity;
use crate::convert;
use crate::frames::{CommandFrame, FdiReport, SensorFrame};
use rotortwin_proto::Role;
use std::collections::VecDeque;

/// [`PlantLink`] to a controller and an FDI engine in this process.
#[derive(Clone, Debug)]
pub struct InProcessLink<C, F> {
    controller: C,
    fdi: F,
    rotor_count: usize,
    /// Reports not yet taken; a caller that takes one per step leaves at most one here.
    reports: VecDeque<FdiReport>,
}

impl<C: ControllerPeer, F: FdiPeer> InProcessLink<C, F> {
    /// A link to these peers.
    pub fn new(controller: C, fdi: F) -> Self {
        Self {
            controller,
            fdi,
            rotor_count: 0,
            reports: VecDeque::with_capacity(4),
        }
    }

    /// The controller.
    pub fn controller_mut(&mut self) -> &mut C {
        &mut self.controller
    }

    /// The two peers, for instance to look at their state after the run.
    pub fn into_peers(self) -> (C, F) {
        (self.controller, self.fdi)
    }
}

impl<C: ControllerPeer, F: FdiPeer> PlantLink for InProcessLink<C, F> {
    fn open(&mut self, setup: &RunSetup) -> Result<(), LinkError> {
        self.rotor_count = setup.controller.rotors.len();
        self.controller
            .setup(&setup.controller)
            .map_err(|reason| LinkError::Refused {
                role: Role::Controller,
                reason,
            })?;
        self.fdi.setup(&setup.fdi).map_err(|reason| LinkError::Refused {
            role: Role::Fdi,
            reason,
        })
    }

    #[inline]
    fn exchange(&mut self, sensors: &SensorFrame) -> Result<CommandFrame, LinkError> {
        let step = sensors.stamp.step;
        let sensors = sensors.canonical();
        convert::check_sensors(&sensors).map_err(|error| protocol_violation(Role::Plant, step, &error))?;
        let mut command = self.controller.step(&sensors).canonical();
        command.stamp = sensors.stamp;
        convert::check_command(&command, self.rotor_count)
            .map_err(|error| protocol_violation(Role::Controller, step, &error))?;
        let mut report = self.fdi.step(&sensors, &command).canonical();
        report.stamp = sensors.stamp;
        convert::check_report(&report, self.rotor_count)
            .map_err(|error| protocol_violation(Role::Fdi, step, &error))?;
        self.reports.push_back(report);
        Ok(command)
    }

    #[inline]
    fn next_report(&mut self, _wait: bool) -> Result<Option<FdiReport>, LinkError> {
        Ok(self.reports.pop_front())
    }

    fn controller(&self) -> Option<Identity> {
        Some(Identity::of_program(&self.controller.program()))
    }

    fn finish(&mut self, _steps: u64, _failure: Option<&str>) {}
}

#[cold]
fn protocol_violation(role: Role, step: u64, error: &convert::ConvertError) -> LinkError {
    LinkError::ProtocolViolation {
        role,
        step,
        reason: error.to_string(),
    }
}
