//! Battery: open-circuit voltage over charge, voltage drop over the internal resistance, Coulomb counting (Eqs. 7–9).
//!
//! The rotors ask for electrical power, P = k_P Σ f^1.5 (momentum theory); the terminal voltage is the upper root of
//! V = V_oc − R P/V. Limits: no temperature, no ageing, no relaxation (order 0), the chart is one of many LiPo charts.

use serde::{Deserialize, Serialize};

use crate::error::{Refusal, all_in_range, in_range};

/// Open-circuit voltage over charge (Eq. 7).
pub(crate) trait Chart {
    /// V_oc, V.
    fn open_circuit_voltage(&mut self, state_of_charge: f64) -> f64;
}

/// Battery of a vehicle document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BatteryModel {
    /// Cells in series.
    pub cells: u32,
    /// Q_nom, Ah.
    pub capacity_ah: f64,
    /// R_in of the whole pack, Ω.
    pub internal_resistance_ohm: f64,
    /// k_P, W/N^1.5: electrical power of one rotor is k_P f^1.5.
    pub power_coefficient_w_per_n15: f64,
    /// φ_ocv of Eq. 7 for one cell, V, at equidistant charges from 0 to 1; linear between.
    pub cell_open_circuit_voltage_v: Vec<f64>,
}

impl BatteryModel {
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        in_range("cells", f64::from(self.cells), 1.0, 24.0, "")?;
        in_range("capacity_ah", self.capacity_ah, 0.05, 1000.0, "Ah")?;
        in_range("internal_resistance_ohm", self.internal_resistance_ohm, 0.0, 1.0, "Ω")?;
        in_range(
            "power_coefficient_w_per_n15",
            self.power_coefficient_w_per_n15,
            0.0,
            1000.0,
            "W/N^1.5",
        )?;
        let chart = &self.cell_open_circuit_voltage_v;
        all_in_range("cell_open_circuit_voltage_v", chart, 1.0, 5.0, "V")?;
        if !(2..=101).contains(&chart.len()) {
            let reason = format!("expected 2 to 101 equidistant knots, got {}", chart.len());
            return Err(Refusal::new("cell_open_circuit_voltage_v", reason));
        }
        if let Some(i) = chart.windows(2).position(|pair| pair[1] < pair[0]) {
            let reason = format!(
                "expected a voltage that never falls with charge, it does at {}",
                chart[i + 1]
            );
            return Err(Refusal::new(format!("cell_open_circuit_voltage_v[{}]", i + 1), reason));
        }
        Ok(())
    }
}

/// Voltages and current at one instant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BatteryOutput {
    /// V_oc, V.
    pub open_circuit_voltage: f64,
    /// V_batt at the terminals, V.
    pub battery_voltage: f64,
    /// i_batt, A, positive during discharge.
    pub battery_current: f64,
}

/// The battery, ready to be stepped: charts multiplied out, divisions done once.
#[derive(Debug, Clone)]
pub struct Battery {
    /// (V_oc at the knot, rise to the next), whole pack, V; the last knot's rise is 0.
    knots: Box<[(f64, f64)]>,
    intervals: f64,
    constants: BatteryConstants,
    /// An empty battery is disconnected: see [`Battery::disconnect`].
    connected: bool,
}

impl Battery {
    /// The battery of a checked model.
    pub fn new(model: &BatteryModel) -> Self {
        let chart = &model.cell_open_circuit_voltage_v;
        let cells = f64::from(model.cells);
        let knots = (0..chart.len())
            .map(|i| {
                (
                    cells * chart[i],
                    chart.get(i + 1).map_or(0.0, |next| cells * (next - chart[i])),
                )
            })
            .collect();
        Self {
            knots,
            intervals: (chart.len() - 1) as f64,
            constants: BatteryConstants {
                internal_resistance: model.internal_resistance_ohm,
                power_coefficient: model.power_coefficient_w_per_n15,
                per_coulomb: 1.0 / (3600.0 * model.capacity_ah),
            },
            connected: true,
        }
    }

    /// k_P, W/N^1.5.
    #[inline]
    pub fn power_coefficient(&self) -> f64 {
        self.constants.power_coefficient
    }

    /// dSoC/dt, 1/s, at a current in A (Eq. 9).
    #[inline]
    pub fn charge_rate(&self, current: f64) -> f64 {
        self.constants.charge_rate(current)
    }

    /// The numbers of Eqs. 8 and 9.
    #[inline]
    pub(crate) fn constants(&self) -> BatteryConstants {
        self.constants
    }

