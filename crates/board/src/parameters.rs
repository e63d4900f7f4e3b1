//! Downloaded parameters of a run: the messages `ControllerSetup` and `FdiSetup` of `proto/rotortwin/v1/setup.proto`, decoded
//! without allocation.
//!
//! ```text
//!  length of the first (4, little-endian) │ ControllerSetup (protobuf) │ FdiSetup (protobuf)
//! ```
//! Supports only the part of protobuf that these two messages need. Unknown fields are skipped, as protobuf requires; missing or
//! invalid ones are rejected by name. Whether the numbers make a flyable vehicle is up to `flight-core`.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::control::{ControllerConfig, ControllerConfigError, PidGains, ThrustToDuty};
use rotortwin_flight_core::fdi::{
    FdiConfig, FdiConfigError, Network, NetworkError, NominalThrust, SequentialConfig, TTestConfig, WeightTable,
};
use rotortwin_flight_core::frames::Vec3;
use rotortwin_flight_core::geometry::{Geometry, GeometryError, Rotor, Spin};
use rotortwin_flight_core::thrust_map::{ThrustMap, ThrustMapError};

/// Longest download: 16 rotors with a network take about 15 kB.
pub const MAX_LENGTH: usize = 16 * 1024;

/// Error in the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterError {
    /// The bytes end within a message, or are not protobuf.
    Damaged,
    /// Missing field.
    Missing(&'static str),
    /// Wrong number of entries.
    Length {
        /// Field.
        field: &'static str,
        /// Expected number, or maximum.
        expected: usize,
    },
    /// Out of range.
    Value(&'static str),
    /// An unknown parameter of the sequential detector.
    Unknown,
    /// Of the rotors.
    Geometry(GeometryError),
    /// Of Eq. 19.
    ThrustMap(ThrustMapError),
    /// Of the classifier.
    Network(NetworkError),
    /// Of the controller.
    Controller(ControllerConfigError),
    /// Of the FDI engine.
    Fdi(FdiConfigError),
}

impl core::fmt::Display for ParameterError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Damaged => out.write_str("the parameters are not a protobuf message"),
            Self::Missing(field) => write!(out, "{field} is missing"),
            Self::Length { field, expected } => write!(out, "{field} must have {expected} entries"),
            Self::Value(field) => write!(out, "{field} is outside of its range"),
            Self::Unknown => out.write_str("FdiSetup.sequential has a parameter that this board does not know"),
            Self::Geometry(error) => error.fmt(out),
            Self::ThrustMap(error) => error.fmt(out),
            Self::Network(error) => error.fmt(out),
            Self::Controller(error) => error.fmt(out),
            Self::Fdi(error) => error.fmt(out),
        }
    }
}

impl From<FdiConfigError> for ParameterError {
    fn from(error: FdiConfigError) -> Self {
        Self::Fdi(error)
    }
}

impl From<ControllerConfigError> for ParameterError {
    fn from(error: ControllerConfigError) -> Self {
        Self::Controller(error)
    }
}

type Parsed<T> = Result<T, ParameterError>;

/// One field of a protobuf message.
#[derive(Clone, Copy)]
enum Value<'a> {
    Varint(u64),
    Fixed64([u8; 8]),
    Fixed32([u8; 4]),
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    fn f32(self) -> Parsed<f32> {
        match self {
            Self::Fixed32(bytes) => Ok(f32::from_le_bytes(bytes)),
            _ => Err(ParameterError::Damaged),
        }
    }
    fn f64(self) -> Parsed<f64> {
        match self {
            Self::Fixed64(bytes) => Ok(f64::from_le_bytes(bytes)),
            _ => Err(ParameterError::Damaged),
        }
    }
    fn varint(self) -> Parsed<u64> {
        match self {
            Self::Varint(value) => Ok(value),
            _ => Err(ParameterError::Damaged),
        }
    }
    fn message(self) -> Parsed<Fields<'a>> {
        match self {
            Self::Bytes(bytes) => Ok(Fields(bytes)),
            _ => Err(ParameterError::Damaged),
        }
    }
}

