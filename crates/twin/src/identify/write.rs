//! The identified vehicle as documents: vehicle, blades, and their intervals.

use std::fmt::Write as _;

use rotortwin_plant::vehicle::model::SpinDirection;
use rotortwin_scenario::VehicleDocuments;

use super::slow::CELL_CHART;
use super::{Estimate, Identified, lever_unit};
use crate::model::constants::{FROM_LOG, Source};

/// Texts of the files; the vehicle names the blades by `BLADES_NAME`.
#[derive(Debug, Clone)]
pub struct Files {
    /// `NAME.toml`.
    pub vehicle: String,
    /// `NAME.blades.toml`.
    pub blades: String,
    /// `NAME.intervals.toml`.
    pub intervals: String,
}

impl Files {
    /// The vehicle as every command will read it.
    ///
    /// # Errors
    /// A value that no vehicle may have: one sentence.
    pub fn documents(&self) -> Result<VehicleDocuments, String> {
        let documents = VehicleDocuments {
            vehicle: toml::from_str(&self.vehicle).map_err(|error| error.message().to_owned())?,
            blades: toml::from_str(&self.blades).map_err(|error| error.message().to_owned())?,
        };
        documents
            .check()
            .map_err(|refusal| format!("{}: {}", refusal.key, refusal.reason))?;
        Ok(documents)
    }
}

/// The documents; `name` is the file name without extension.
pub fn files(found: &Identified, name: &str) -> Files {
    Files {
        vehicle: vehicle(found, name),
        blades: blades(found, name),
        intervals: intervals(found, name),
    }
}

/// Four significant digits.
fn short(value: f64) -> String {
    if value == 0.0 {
        return "0.0".to_owned();
    }
    let digits = (3 - value.abs().log10().floor() as i32).max(1) as usize;
    if value.abs() < 1e-3 {
        return format!("{value:.3e}");
    }
    let text = format!("{value:.digits$}");
    let trimmed = text.trim_end_matches('0');
    if trimmed.ends_with('.') {
        format!("{trimmed}0")
    } else {
        trimmed.to_owned()
    }
}

/// `[low, high]; source: how`, the comment beside a value.
fn comment(estimate: Option<&Estimate>) -> String {
    let Some(value) = estimate else { return String::new() };
    let range = if value.low < value.high {
        let range = format!("95 %: {} to {} {}", short(value.low), short(value.high), value.unit);
        format!("{}; ", range.trim_end())
    } else {
        String::new()
    };
    let better = if matches!(value.source, Source::Class | Source::LogAndClass) && !value.better.is_empty() {
        format!("; better by {}", value.better)
    } else {
        String::new()
    };
    let how = if value.how.is_empty() {
        String::new()
    } else {
        format!(": {}", value.how)
    };
    format!(" # {range}{}{how}{better}", value.source.words())
}

fn vehicle(found: &Identified, name: &str) -> String {
    let numbers = &found.numbers;
    let note = |key: &str| comment(found.value(key));
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let mass = found.request.mass_kg;
    let mut text = String::new();
    let mut line = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    line(format!(
        "# Vehicle: {name}, identified from flight by `rotortwin vehicle from-log`."
    ));
    line(
        "# Each value says its 95 % interval and where it came from. CLASS DEFAULT: a guess that no log supports."
            .to_owned(),
    );
    line(format!("# All intervals with their sources: {name}.intervals.toml."));
    line(String::new());
    line(format!("name = {}", quoted(name)));
    line(format!(
        "description = {}",
        quoted(&format!("identified from {}{FROM_LOG}", found.logs.join(", ")))
    ));
    line(String::new());
    line("[body]".to_owned());
    line(format!("mass_kg = {}{}", plain(mass), note("body.mass_kg")));
    line("inertia_body_kg_m2 = [".to_owned());
    for axis in 0..3 {
        line(format!(
            "    {},{}",
            short(numbers.inertia[axis]),
            note(&format!("body.inertia_body_kg_m2[{axis}]"))
        ));
    }
    line("]".to_owned());
    line(format!("gravity_m_s2 = {}", super::grid::GRAVITY));
    line(format!(
        "linear_drag_kg_s = {}{}",
        short(numbers.drag),
        note("body.linear_drag_kg_s")
    ));
    line("angular_drag_nms = 0.0 # a flight can hardly separate it from the controller's damping".to_owned());
    line(String::new());
    line("[rotors]".to_owned());
    line(format!("blades = {}", quoted(&format!("{name}.blades.toml"))));
    line("nominal_blade = \"flown\"".to_owned());
    line(format!(
        "thrust_lag_s = {}{}",
        short(numbers.lag_s),
        note("rotors.thrust_lag_s")
    ));
    line(format!(
        "reaction_s = {}{}",
        short(numbers.reaction_s.clamp(0.0, 1.0)),
        note("rotors.reaction_s")
    ));
    if numbers.rotor_drag > 0.0 {
        line(format!(
            "drag_kg_s = {}{}",
            short(numbers.rotor_drag),
            note("rotors.drag_kg_s")
        ));
    }
    let blade = blade(found);
    line(format!(
        "full_thrust_n = {} # the blade at full duty and {:.2} V: beyond the flown duties it extrapolates",
        short(blade.lift(1.0, numbers.voltage).clamp(0.01, 2000.0)),
        numbers.voltage
    ));
    line(String::new());
    line("[rotors.layout]".to_owned());
    line(format!(
        "kind = \"list\" # {} ({}: {})",
        found.airframe.name,
        found.airframe.source.words(),
        found.airframe.how
    ));
    line(format!(
        "# moment_ratio_m:{}",
        note("rotors.moment_ratio_m").replacen(" #", "", 1)
    ));
    line("# Rotor numbers are those of the log's motor outputs.".to_owned());
    line("rotor = [".to_owned());
    let scale = found.request.arm_m / lever_unit(&found.airframe.places);
    for (i, place) in found.airframe.places.iter().enumerate() {
        line(format!(
            "    {{ number = {}, position_body_m = [{}, {}, 0.0], spin = \"{}\", moment_ratio_m = {} }},",
            i + 1,
            fixed(place.position[0] * scale),
            fixed(place.position[1] * scale),
            if place.spin == SpinDirection::Ccw { "ccw" } else { "cw" },
            short(numbers.moment_ratio.clamp(1e-4, 0.5))
        ));
    }
    line("]".to_owned());
    line(String::new());
    line("[battery]".to_owned());
    line(format!("cells = {}{}", numbers.cells, note("battery.cells")));
    line(format!(
        "capacity_ah = {}{}",
        short(numbers.capacity),
        note("battery.capacity_ah")
    ));
    line(format!(
        "internal_resistance_ohm = {}{}",
        short(numbers.resistance.clamp(0.0, 1.0)),
        note("battery.internal_resistance_ohm")
    ));
    line(format!(
        "power_coefficient_w_per_n15 = {}{}",
        short(numbers.power_coefficient),
        note("battery.power_coefficient_w_per_n15")
    ));
    let chart: Vec<String> = CELL_CHART.iter().map(|v| format!("{v:.2}")).collect();
    line(
        "# Open-circuit voltage of one cell at 0 %, 5 % … 100 % charge, V: CLASS DEFAULT, a common LiPo chart."
            .to_owned(),
    );
    line(format!("cell_open_circuit_voltage_v = [\n    {},\n]", chart.join(", ")));
    text
}