    /// The interval of the chart that a charge lies in.
    #[inline]
    pub(crate) fn interval(&self, state_of_charge: f64) -> ChartInterval {
        let position = state_of_charge.clamp(0.0, 1.0) * self.intervals;
        // As in `open_circuit_voltage`.
        let knot = position as usize;
        let (voltage, rise) = self.knots[knot.min(self.knots.len() - 1)];
        ChartInterval {
            intervals: self.intervals,
            knot: knot as f64,
            voltage,
            rise,
            left: false,
        }
    }

    /// V_oc, V (Eq. 7). Charges outside \[0, 1\] count as 0 or 1.
    #[inline]
    pub fn open_circuit_voltage(&self, state_of_charge: f64) -> f64 {
        let position = state_of_charge.clamp(0.0, 1.0) * self.intervals;
        // Truncation: the position is finite, non-negative and at most the last index (NaN gives knot 0 and a NaN voltage).
        let knot = position as usize;
        let (voltage, rise) = self.knots[knot.min(self.knots.len() - 1)];
        voltage + rise * (position - knot as f64)
    }

    /// Voltages and current while `power` W is drawn (Eq. 8).
    ///
    /// V = (V_oc + √(V_oc² − 4 R P))/2, i = P/V. More than V_oc²/4R cannot be drawn: the terminals then stay at V_oc/2 and the
    /// demand is met in part. A disconnected battery gives 0 V and 0 A.
    #[inline]
    pub fn output(&self, state_of_charge: f64, power: f64) -> BatteryOutput {
        let open_circuit_voltage = self.open_circuit_voltage(state_of_charge);
        self.constants.output(open_circuit_voltage, power, self.connected)
    }

    /// False once the battery has been cut off.
    #[inline]
    pub fn is_connected(&self) -> bool {
        self.connected
    }

    /// Cuts the battery off for the rest of the flight. The simulation does this when the charge reaches 0: commands have no
    /// effect any more, the rotors run down within a few lags and the vehicle falls, as after an ESC's low-voltage cut-off.
    pub fn disconnect(&mut self) {
        self.connected = false;
    }
}

impl Chart for &Battery {
    #[inline(always)]
    fn open_circuit_voltage(&mut self, state_of_charge: f64) -> f64 {
        Battery::open_circuit_voltage(self, state_of_charge)
    }
}

/// One interval of the chart. Within it the voltage is that of the whole chart, bit for bit.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ChartInterval {
    pub(crate) intervals: f64,
    /// Index of its lower end.
    pub(crate) knot: f64,
    /// At the knot, V.
    pub(crate) voltage: f64,
    /// To the next knot, V.
    pub(crate) rise: f64,
    /// True once a charge outside this interval has been requested: the results are then meaningless.
    pub(crate) left: bool,
}

impl Chart for ChartInterval {
    #[inline(always)]
    fn open_circuit_voltage(&mut self, state_of_charge: f64) -> f64 {
        let position = state_of_charge.clamp(0.0, 1.0) * self.intervals;
        let beyond = position - self.knot;
        // Not a number leaves every interval, too.
        self.left |= !(0.0..1.0).contains(&beyond);
        self.voltage + self.rise * beyond
    }
}

/// The numbers of Eqs. 8 and 9.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct BatteryConstants {
    /// R_in, Ω.
    pub(crate) internal_resistance: f64,
    /// k_P, W/N^1.5.
    pub(crate) power_coefficient: f64,
    /// 1/(3600 Q_nom), 1/C.
    pub(crate) per_coulomb: f64,
}

impl BatteryConstants {
    /// See [`Battery::charge_rate`].
    #[inline(always)]
    pub(crate) fn charge_rate(&self, current: f64) -> f64 {
        -current * self.per_coulomb
    }

    /// See [`Battery::output`].
    #[inline(always)]
    pub(crate) fn output(&self, open_circuit_voltage: f64, power: f64, connected: bool) -> BatteryOutput {
        let drop = 4.0 * self.internal_resistance * power;
        let square = open_circuit_voltage * open_circuit_voltage;
        let (power, root) = if drop > square {
            (square / (4.0 * self.internal_resistance), 0.0)
        } else {
            (power, (square - drop).sqrt())
        };
        let battery_voltage = 0.5 * (open_circuit_voltage + root);
        if connected {
            BatteryOutput {
                open_circuit_voltage,
                battery_voltage,
                battery_current: power / battery_voltage,
            }
        } else {
            BatteryOutput {
                open_circuit_voltage,
                battery_voltage: 0.0,
                battery_current: 0.0,
            }
        }
    }
}