/// The fields of a message, in order.
#[derive(Clone, Copy)]
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, length: usize) -> Parsed<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(length).ok_or(ParameterError::Damaged)?;
        self.0 = rest;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Parsed<[u8; N]> {
        self.take(N)?.try_into().map_err(|_length| ParameterError::Damaged)
    }

    fn varint(&mut self) -> Parsed<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let [byte] = self.array()?;
            value |= u64::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(ParameterError::Damaged)
    }

    fn next(&mut self) -> Parsed<Option<(u64, Value<'a>)>> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let key = self.varint()?;
        let value = match key & 7 {
            0 => Value::Varint(self.varint()?),
            1 => Value::Fixed64(self.array()?),
            2 => {
                let length = usize::try_from(self.varint()?).map_err(|_too_long| ParameterError::Damaged)?;
                Value::Bytes(self.take(length)?)
            }
            5 => Value::Fixed32(self.array()?),
            _ => return Err(ParameterError::Damaged),
        };
        Ok(Some((key >> 3, value)))
    }
}

/// Numbers of a repeated field, packed or not.
fn floats(value: Value<'_>, mut take: impl FnMut(f32) -> Parsed<()>) -> Parsed<()> {
    match value {
        Value::Bytes(bytes) => {
            let (numbers, rest) = bytes.as_chunks::<4>();
            if !rest.is_empty() {
                return Err(ParameterError::Damaged);
            }
            numbers.iter().try_for_each(|number| take(f32::from_le_bytes(*number)))
        }
        other => take(other.f32()?),
    }
}

/// A repeated field of known length.
struct Floats<const N: usize> {
    values: [f32; N],
    count: usize,
    field: &'static str,
}

impl<const N: usize> Floats<N> {
    const fn new(field: &'static str) -> Self {
        Self {
            values: [0.0; N],
            count: 0,
            field,
        }
    }

    fn push(&mut self, value: f32) -> Parsed<()> {
        let place = self.values.get_mut(self.count).ok_or(ParameterError::Length {
            field: self.field,
            expected: N,
        })?;
        *place = value;
        self.count += 1;
        Ok(())
    }

    fn extend(&mut self, value: Value<'_>) -> Parsed<()> {
        floats(value, |number| self.push(number))
    }

    fn all(&self) -> Parsed<[f32; N]> {
        if self.count == N {
            Ok(self.values)
        } else {
            Err(ParameterError::Length {
                field: self.field,
                expected: N,
            })
        }
    }
}

fn rotor(mut fields: Fields<'_>) -> Parsed<Rotor> {
    let mut position = [0.0; 3];
    let mut spin = None;
    let mut moment_ratio = 0.0;
    while let Some((number, value)) = fields.next()? {
        match number {
            1 => {
                let mut vector = value.message()?;
                while let Some((number, value)) = vector.next()? {
                    if let 1..=3 = number {
                        position[number as usize - 1] = value.f32()?;
                    }
                }
            }
            2 => {
                spin = match value.varint()? {
                    // Zig-zag: 2 is +1, 1 is −1.
                    2 => Some(Spin::Ccw),
                    1 => Some(Spin::Cw),
                    _ => None,
                };
            }
            3 => moment_ratio = value.f32()?,
            _ => {}
        }
    }
    Ok(Rotor {
        position_body: Vec3::from_array(position),
        spin: spin.ok_or(ParameterError::Value("rotors.spin"))?,
        moment_ratio,
    })
}

/// Collects rotors.
struct Rotors {
    list: [Rotor; MAX_ROTORS],
    count: usize,
}

impl Rotors {
    const NONE: Self = Self {
        list: [Rotor::ABSENT; MAX_ROTORS],
        count: 0,
    };

    fn push(&mut self, fields: Fields<'_>) -> Parsed<()> {
        let place = self.list.get_mut(self.count).ok_or(ParameterError::Length {
            field: "rotors",
            expected: MAX_ROTORS,
        })?;
        *place = rotor(fields)?;
        self.count += 1;
        Ok(())
    }

