//! Definition of every flight of a campaign: a pure function of the campaign and the flight's number.
//!
//! ```text
//!  flight number i ─┬▶ point i mod G of the grid, G the product of the axes that are combined
//!                   ├▶ draws: one random stream per (campaign seed, axis name, i)
//!                   └▶ seed of the flight: a separate stream
//! ```
//! So part of a campaign gives the same flights as the whole, on any number of threads, and adding an axis changes no draw of
//! another one.

use super::cell::Cell;
use super::document::{AxisDocument, CampaignDocument, MAX_FLIGHTS, Pick};
use crate::paper::protocol::Course;
use rotortwin_flight::run_hash::content_hash;
use rotortwin_plant::random::RandomStream;
use rotortwin_scenario::names::{Kind, meant, typed};
use rotortwin_scenario::template::{ScenarioTemplate, TomlFile, overlay, set_value, value_at};
use rotortwin_scenario::{ConfigError, Scenario};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Number of flights whose scenarios are checked before a larger campaign starts, in addition to every value of every axis.
const CHECKED_FLIGHTS: u64 = 500;

/// One choice on an axis: its name in the results, and the values it sets.
#[derive(Clone, Debug, PartialEq)]
struct Choice {
    cell: Cell,
    set: Vec<(String, Value)>,
}

/// Source of an axis's values.
#[derive(Clone, Debug, PartialEq)]
enum Source {
    List(Vec<Choice>),
    Uniform([f64; 2]),
    LogUniform([f64; 2]),
    /// Rotors of the flight's vehicle.
    Rotors,
}

/// One axis, ready to be drawn from.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Name of its column.
    pub name: String,
    keys: Vec<String>,
    source: Source,
    pick: Pick,
    other_than: Option<usize>,
    /// Number of values on the grid; 1 if drawn.
    grid: u64,
}

impl Axis {
    /// True if its values are combined with those of the other axes.
    pub fn is_grid(&self) -> bool {
        self.pick == Pick::Each
    }

    /// Human-readable description of what it varies.
    pub fn words(&self) -> String {
        let how = if self.is_grid() { "each of" } else { "drawn from" };
        match &self.source {
            Source::List(list) => {
                let mut names: Vec<String> = list.iter().take(8).map(|choice| choice.cell.to_string()).collect();
                if list.len() > names.len() {
                    names.push(format!("… ({} values)", list.len()));
                }
                format!("{how} {}", names.join(", "))
            }
            Source::Uniform([low, high]) => format!("drawn from {low} to {high}"),
            Source::LogUniform([low, high]) => format!("drawn from {low} to {high}, log-uniform"),
            Source::Rotors => format!("{how} the rotors"),
        }
    }

    /// True if every value is a number.
    pub fn is_numeric(&self) -> bool {
        match &self.source {
            Source::List(list) => list.iter().all(|choice| choice.cell.number().is_some()),
            Source::Uniform(_) | Source::LogUniform(_) | Source::Rotors => true,
        }
    }

    /// Lowest and highest number drawn, if it draws numbers, and whether they are log-uniform.
    pub fn drawn_range(&self) -> Option<([f64; 2], bool)> {
        match self.source {
            Source::Uniform(range) => Some((range, false)),
            Source::LogUniform(range) => Some((range, true)),
            Source::List(_) | Source::Rotors => None,
        }
    }

    /// The choice for the number `x`.
    fn number(&self, x: f64) -> Choice {
        Choice {
            cell: Cell::Number(x),
            set: self.keys.iter().map(|key| (key.clone(), Value::Float(x))).collect(),
        }
    }

    fn rotor(&self, number: usize) -> Choice {
        let number = i64::try_from(number).expect("at most 16 rotors");
        Choice {
            cell: Cell::Integer(number),
            set: self
                .keys
                .iter()
                .map(|key| (key.clone(), Value::Integer(number)))
                .collect(),
        }
    }
}