/// As entered.
fn plain(value: f64) -> String {
    format!("{value:?}")
}

fn fixed(value: f64) -> String {
    // −0.0 would be a strange place.
    format!("{:.4}", if value.abs() < 5e-5 { 0.0 } else { value })
}

fn blade(found: &Identified) -> rotortwin_plant::powertrain::blades::Blade {
    let numbers = &found.numbers;
    numbers.curve.blade(
        numbers.curve.hover * found.request.mass_kg,
        numbers.voltage,
        numbers.voltage_slope,
    )
}

fn blades(found: &Identified, name: &str) -> String {
    let numbers = &found.numbers;
    let blade = blade(found);
    let [a0, a1, a2, a3] = blade.coefficients;
    let mut text = String::new();
    let mut line = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    line(format!(
        "# Blade of {name}, as flown: thrust over duty and voltage in the form of Eq. 19,"
    ));
    line("#   f = (V − v0)(a0 √u + a1 u + a2 u² + a3 u³),  f in N, V in V, u the duty in PERCENT.".to_owned());
    line(format!(
        "# At the hover duty {:.4} and {:.3} V it lifts {:.4} N with n = d ln f/d ln u = {:.3}. Known where it was flown; elsewhere it extrapolates.",
        numbers.curve.hover_duty,
        numbers.voltage,
        numbers.curve.hover * found.request.mass_kg,
        numbers.curve.slope()
    ));
    line(String::new());
    line(format!(
        "description = \"thrust identified in flight from {}\"",
        found.logs.join(", ").replace(['"', '\\'], "'")
    ));
    line(String::new());
    line("[blade.flown]".to_owned());
    line(format!(
        "coefficients = [{a0:.6e}, {a1:.6e}, {a2:.6e}, {a3:.6e}] # N/V per √%, %, %², %³"
    ));
    line(format!(
        "voltage_offset_v = {:.4}{}",
        blade.voltage_offset_v,
        comment(found.value("rotors.voltage_slope"))
    ));
    text
}

fn intervals(found: &Identified, name: &str) -> String {
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let mut text = format!(
        "# Intervals of {name}.toml: each value with its 95 % interval, its source (entered, log, log-and-class, parameter, class),\n\
         # how it was found, and what would make it better. Keys with a dot-path are keys of the vehicle document.\n\n\
         vehicle = {}\nlogs = [{}]\n",
        quoted(&format!("{name}.toml")),
        found.logs.iter().map(|log| quoted(log)).collect::<Vec<_>>().join(", ")
    );
    for value in &found.values {
        let source = serde_json::to_value(value.source).ok();
        let source = source
            .as_ref()
            .and_then(serde_json::Value::as_str)
            .unwrap_or("class")
            .to_owned();
        // Writing to a String cannot fail.
        _ = write!(
            text,
            "\n[[value]]\nkey = {}\nname = {}\nunit = {}\nvalue = {:e}\nlow = {:e}\nhigh = {:e}\nsource = {}\nhow = {}\nbetter = {}\n",
            quoted(&value.key),
            quoted(&value.name),
            quoted(value.unit),
            value.value,
            value.low,
            value.high,
            quoted(&source),
            quoted(&value.how),
            quoted(&value.better)
        );
    }
    text
}