    fn into_geometry(self, geometry: &mut Geometry) -> Parsed<()> {
        match self.list.get(..self.count) {
            None | Some([]) => Err(ParameterError::Missing("rotors")),
            Some(rotors) => geometry.set(rotors).map_err(ParameterError::Geometry),
        }
    }
}

struct Body {
    mass: f32,
    inertia: [f32; 3],
    gravity: f32,
    linear_drag: f32,
    angular_drag: f32,
}

fn body(mut fields: Fields<'_>) -> Parsed<Body> {
    let mut inertia = Floats::<3>::new("body.inertia_body_kg_m2");
    let (mut mass, mut gravity, mut linear_drag, mut angular_drag) = (0.0, 0.0, 0.0, 0.0);
    while let Some((number, value)) = fields.next()? {
        match number {
            1 => mass = value.f32()?,
            2 => inertia.extend(value)?,
            3 => gravity = value.f32()?,
            4 => linear_drag = value.f32()?,
            5 => angular_drag = value.f32()?,
            _ => {}
        }
    }
    Ok(Body {
        mass,
        inertia: inertia.all()?,
        gravity,
        linear_drag,
        angular_drag,
    })
}

fn thrust_map(mut fields: Fields<'_>) -> Parsed<ThrustMap> {
    let mut coef = Floats::<4>::new("thrust_map.coef");
    let mut offset = 0.0;
    while let Some((number, value)) = fields.next()? {
        match number {
            1 => coef.extend(value)?,
            2 => offset = value.f32()?,
            _ => {}
        }
    }
    ThrustMap::new(coef.all()?, offset).map_err(ParameterError::ThrustMap)
}

/// Three sets of gains, one per field.
struct Gains {
    list: [PidGains; 3],
    count: usize,
}

impl Gains {
    const NONE: Self = Self {
        list: [PidGains::NONE; 3],
        count: 0,
    };

    fn push(&mut self, mut fields: Fields<'_>, field: &'static str) -> Parsed<()> {
        let gains = self
            .list
            .get_mut(self.count)
            .ok_or(ParameterError::Length { field, expected: 3 })?;
        self.count += 1;
        while let Some((number, value)) = fields.next()? {
            match number {
                1 => gains.proportional = value.f32()?,
                2 => gains.integral = value.f32()?,
                3 => gains.derivative = value.f32()?,
                _ => {}
            }
        }
        Ok(())
    }

    fn all(self, field: &'static str) -> Parsed<[PidGains; 3]> {
        if self.count == 3 {
            Ok(self.list)
        } else {
            Err(ParameterError::Length { field, expected: 3 })
        }
    }
}

/// Initial value of the vertical integrator: duty (fraction) and battery voltage (V).
pub type Trim = Option<(f32, f32)>;

/// Decodes a `ControllerSetup` into a configuration, in place.
#[inline(never)]
pub fn controller(message: &[u8], config: &mut ControllerConfig) -> Parsed<Trim> {
    let mut fields = Fields(message);
    let mut rotors = Rotors::NONE;
    let mut rigid_body = None;
    let (mut position_gains, mut attitude_gains) = (Gains::NONE, Gains::NONE);
    let mut thrust_to_duty = None;
    let (mut period, mut tilt_limit, mut trim_duty, mut trim_voltage) = (0.0, 0.0, 0.0, 0.0);
    while let Some((number, value)) = fields.next()? {
        match number {
            1 => rotors.push(value.message()?)?,
            2 => rigid_body = Some(body(value.message()?)?),
            3 => period = value.f32()?,
            4 => position_gains.push(value.message()?, "position_gains")?,
            5 => attitude_gains.push(value.message()?, "attitude_gains")?,
            6 => tilt_limit = value.f32()?,
            7 => {
                thrust_to_duty = Some(ThrustToDuty::Linear {
                    full_thrust: value.f32()?,
                });
            }
            8 => thrust_to_duty = Some(ThrustToDuty::InverseMap(thrust_map(value.message()?)?)),
            9 => trim_duty = value.f32()?,
            10 => trim_voltage = value.f32()?,
            _ => {}
        }
    }
    let rigid_body = rigid_body.ok_or(ParameterError::Missing("ControllerSetup.body"))?;
    if !(0.0..=1.0).contains(&trim_duty) {
        return Err(ParameterError::Value("ControllerSetup.trim_duty"));
    }
    rotors.into_geometry(&mut config.geometry)?;
    config.mass = rigid_body.mass;
    config.inertia_body = rigid_body.inertia;
    config.gravity = rigid_body.gravity;
    config.period = period;
    config.position_gains = position_gains.all("position_gains")?;
    config.attitude_gains = attitude_gains.all("attitude_gains")?;
    config.tilt_limit = tilt_limit;
    config.thrust_to_duty = thrust_to_duty.ok_or(ParameterError::Missing("ControllerSetup.thrust_to_duty"))?;
    Ok((trim_duty > 0.0).then_some((trim_duty, trim_voltage)))
}