/// Value of one axis in one flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name of the axis.
    pub axis: String,
    /// Value in the results.
    pub cell: Cell,
    /// Values set on the scenario, by dotted path.
    pub set: Vec<(String, Value)>,
}

/// One flight, not yet checked.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedFlight {
    /// Zero-based.
    pub index: u64,
    /// Seed of its noise and draws of the vehicle.
    pub seed: u64,
    /// Values in the order of the axes.
    pub parameters: Vec<Parameter>,
}

/// A campaign that has been checked and can be flown.
#[derive(Debug)]
pub struct Campaign {
    path: PathBuf,
    file: TomlFile,
    document: CampaignDocument,
    scenario_path: PathBuf,
    template: ScenarioTemplate,
    /// The base scenario with `[set]`.
    base: Table,
    axes: Vec<Axis>,
    flights: u64,
    rotor_count: usize,
    warnings: Vec<String>,
}

impl Campaign {
    /// Reads the campaign at `path` and all referenced files, and checks its flights: every value of every axis, the ends of every
    /// range, and a sample of the flights (all of a small campaign).
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        Self::of(TomlFile::read(path)?, path)
    }

    /// As [`Campaign::load`], from a text with `path` as its location.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        Self::of(TomlFile::from_text(&path.display().to_string(), text)?, path)
    }

    fn of(file: TomlFile, path: &Path) -> Result<Self, ConfigError> {
        let document = CampaignDocument::read(&file)?;
        let scenario_path = meant(
            Kind::Scenario,
            path.parent().unwrap_or(Path::new("")),
            &document.scenario,
        );
        if !scenario_path.is_file() {
            let reason = if scenario_path.is_dir() {
                format!(
                    "expected the path of a scenario, {} is a folder",
                    scenario_path.display()
                )
            } else {
                format!(
                    "expected the path of a scenario, found none at {}",
                    scenario_path.display()
                )
            };
            return Err(file.refuse("scenario", reason));
        }
        Scenario::load(&scenario_path)?;
        let template = ScenarioTemplate::read(&scenario_path)?;
        let mut base = template.table().clone();
        overlay(&mut base, &document.set).map_err(|reason| file.refuse("set", reason))?;
        let mut campaign = Self {
            path: path.to_path_buf(),
            rotor_count: 0,
            axes: Vec::new(),
            flights: 0,
            warnings: Vec::new(),
            file,
            document,
            scenario_path,
            template,
            base,
        };
        campaign.rotor_count = campaign
            .template
            .rotor_count(&campaign.base)
            .map_err(|error| campaign.blame("set", &error))?;
        campaign.axes = campaign.make_axes()?;
        campaign.flights = campaign.count_flights()?;
        campaign.warnings = campaign.try_flights()?;
        Ok(campaign)
    }

    /// Valid but probably unintended settings found in the checked flights, one sentence each.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The document.
    pub fn document(&self) -> &CampaignDocument {
        &self.document
    }

    /// Path as given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The command that flies it: by its name, where that leads to its file.
    pub fn command(&self) -> String {
        format!("rotortwin campaign {}", typed(Kind::Campaign, &self.path))
    }

    /// The axes in their order.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Total number of flights.
    pub fn flights(&self) -> u64 {
        self.flights
    }

    /// Levels of the operating curve, nats.
    pub fn levels(&self) -> &[f32] {
        self.document
            .operating_curve
            .as_ref()
            .map_or(&[], |curve| &curve.evidence_nats)
    }

    /// Rotors of the base's vehicle.
    pub fn rotor_count(&self) -> usize {
        self.rotor_count
    }

    /// The base scenario with `[set]`, as a table.
    pub fn base(&self) -> &Table {
        &self.base
    }

    /// Folder that the paths in the scenarios are relative to.
    pub fn directory(&self) -> &Path {
        self.template.directory()
    }

    /// Every file used by its flights: the document, the base, vehicles, blades, classifiers, effects.
    pub fn files(&self) -> BTreeSet<PathBuf> {
        let mut files = BTreeSet::from([self.path.clone(), self.scenario_path.clone()]);
        for choice in self.vehicle_choices() {
            let mut table = self.base.clone();
            // Values that cannot be set have been rejected.
            if choice
                .into_iter()
                .all(|(key, value)| set_value(&mut table, &key, value).is_ok())
            {
                self.add_files(&table, &mut files);
            }
        }
        files
    }

    /// The files referenced by a scenario, directly and indirectly.
    fn add_files(&self, table: &Table, files: &mut BTreeSet<PathBuf>) {
        let text = |key: &str| value_at(table, key).and_then(Value::as_str);
        if let Some(vehicle) = text("vehicle") {
            let path = meant(Kind::Vehicle, self.directory(), vehicle);
            let read = std::fs::read_to_string(&path).ok();
            let read = read.and_then(|text| text.parse::<Table>().ok());
            if let Some(blades) = read.as_ref().and_then(|read| value_at(read, "rotors.blades")?.as_str()) {
                files.insert(meant(Kind::Blades, path.parent().unwrap_or(Path::new("")), blades));
            }
            files.insert(path);
        }
        files.extend(text("fdi.network").map(|network| meant(Kind::Classifier, self.directory(), network)));
        let effects = value_at(table, "effect_files").and_then(Value::as_array);
        let effects = effects.into_iter().flatten().filter_map(Value::as_str);
        files.extend(effects.map(|effect| meant(Kind::Effect, self.directory(), effect)));
    }

    /// Hash over the document, the base with its vehicle, blades and classifier: everything that determines the flights except the
    /// program.
    pub fn content_hash(&self) -> Result<String, ConfigError> {
        // The description does not affect any flight.
        let document = CampaignDocument {
            description: String::new(),
            ..self.document.clone()
        };
        let mut text = toml::to_string(&document).expect("a document that was read can be written");
        text += &toml::to_string(&self.base).expect("a table that was read can be written");
        let mut seen = Vec::new();
        for choice in self.vehicle_choices() {
            let mut table = self.base.clone();
            for (key, value) in &choice {
                set_value(&mut table, key, value.clone()).map_err(|reason| self.file.refuse("axis", reason))?;
            }
            // A vehicle that needs other axes to be flyable has been checked with them; only its files matter here.
            if let Ok(scenario) = self.template.scenario(&table) {
                let documents = scenario.documents();
                let part = serde_json::to_string(&(&documents.vehicle, &documents.blades, &documents.classifier))
                    .expect("documents of text and numbers are JSON");
                seen.push(content_hash(part.as_bytes()));
                if !documents.effects.is_empty() {
                    let effects = serde_json::to_string(&documents.effects).expect("documents are JSON");
                    seen.push(content_hash(effects.as_bytes()));
                }
            }
        }
        seen.sort_unstable();
        seen.dedup();
        text += &seen.join(" ");
        Ok(content_hash(text.as_bytes()))
    }

    /// The base, and each choice that names files.
    fn vehicle_choices(&self) -> Vec<Vec<(String, Value)>> {
        let mut choices = vec![Vec::new()];
        for axis in &self.axes {
            if let Source::List(list) = &axis.source {
                let names_files = |choice: &&Choice| {
                    choice
                        .set
                        .iter()
                        .any(|(key, _)| ["vehicle", "fdi", "fdi.network", "effect_files"].contains(&key.as_str()))
                };
                choices.extend(list.iter().filter(names_files).map(|choice| choice.set.clone()));
            }
        }
        choices
    }

    fn make_axes(&self) -> Result<Vec<Axis>, ConfigError> {
        let mut axes: Vec<Axis> = Vec::new();
        for (i, axis) in self.document.axis.iter().enumerate() {
            let refuse = |key: &str, reason: String| self.file.refuse(&format!("axis[{i}].{key}"), reason);
            let source = self.source(axis).map_err(|(key, reason)| refuse(key, reason))?;
            let drawn = matches!(source, Source::Uniform(_) | Source::LogUniform(_));
            let pick = if drawn {
                Pick::Any
            } else {
                axis.pick.unwrap_or(Pick::Each)
            };
            let grid = match (&source, pick) {
                (Source::List(list), Pick::Each) => list.len() as u64,
                (Source::Rotors, Pick::Each) => self.rotor_count as u64,
                _ => 1,
            };
            let other_than = axis.other_than.as_ref().map(|name| {
                axes.iter()
                    .position(|other| other.name == *name)
                    .expect("checked with the document")
            });
            axes.push(Axis {
                name: axis.name.clone(),
                keys: axis.all_keys(),
                source,
                pick,
                other_than,
                grid,
            });
        }
        let each_rotor = axes
            .iter()
            .position(|axis| axis.source == Source::Rotors && axis.is_grid());
        let vehicles = axes.iter().any(|axis| match &axis.source {
            Source::List(list) => list
                .iter()
                .any(|choice| choice.set.iter().any(|(key, _)| key == "vehicle")),
            _ => false,
        });
        if let (Some(i), true) = (each_rotor, vehicles) {
            let reason = "each rotor of several vehicles is not a grid; draw rotors with pick = \"any\", or write a campaign for each vehicle";
            return Err(self.file.refuse(&format!("axis[{i}].pick"), reason));
        }
        Ok(axes)
    }

    fn source(&self, axis: &AxisDocument) -> Result<Source, (&'static str, String)> {
        let keys = axis.all_keys();
        let to_all = |value: &Value| keys.iter().map(|key| (key.clone(), value.clone())).collect::<Vec<_>>();
        if let Some(range) = axis.uniform {
            return Ok(Source::Uniform(range));
        }
        if let Some(range) = axis.log_uniform {
            return Ok(Source::LogUniform(range));
        }
        if axis.rotors.is_some() {
            return Ok(Source::Rotors);
        }
        if let Some([first, last]) = axis.range {
            let choice = |number: i64| Choice {
                cell: Cell::Integer(number),
                set: to_all(&Value::Integer(number)),
            };
            return Ok(Source::List((first..=last).map(choice).collect()));
        }
        if let Some(values) = &axis.values {
            let choice = |value: &Value| Choice {
                cell: Cell::from_value(value),
                set: to_all(value),
            };
            return Ok(Source::List(values.iter().map(choice).collect()));
        }
        if let Some(names) = &axis.courses {
            let choice = |name: &String| {
                let course = Course::ALL
                    .into_iter()
                    .find(|course| course.name().replace(' ', "-") == *name);
                let course = course.ok_or_else(|| {
                    let names = Course::ALL.map(|course| course.name().replace(' ', "-")).join(", ");
                    ("courses", format!("expected trajectories out of {names}, got `{name}`"))
                })?;
                let trajectory = Value::try_from(course.trajectory()).expect("a trajectory is a table");
                Ok::<_, (&'static str, String)>(Choice {
                    cell: Cell::Text(name.clone()),
                    set: vec![("trajectory".to_owned(), trajectory)],
                })
            };
            return Ok(Source::List(names.iter().map(choice).collect::<Result<_, _>>()?));
        }
        let choice = |case: &super::document::CaseDocument| Choice {
            cell: Cell::Text(case.name.clone()),
            set: flattened(&case.set),
        };
        Ok(Source::List(axis.case.iter().map(choice).collect()))
    }

    fn count_flights(&self) -> Result<u64, ConfigError> {
        let key = if self.document.flights.is_some() {
            "flights"
        } else {
            "repeats"
        };
        let too_many = || {
            let reason = format!("expected at most {MAX_FLIGHTS} flights, the grids and repeats make more");
            self.file.refuse(key, reason)
        };
        let grid = self
            .axes
            .iter()
            .try_fold(1u64, |product, axis| product.checked_mul(axis.grid))
            .ok_or_else(too_many)?;
        let flights = match self.document.flights {
            Some(flights) => Some(flights),
            None => grid.checked_mul(self.document.repeats.unwrap_or(1)),
        };
        flights.filter(|count| *count <= MAX_FLIGHTS).ok_or_else(too_many)
    }

    /// Reports an error of a scenario as one of this file.
    fn blame(&self, key: &str, error: &ConfigError) -> ConfigError {
        self.file.refuse(key, error.to_string())
    }

    /// Warnings of the checked flights.
    fn try_flights(&self) -> Result<Vec<String>, ConfigError> {
        // `[set]` alone need not be flyable (an axis may provide the vehicle); then the first flight is decisive.
        for (place, axis) in self.axes.iter().enumerate() {
            let choices: Vec<Choice> = match &axis.source {
                Source::List(list) => list.iter().take(1000).cloned().collect(),
                Source::Uniform(range) | Source::LogUniform(range) => range.iter().map(|x| axis.number(*x)).collect(),
                Source::Rotors => Vec::new(),
            };
            for choice in choices {
                // The other axes as in the first flight.
                let mut flight = self.flight(0)?;
                let name = choice.cell.to_string();
                flight.parameters[place] = Parameter {
                    axis: axis.name.clone(),
                    cell: choice.cell,
                    set: choice.set,
                };
                if let Err(error) = self.scenario(&flight)
                    && !is_of_the_combination(&error)
                {
                    let reason = format!("with {} = {name}: {}", axis.name, sentence_of(&error));
                    return Err(self.file.refuse(&format!("axis[{place}]"), reason));
                }
            }
        }
        let count = self.flights.min(CHECKED_FLIGHTS);
        let mut warned: Vec<(u64, String)> = Vec::new();
        for i in 0..count {
            let index = if self.flights == count {
                i
            } else {
                i * (self.flights / count)
            };
            let flight = self.flight(index)?;
            let scenario = self.scenario(&flight);
            if let Ok(scenario) = &scenario
                && let Some(warning) = scenario.warnings().into_iter().next()
            {
                warned.push((index, warning));
            }
            if let Err(error) = scenario
                && !is_of_the_combination(&error)
            {
                let parameters: Vec<String> = flight
                    .parameters
                    .iter()
                    .map(|parameter| format!("{} = {}", parameter.axis, parameter.cell))
                    .collect();
                let with = if parameters.is_empty() {
                    String::new()
                } else {
                    format!(" with {}", parameters.join(", "))
                };
                let key = if self.axes.is_empty() { "set" } else { "axis" };
                let reason = format!("flight {index}{with}: {}", sentence_of(&error));
                return Err(self.file.refuse(key, reason));
            }
        }
        let flights = warned.len();
        let first = warned.into_iter().next();
        Ok(first
            .map(|(index, warning)| format!("{flights} of the {count} flights tried, first flight {index}: {warning}"))
            .into_iter()
            .collect())
    }

    /// Flight number `index`, from 0.
    pub fn flight(&self, index: u64) -> Result<PlannedFlight, ConfigError> {
        let point = self.grid_point(index);
        let seed = self.document.seed;
        let mut parameters: Vec<Option<Parameter>> = vec![None; self.axes.len()];
        let parameter = |axis: &Axis, choice: Choice| Parameter {
            axis: axis.name.clone(),
            cell: choice.cell,
            set: choice.set,
        };
        // Rotors last: their number depends on the vehicle, which another axis may set.
        for (place, axis) in self.axes.iter().enumerate() {
            let choice = match &axis.source {
                Source::Rotors => continue,
                Source::List(list) if axis.is_grid() => list[point[place]].clone(),
                Source::List(list) => {
                    let other = axis
                        .other_than
                        .and_then(|other| parameters[other].as_ref())
                        .map(|p| &p.cell);
                    let allowed: Vec<&Choice> = list.iter().filter(|choice| Some(&choice.cell) != other).collect();
                    match allowed.len() {
                        0 => return Err(self.nothing_left(place)),
                        count => allowed[index_of(unit(seed, &axis.name, index), count)].clone(),
                    }
                }
                Source::Uniform([low, high]) => {
                    axis.number((low + (high - low) * unit(seed, &axis.name, index)).min(*high))
                }
                Source::LogUniform([low, high]) => {
                    let (a, b) = (libm::log(*low), libm::log(*high));
                    let x = libm::exp(a + (b - a) * unit(seed, &axis.name, index));
                    axis.number(x.clamp(*low, *high))
                }
            };
            parameters[place] = Some(parameter(axis, choice));
        }
        let rotors_wanted = self.axes.iter().any(|axis| axis.source == Source::Rotors);
        let rotor_count = match rotors_wanted {
            true => self
                .template
                .rotor_count(&self.table(parameters.iter().flatten())?)
                .map_err(|error| self.blame("axis", &error))?,
            false => 0,
        };
        for (place, axis) in self.axes.iter().enumerate() {
            if axis.source != Source::Rotors {
                continue;
            }
            let number = if axis.is_grid() {
                point[place] + 1
            } else {
                let other = axis
                    .other_than
                    .and_then(|other| parameters[other].as_ref())
                    .map(|p| &p.cell);
                let allowed: Vec<usize> = (1..=rotor_count)
                    .filter(|number| Some(&Cell::Integer(*number as i64)) != other)
                    .collect();
                match allowed.len() {
                    0 => return Err(self.nothing_left(place)),
                    count => allowed[index_of(unit(seed, &axis.name, index), count)],
                }
            };
            parameters[place] = Some(parameter(axis, axis.rotor(number)));
        }
        let mut stream = RandomStream::new(seed, &format!("campaign/{index}"));
        let mut planned = PlannedFlight {
            index,
            // 53 random bits: exact in every format that stores a seed.
            seed: (stream.unit() * (1u64 << 53) as f64) as u64,
            parameters: parameters.into_iter().flatten().collect(),
        };
        // An axis may set the seeds.
        let given = planned
            .parameters
            .iter()
            .flat_map(|p| &p.set)
            .rfind(|(key, _)| key == "seed");
        if let Some(given) = given
            .and_then(|(_, value)| value.as_integer())
            .and_then(|x| u64::try_from(x).ok())
        {
            planned.seed = given;
        }
        Ok(planned)
    }

    /// A flight near `flight`: numbers perturbed by up to a tenth of their range, sometimes another value of a list, another seed half
    /// of the time.
    pub fn neighbour(&self, flight: &PlannedFlight, random: &mut RandomStream) -> PlannedFlight {
        let mut moved = flight.clone();
        for (axis, parameter) in self.axes.iter().zip(&mut moved.parameters) {
            let x = parameter.cell.number().unwrap_or(0.0);
            let choice = match &axis.source {
                Source::Uniform([low, high]) => {
                    axis.number((x + 0.1 * (high - low) * random.symmetric()).clamp(*low, *high))
                }
                Source::LogUniform([low, high]) => {
                    let factor = libm::exp(0.1 * libm::log(high / low) * random.symmetric());
                    axis.number((x * factor).clamp(*low, *high))
                }
                // An axis that another one depends on is unchanged.
                Source::List(list) if axis.other_than.is_none() && self.axes.iter().all(|a| a.other_than.is_none()) => {
                    match random.unit() < 0.15 {
                        true => list[index_of(random.unit(), list.len())].clone(),
                        false => continue,
                    }
                }
                Source::List(_) | Source::Rotors => continue,
            };
            parameter.cell = choice.cell;
            parameter.set = choice.set;
        }
        if random.unit() < 0.5 {
            moved.seed = (random.unit() * (1u64 << 53) as f64) as u64;
        }
        moved
    }

    fn nothing_left(&self, place: usize) -> ConfigError {
        let reason = "expected a value other than that of the other axis, found none";
        self.file.refuse(&format!("axis[{place}].other_than"), reason)
    }

    /// Index on each axis; the last axis varies fastest.
    fn grid_point(&self, index: u64) -> Vec<usize> {
        let grid: u64 = self.axes.iter().map(|axis| axis.grid).product();
        let mut rest = index % grid;
        let mut point = vec![0; self.axes.len()];
        for (place, axis) in self.axes.iter().enumerate().rev() {
            point[place] = usize::try_from(rest % axis.grid).expect("a grid axis has few values");
            rest /= axis.grid;
        }
        point
    }

    /// The base with parameters merged into it.
    fn table<'a>(&self, parameters: impl Iterator<Item = &'a Parameter>) -> Result<Table, ConfigError> {
        let mut table = self.base.clone();
        for parameter in parameters {
            for (key, value) in &parameter.set {
                set_value(&mut table, key, value.clone()).map_err(|reason| {
                    let place = self
                        .axes
                        .iter()
                        .position(|axis| axis.name == parameter.axis)
                        .unwrap_or(0);
                    self.file.refuse(&format!("axis[{place}]"), reason)
                })?;
            }
        }
        Ok(table)
    }

    /// The scenario document of a flight, with its own seed and name.
    pub fn scenario_table(&self, flight: &PlannedFlight) -> Result<Table, ConfigError> {
        let mut table = self.table(flight.parameters.iter())?;
        let name = format!("{}-{}", self.document.name, flight.index);
        table.insert("name".to_owned(), Value::String(name));
        let seed = i64::try_from(flight.seed).expect("seeds have 53 bits");
        table.insert("seed".to_owned(), Value::Integer(seed));
        Ok(table)
    }

    /// The scenario of a flight, checked as a whole.
    pub fn scenario(&self, flight: &PlannedFlight) -> Result<Scenario, ConfigError> {
        self.template.scenario(&self.scenario_table(flight)?)
    }

    /// Checks any table as a scenario of this campaign.
    pub fn scenario_of(&self, table: &Table) -> Result<Scenario, ConfigError> {
        self.template.scenario(table)
    }
}

