//! Synthetic sensor frames with one value changed at a time, and the responses.

use super::response::{Duties, Input, MOTION, Responses, TURN_RAD, length};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::signals::{NavState, Reference};
use rotortwin_plant::STEP_NS;
use rotortwin_wire::frames::{CommandFrame, SensorFrame, Stamp};
use rotortwin_wire::link::{LinkError, PlantLink};
use std::time::{Duration, Instant};

/// Steps for which a change is held: 60 ms, longer than typical controller filters.
const HOLD: usize = 24;
/// Number of final steps that are evaluated.
const LOOK: usize = 8;
/// A change in duty well above rounding and well below the limits.
const CLEAR: f64 = 0.01;
/// A change in duty below which nothing is concluded: a tenth of a microsecond of pulse width.
const FLOOR: f64 = 1e-4;
/// Number of delay measurements, at different phases of the controller's own period.
const DELAYS: usize = 24;

/// Why probing cannot continue.
#[derive(Debug)]
pub(super) enum Trouble {
    /// The controller, or its link.
    Link(LinkError),
    /// The plant.
    Plant(String),
}

impl From<LinkError> for Trouble {
    fn from(error: LinkError) -> Self {
        Self::Link(error)
    }
}

/// Queries a controller, step by step.
pub(super) struct Prober<'a> {
    link: &'a mut dyn PlantLink,
    run_id: u64,
    rotors: usize,
    pub(super) steps: u64,
    /// Wall-clock time of each answer.
    pub(super) answers: Vec<Duration>,
}

/// Range of a controller's delays, steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Delays {
    pub(super) least: usize,
    pub(super) most: usize,
}

impl<'a> Prober<'a> {
    pub(super) fn new(link: &'a mut dyn PlantLink, run_id: u64, rotors: usize) -> Self {
        Self {
            link,
            run_id,
            rotors,
            steps: 0,
            answers: Vec::new(),
        }
    }

    /// A frame at its reference.
    pub(super) fn frame(&self, nav: &NavState, voltage_v: f32) -> SensorFrame {
        let reference = Reference {
            position_ned: nav.position_ned,
            ..Reference::default()
        };
        SensorFrame::new(Stamp::default(), nav, &reference, voltage_v)
    }

    /// One step.
    pub(super) fn exchange(&mut self, frame: SensorFrame) -> Result<CommandFrame, Trouble> {
        let stamp = Stamp {
            run_id: self.run_id,
            step: self.steps,
            sim_time_ns: self.steps * STEP_NS,
        };
        let begun = Instant::now();
        let command = self.link.exchange(&SensorFrame { stamp, ..frame })?;
        self.answers.push(begun.elapsed());
        self.steps += 1;
        while self.link.next_report(false)?.is_some() {}
        Ok(command)
    }

    fn duties(&mut self, frame: SensorFrame) -> Result<Duties, Trouble> {
        let command = self.exchange(frame)?;
        let mut duties = [0.0; MAX_ROTORS];
        for (duty, given) in duties.iter_mut().zip(&command.duty).take(self.rotors) {
            *duty = f64::from(*given);
        }
        Ok(duties)
    }

    /// Holds a frame and returns the mean of the last duties.
    pub(super) fn hold(&mut self, frame: SensorFrame) -> Result<Duties, Trouble> {
        let mut sum = [0.0; MAX_ROTORS];
        for step in 0..HOLD {
            let duties = self.duties(frame)?;
            if step >= HOLD - LOOK {
                for (sum, duty) in sum.iter_mut().zip(duties) {
                    *sum += duty / LOOK as f64;
                }
            }
        }
        Ok(sum)
    }

    /// Change of the duties per unit of one value: up, back, down, back, so that integrators end where they began. The change is increased
    /// until the response is clear, so that neither rounding nor limits are measured. Also returns the change used.
    pub(super) fn response(&mut self, base: SensorFrame, input: Input) -> Result<(Duties, f64), Trouble> {
        let [mut size, most] = input.sizes();
        loop {
            let mut pulse = |change: f64| {
                let mut frame = base;
                input.add(&mut frame, change);
                let duties = self.hold(frame)?;
                self.hold(base)?;
                Ok::<Duties, Trouble>(duties)
            };
            let (above, below) = (pulse(size)?, pulse(-size)?);
            let difference: Duties = std::array::from_fn(|i| 0.5 * (above[i] - below[i]));
            let clear = difference.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            if clear >= CLEAR || size >= most {
                let difference = if clear < FLOOR { [0.0; MAX_ROTORS] } else { difference };
                return Ok((difference.map(|x| x / size), size));
            }
            let factor = if clear > 0.0 { 2.0 * CLEAR / clear } else { 16.0 };
            size = (size * factor.clamp(2.0, 16.0)).min(most);
        }
    }

    /// Steps from a change of one value to the first change of the duties.
    pub(super) fn delays(&mut self, base: SensorFrame, input: Input, size: f64) -> Result<Option<Delays>, Trouble> {
        let mut delays: Option<Delays> = None;
        let mut sign = 1.0;
        for round in 0..DELAYS {
            // Not synchronised with any period of a controller.
            for _ in 0..HOLD + (5 * round) % 13 {
                self.duties(base)?;
            }
            let before = self.duties(base)?;
            let mut frame = base;
            input.add(&mut frame, sign * size);
            sign = -sign;
            for delay in 0..HOLD {
                let now = self.duties(frame)?;
                let change: Duties = std::array::from_fn(|i| now[i] - before[i]);
                if length(&change) > FLOOR {
                    let known = delays.get_or_insert(Delays {
                        least: delay,
                        most: delay,
                    });
                    known.least = known.least.min(delay);
                    known.most = known.most.max(delay);
                    break;
                }
            }
        }
        self.hold(base)?;
        Ok(delays)
    }

    /// Responses to all motion values.
    pub(super) fn responses(&mut self, base: SensorFrame, delay_steps: usize) -> Result<Responses, Trouble> {
        let mut motion = [[0.0; MAX_ROTORS]; MOTION];
        for (i, column) in motion.iter_mut().enumerate() {
            *column = self.response(base, Input::Motion(i))?.0;
        }
        let turned = Self::turned(base);
        self.hold(turned)?;
        let turned_north = self.response(turned, Input::Motion(0))?.0;
        self.hold(base)?;
        Ok(Responses {
            motion,
            turned_north,
            delay_steps,
        })
    }

    /// The same vehicle at its reference, yawed.
    fn turned(base: SensorFrame) -> SensorFrame {
        let mut frame = base;
        frame.attitude_rad[2] += TURN_RAD as f32;
        frame.reference_yaw_rad += TURN_RAD as f32;
        frame
    }
}