/// Decodes an `FdiSetup` into a configuration, in place: a board has no room for two.
#[inline(never)]
pub fn fdi(message: &[u8], config: &mut FdiConfig) -> Parsed<()> {
    let mut fields = Fields(message);
    let mut rotors = Rotors::NONE;
    let (mut rigid_body, mut map, mut nominal, mut t_test) = (None, None, None, None);
    let (mut classifier, mut sequential) = (None, None);
    let (mut period, mut observer_gain, mut window_len) = (0.0, 0.0, 0);
    while let Some((number, value)) = fields.next()? {
        match number {
            1 => rotors.push(value.message()?)?,
            2 => rigid_body = Some(value.message()?),
            3 => period = value.f32()?,
            4 => map = Some(value.message()?),
            5 if value.varint()? == 1 => nominal = Some(NominalThrust::Static),
            6 => {
                nominal = Some(NominalThrust::Lagged {
                    time_constant: value.f32()?,
                });
            }
            7 => {
                nominal = Some(NominalThrust::Linear {
                    full_thrust: value.f32()?,
                });
            }
            8 => observer_gain = value.f32()?,
            9 => window_len = value.varint()?,
            10 => t_test = Some(value.message()?),
            11 => classifier = Some(value.message()?),
            12 => sequential = Some(value.message()?),
            _ => {}
        }
    }
    rotors.into_geometry(&mut config.geometry)?;
    let rigid_body = body(rigid_body.ok_or(ParameterError::Missing("FdiSetup.body"))?)?;
    config.mass = rigid_body.mass;
    config.inertia_body = rigid_body.inertia;
    config.gravity = rigid_body.gravity;
    config.linear_drag = rigid_body.linear_drag;
    config.angular_drag = rigid_body.angular_drag;
    config.period = period;
    config.thrust_map = thrust_map(map.ok_or(ParameterError::Missing("FdiSetup.thrust_map"))?)?;
    config.nominal_thrust = nominal.ok_or(ParameterError::Missing("FdiSetup.nominal_thrust"))?;
    config.observer_gain = observer_gain;
    config.window_len = u16::try_from(window_len)
        .ok()
        .filter(|length| (2..=1000).contains(length))
        .ok_or(ParameterError::Value("FdiSetup.window_len"))?;
    config.t_test = t_test_config(t_test.ok_or(ParameterError::Missing("FdiSetup.t_test"))?)?;
    sequential_config(
        sequential.ok_or(ParameterError::Missing("FdiSetup.sequential"))?,
        &mut config.sequential,
    )?;
    let rotor_count = config.geometry.rotor_count();
    match classifier {
        None => config.network = None,
        Some(fields) => {
            if config.network.is_none() {
                config.network = Some(Network::BLANK);
            }
            if let Some(place) = &mut config.network {
                network(fields, rotor_count, place)?;
            }
        }
    }
    Ok(())
}

fn t_test_config(mut fields: Fields<'_>) -> Parsed<TTestConfig> {
    let mut config = TTestConfig {
        alpha_detect: 0.0,
        alpha_isolate: 0.0,
        baseline_start: 0.0,
        baseline_end: 0.0,
    };
    while let Some((number, value)) = fields.next()? {
        match number {
            1 => config.alpha_detect = value.f64()?,
            2 => config.alpha_isolate = value.f64()?,
            3 => config.baseline_start = value.f32()?,
            4 => config.baseline_end = value.f32()?,
            _ => {}
        }
    }
    Ok(config)
}

