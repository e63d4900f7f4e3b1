//! The page `docs/effects.md`: written from the declarations, so that it cannot say anything else than the code does.

use std::fmt::Write as _;

use super::catalogue::catalogue;
use super::declaration::{EffectDeclaration, ParameterKind};
use super::user::{expression_places, expression_variables};

const INTRODUCTION: &str = r#"# Effects

For people who read a diagnosis or add an effect to a model.

What a nominal vehicle lacks: physics, sensor faults, timing faults. One declaration of each serves the simulator, the diagnosis and this
page, which is generated (`rotortwin effects --page > docs/effects.md`; a test fails when it is out of date).

```sh
rotortwin effects                      # the catalogue as a table
rotortwin effects show rotor-drag      # equation, parameters, how to excite it, what it is confused with
rotortwin effects --json               # for programs
```

In a scenario:

```toml
[[effect]]
effect = "rotor-drag"
parameters = { drag_n_s_m = 0.25 }

[[effect]]
effect = "rotor-thrust-scale"
rotor = 3        # from 1, for effects of one rotor
onset_s = 45.0   # from the start if absent
parameters = { share = -0.05 }

[ground]         # for ground-effect only
down_m = 0.0     # z of the ground, m, NED
```

A size that is absent is 0, a shape that is absent is its typical value; with every size at 0 there is no effect, bit for bit. Values up
to ten times beyond the plausible range are accepted. Refused: unknown ids and parameters, and an effect that cannot have an effect (sizes
of 0, wind without a drag, ground effect out of reach, an onset after the end). Scenarios without effects fly the same bits as ever.

Telemetry of every recorded flight has the accelerometer (`accel_x_m_s2` …, noise of Table 4 unless `sensors.accelerometer_noise_m_s2` says
otherwise), so that `telemetry.parquet` is a flight log like a measured one. Latencies and sensor faults reach the controller, too.

An autopilot of its own clock ([autopilots](autopilots.md#effects)) flies with all effects but those on readings and their time: it has
instruments of its own.

A drag with a value per axis, diag(k_x, k_y, k_z), is three effects together: `linear-friction` k_z, `rotor-drag` (k_x + k_y)/2 − k_z, and
`drag-anisotropy` a = 2 (k_x − k_y)/(k_x + k_y), which is a share of the others and nothing without them.

## Effects of your own

A TOML document with expressions, no compiler needed. Name it in a scenario (`effect_files = ["../effects/fin-drag.toml"]`) and use
its id like any other; `rotortwin effects --effects FILE` checks and lists it. Example: [config/effects/fin-drag.toml](../config/effects/fin-drag.toml).

Each `[[term]]` adds the value of its expression to a place. The unit of the expression must be that of the place; units are SI without
prefix. Numbers may carry one: `2[m/s]`. Operators `+ - * / ^`, parentheses; functions `sqrt abs sign sin cos tan tanh exp log min max hypot
clamp`; the constant `pi`. Where every size is 0 the term must be 0. An error names line, key and column.

"#;

/// The text of `docs/effects.md`.
pub fn page() -> String {
    let mut out = INTRODUCTION.to_owned();
    out.push_str("Places and their units: ");
    let places: Vec<String> = expression_places()
        .map(|(name, unit)| format!("`{name}` ({unit})"))
        .collect();
    out.push_str(&places.join(", "));
    out.push_str(".\n\n| Variable | Unit | Meaning |\n|---|---|---|\n");
    let put = "writing to a string cannot fail";
    for (name, unit, meaning) in expression_variables() {
        writeln!(out, "| `{name}` | {unit} | {meaning} |").expect(put);
    }
    out.push_str("\n## The catalogue\n\nChannels: F force, M moment, KV, KA, KP kinematics of velocity, attitude and position, V battery voltage.\n");
    for entry in catalogue() {
        out.push('\n');
        out.push_str(&entry_text(entry));
    }
    out
}

fn entry_text(entry: &EffectDeclaration) -> String {
    let put = "writing to a string cannot fail";
    let mut out = String::new();
    let number = entry.catalogue_number.map_or(String::new(), |n| format!("{n} · "));
    writeln!(out, "### {number}{}\n", entry.name).expect(put);
    let rotor = if entry.per_rotor { ", one rotor" } else { "" };
    let channels = entry.channels.iter().map(|c| c.symbol()).collect::<Vec<_>>().join(", ");
    writeln!(
        out,
        "`{}` · {}{rotor} · channels {channels}\n",
        entry.id,
        entry.class.as_str()
    )
    .expect(put);
    writeln!(out, "{}\n", entry.equation).expect(put);
    writeln!(
        out,
        "| Parameter | Symbol | Unit | Plausible | Typical | Meaning |\n|---|---|---|---|---|---|"
    )
    .expect(put);
    for p in entry.parameters {
        let shape = if p.kind == ParameterKind::Shape { " (shape)" } else { "" };
        writeln!(
            out,
            "| `{}` | {} | {} | {} to {} | {} | {}{shape} |",
            p.name, p.symbol, p.unit, p.plausible_low, p.plausible_high, p.typical, p.meaning
        )
        .expect(put);
    }
    let ids = |ids: &[&str]| ids.iter().map(|id| format!("`{id}`")).collect::<Vec<_>>().join(", ");
    write!(out, "\nExcited by: {}.", entry.excited_by).expect(put);
    if !entry.confused_with.is_empty() {
        write!(out, " Confused with: {}.", ids(entry.confused_with)).expect(put);
    }
    if !entry.needs.is_empty() {
        write!(out, " Needs one of: {}.", ids(entry.needs)).expect(put);
    }
    let corrected = entry.parameters.iter().filter_map(|p| p.corrects);
    let corrected: Vec<String> = corrected.map(|c| format!("`{}`", c.key)).collect();
    if !corrected.is_empty() {
        write!(out, " Error of: {}.", corrected.join(", ")).expect(put);
    }
    writeln!(out, " Source: {}.", entry.source).expect(put);
    out
}