/// A rejection unrelated to the values themselves: the vehicle of this one flight cannot hover. Such a flight is a row of the results.
pub(super) fn is_of_the_combination(error: &ConfigError) -> bool {
    error.key() == Some("vehicle") && error.reason().contains("cannot hover")
}

/// Key and reason: the file is the base scenario's, but the value does not come from it.
fn sentence_of(error: &ConfigError) -> String {
    match error.key() {
        Some(key) => format!("scenario key `{key}`: {}", error.reason()),
        None => error.reason().to_owned(),
    }
}

/// Dotted paths and values of the leaves; a table with a `kind` is a leaf, as for [`overlay`].
fn flattened(table: &Table) -> Vec<(String, Value)> {
    let mut leaves = Vec::new();
    for (key, value) in table {
        match value {
            Value::Table(inner) if !inner.contains_key("kind") => {
                leaves.extend(
                    flattened(inner)
                        .into_iter()
                        .map(|(rest, value)| (format!("{key}.{rest}"), value)),
                );
            }
            _ => leaves.push((key.clone(), value.clone())),
        }
    }
    leaves
}

/// Uniform in [0, 1): depends only on the campaign seed, the axis and the flight.
fn unit(seed: u64, axis: &str, index: u64) -> f64 {
    let mut key = seed.to_le_bytes().to_vec();
    key.extend(axis.as_bytes());
    let key = xxhash_rust::xxh3::xxh3_64(&key);
    RandomStream::new(key, &format!("axis/{index}")).unit()
}

fn index_of(unit: f64, count: usize) -> usize {
    ((unit * count as f64) as usize).min(count - 1)
}