/// The tables of a network, and their field numbers.
const TABLES: [(u64, WeightTable); 6] = [
    (4, WeightTable::HiddenWeight),
    (5, WeightTable::HiddenBias),
    (6, WeightTable::OutputWeight),
    (7, WeightTable::OutputBias),
    (8, WeightTable::Mean),
    (9, WeightTable::Deviation),
];

#[inline(never)]
fn network(mut fields: Fields<'_>, rotor_count: usize, network: &mut Network) -> Parsed<()> {
    network.prepare(rotor_count).map_err(ParameterError::Network)?;
    let mut counts = [0; TABLES.len()];
    let features = 3 * rotor_count as u64;
    let mut sizes = [0; 3];
    while let Some((number, value)) = fields.next()? {
        match number {
            1..=3 => sizes[number as usize - 1] = value.varint()?,
            10 => network.set_self_calibration(value.varint()? == 1),
            _ => {
                let mut tables = TABLES.iter().zip(&mut counts);
                let Some(((_, table), count)) = tables.find(|((field, _), _)| *field == number) else {
                    continue;
                };
                floats(value, |number| {
                    network.set(*table, *count, number).map_err(ParameterError::Network)?;
                    *count += 1;
                    Ok(())
                })?;
            }
        }
    }
    if sizes != [features, features, rotor_count as u64 + 1] {
        return Err(ParameterError::Value("network.inputs, hidden and outputs"));
    }
    for ((_, table), found) in TABLES.iter().zip(counts) {
        let expected = table.length(rotor_count);
        if found != expected {
            let field = table.name();
            return Err(ParameterError::Network(NetworkError::Length { field, expected, found }));
        }
    }
    Ok(())
}

/// A parameter of the sequential detector, transmitted as `f64`.
trait Parameter {
    /// False if the number is not exactly representable in this type.
    fn set(&mut self, number: f64) -> bool;
}

impl Parameter for f32 {
    fn set(&mut self, number: f64) -> bool {
        *self = number as f32;
        f64::from(*self).to_bits() == number.to_bits()
    }
}

impl Parameter for u8 {
    fn set(&mut self, number: f64) -> bool {
        *self = number as u8;
        f64::from(*self).to_bits() == number.to_bits()
    }
}

/// Sets a field by its name; the compiler rejects an incomplete list.
macro_rules! sequential_fields {
    ($($field:ident),+ $(,)?) => {
        const SEQUENTIAL_FIELDS: usize = [$(stringify!($field)),+].len();

        fn set_sequential(config: &mut SequentialConfig, name: &[u8], number: f64) -> Parsed<usize> {
            let SequentialConfig { $($field),+ } = config;
            let mut index = 0;
            $(
                if name == stringify!($field).as_bytes() {
                    let value = concat!("FdiSetup.sequential.", stringify!($field));
                    return if Parameter::set($field, number) { Ok(index) } else { Err(ParameterError::Value(value)) };
                }
                index += 1;
            )+
            Err(if index == 0 { ParameterError::Damaged } else { ParameterError::Unknown })
        }
    };
}

rotortwin_flight_core::with_sequential_fields!(sequential_fields);

fn sequential_config(mut fields: Fields<'_>, config: &mut SequentialConfig) -> Parsed<()> {
    let mut seen = 0u64;
    while let Some((number, value)) = fields.next()? {
        if number != 1 {
            continue;
        }
        let mut entry = value.message()?;
        let (mut name, mut parameter) = (&[][..], 0.0);
        while let Some((number, value)) = entry.next()? {
            match number {
                1 => name = value.message()?.0,
                2 => parameter = value.f64()?,
                _ => {}
            }
        }
        seen |= 1 << set_sequential(config, name, parameter)?;
    }
    if seen.count_ones() as usize != SEQUENTIAL_FIELDS {
        return Err(ParameterError::Missing("a parameter of FdiSetup.sequential"));
    }
    Ok(())
}

/// The two messages of a download.
pub fn split(download: &[u8]) -> Parsed<(&[u8], &[u8])> {
    let (length, rest) = download.split_first_chunk::<4>().ok_or(ParameterError::Damaged)?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
        .ok_or(ParameterError::Damaged)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use prost::Message as _;
    use rotortwin_scenario::Scenario;
    use rotortwin_wire::link::RunSetup;
    use rotortwin_wire::setup;
    use std::path::PathBuf;
    use std::vec::Vec;

    fn setups() -> Vec<RunSetup> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios");
        let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
            .expect("readable")
            .map(|entry| entry.expect("readable").path())
            .filter(|path| path.extension().is_some_and(|end| end == "toml"))
            .collect();
        files.sort();
        files
            .iter()
            .filter_map(|path| Scenario::load(path).ok())
            .map(|scenario| {
                let simulation = scenario.simulation(1).expect("flyable");
                rotortwin_flight::setup::run_setup(&scenario, &simulation, 1)
            })
            .collect()
    }

    fn controller(message: &[u8]) -> Parsed<(ControllerConfig, Trim)> {
        let mut config = ControllerConfig::BLANK;
        super::controller(message, &mut config).map(|trim| (config, trim))
    }

    fn fdi(message: &[u8]) -> Parsed<FdiConfig> {
        let mut config = FdiConfig::BLANK;
        super::fdi(message, &mut config).map(|()| config)
    }

    #[test]
    fn val_every_scenario_reads_as_the_host_reads_it() {
        let setups = setups();
        assert!(setups.len() >= 3, "{}", setups.len());
        assert!(setups.iter().any(|setup| setup.fdi.network.is_some()));
        for run in setups {
            let (config, trim) = controller(&run.controller.encode_to_vec()).expect("valid");
            let (host_config, host_trim) = setup::controller_config(&run.controller).expect("valid");
            assert_eq!(config, host_config, "{}", run.scenario);
            assert_eq!(trim, host_trim.map(|trim| (trim.duty, trim.battery_voltage)));
            let config = fdi(&run.fdi.encode_to_vec()).expect("valid");
            assert_eq!(config, setup::fdi_config(&run.fdi).expect("valid"), "{}", run.scenario);
        }
    }

    #[test]
    fn val_what_is_missing_is_named() {
        let run = &setups()[0];
        let mut setup = run.fdi.clone();
        setup
            .sequential
            .as_mut()
            .expect("there")
            .parameters
            .remove("drift_share");
        let error = fdi(&setup.encode_to_vec()).expect_err("incomplete");
        assert_eq!(error, ParameterError::Missing("a parameter of FdiSetup.sequential"));
        let mut setup = run.controller.clone();
        setup.body = None;
        let error = controller(&setup.encode_to_vec()).expect_err("incomplete");
        assert_eq!(error, ParameterError::Missing("ControllerSetup.body"));
        setup.rotors = std::vec![setup.rotors[0]; 17];
        let error = controller(&setup.encode_to_vec()).expect_err("too many");
        assert_eq!(
            error,
            ParameterError::Length {
                field: "rotors",
                expected: 16
            }
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn prop_damaged_parameters_are_refused_or_read_and_never_panic(
            place: prop::sample::Index, value: u8, cut: prop::sample::Index, scenario: prop::sample::Index,
        ) {
            static SETUPS: std::sync::LazyLock<Vec<RunSetup>> = std::sync::LazyLock::new(setups);
            let run = &SETUPS[scenario.index(SETUPS.len())];
            let mut bytes = run.fdi.encode_to_vec();
            let place = place.index(bytes.len());
            bytes[place] = value;
            let cut = cut.index(bytes.len());
            // A full protobuf decoder is not less strict.
            let host = rotortwin_proto::FdiSetup::decode(&bytes[..]).map(|setup| setup::fdi_config(&setup));
            if let (Ok(board), Ok(Ok(host))) = (fdi(&bytes), host) {
                // NaN is not equal to itself.
                if !std::format!("{host:?}").contains("NaN") {
                    prop_assert_eq!(board, host);
                }
            }
            prop_assert!(fdi(&bytes[..cut]).is_err() || cut > 100);
        }
    }
}
