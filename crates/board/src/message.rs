//! Content of the frames. Numbers are little-endian; the fields are those of `proto/rotortwin/v1/signals.proto` at fixed offsets,
//! without what the other side already knows.
//!
//! ```text
//!  host ── Hello ──▶ board ── Identity ──▶
//!       ── Begin {length, hash, options} ──▶ ── Acknowledge ──▶
//!       ── Chunk {offset, bytes} … ──▶ ── Acknowledge ──▶
//!       ── Commit ──▶ ── Ready {hash} or Refusal ──▶
//!       ── Sensors k ──▶ ── Reply k ──▶                       400 times a second
//!       ── Status ──▶ ── Report ──▶      ── Finish ──▶ ── Acknowledge ──▶
//! ```
//! A [`Reply`] omits unchanged data: verdicts are sent with the last step of a window, estimated losses only if there are any.
//! Nothing is rounded; the host reconstructs exactly the bits computed by the board.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::MAX_HYPOTHESES;

/// Kinds of frames.
pub mod kind {
    /// Requests the identity. Resets any earlier state.
    pub const HELLO: u8 = 0x01;
    /// A download follows.
    pub const BEGIN: u8 = 0x02;
    /// A part of the download.
    pub const CHUNK: u8 = 0x03;
    /// End of the download.
    pub const COMMIT: u8 = 0x04;
    /// The sensors of one step.
    pub const SENSORS: u8 = 0x05;
    /// Requests the status.
    pub const STATUS: u8 = 0x06;
    /// The run is over.
    pub const FINISH: u8 = 0x07;
    /// Restart, and stay in the boot loader.
    pub const BOOT_LOADER: u8 = 0x08;
    /// Answer to [`HELLO`].
    pub const IDENTITY: u8 = 0x81;
    /// Answer to [`BEGIN`], [`CHUNK`], [`FINISH`] and [`BOOT_LOADER`]: no content.
    pub const ACKNOWLEDGE: u8 = 0x82;
    /// Answer to [`COMMIT`]: the parameters are valid.
    pub const READY: u8 = 0x84;
    /// Answer to [`SENSORS`].
    pub const REPLY: u8 = 0x85;
    /// Answer to [`STATUS`].
    pub const REPORT: u8 = 0x86;
    /// A code of [`super::refusal`] and an error message.
    pub const REFUSAL: u8 = 0xFF;
}

/// Error codes of a board.
pub mod refusal {
    /// The protocol versions differ.
    pub const VERSION: u8 = 1;
    /// The downloaded bytes do not have the announced hash.
    pub const HASH: u8 = 2;
    /// The parameters describe an unflyable vehicle.
    pub const PARAMETERS: u8 = 3;
    /// A step without parameters: the board has restarted.
    pub const NO_PARAMETERS: u8 = 4;
    /// A step was skipped.
    pub const STEP_GAP: u8 = 5;
    /// An unknown message, or one of the wrong length.
    pub const MALFORMED: u8 = 6;
}

/// 64-bit FNV-1a: protects a download against mistakes, not malice.
pub fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3)
    })
}

/// Writes consecutive fields; those that do not fit are dropped and remembered.
pub struct Writer<'a> {
    bytes: &'a mut [u8],
    at: usize,
}

impl<'a> Writer<'a> {
    /// Writes to these bytes.
    pub fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, at: 0 }
    }
    /// Bytes written.
    pub fn len(&self) -> usize {
        self.at
    }
    /// True if nothing was written.
    pub fn is_empty(&self) -> bool {
        self.at == 0
    }
    /// Unwritten space.
    pub fn room(&mut self) -> &mut [u8] {
        self.bytes.get_mut(self.at..).unwrap_or_default()
    }
    /// Marks bytes put into [`Writer::room`] as written.
    pub fn advance(&mut self, length: usize) {
        self.at = (self.at + length).min(self.bytes.len());
    }
    /// Raw bytes.
    #[inline]
    pub fn put(&mut self, bytes: &[u8]) {
        if let Some(place) = self.bytes.get_mut(self.at..self.at + bytes.len()) {
            place.copy_from_slice(bytes);
            self.at += bytes.len();
        }
    }
    fn u16(&mut self, value: u16) {
        self.put(&value.to_le_bytes());
    }
    fn u32(&mut self, value: u32) {
        self.put(&value.to_le_bytes());
    }
    fn u64(&mut self, value: u64) {
        self.put(&value.to_le_bytes());
    }
    fn floats(&mut self, values: &[f32]) {
        for value in values {
            self.put(&value.to_le_bytes());
        }
    }
}

impl core::fmt::Write for Writer<'_> {
    /// A text that is too long is truncated at a character boundary.
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        let room = self.bytes.len() - self.at;
        let end = (0..=room.min(text.len()))
            .rev()
            .find(|end| text.is_char_boundary(*end))
            .unwrap_or(0);
        self.put(&text.as_bytes()[..end]);
        Ok(())
    }
}

/// Reads consecutive fields.
#[derive(Clone, Copy)]
pub struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    /// Reads from these bytes.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }
    /// Remaining bytes.
    pub fn rest(&self) -> &'a [u8] {
        self.0
    }
    #[inline]
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }
    /// One byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.take::<1>().map(|[byte]| byte)
    }
    fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }
    /// Four bytes.
    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }
    /// Eight bytes.
    pub fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }
    fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }
    #[inline]
    fn floats<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f32()?;
        }
        Some(values)
    }
    fn end<T>(self, value: T) -> Option<T> {
        self.0.is_empty().then_some(value)
    }
}

/// Which detectors run; the residual generators run whenever one of them does.
pub use rotortwin_flight_core::fdi::Detectors;

/// Options of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// The FDI engine runs on the board, too, and its residuals are in every reply.
    pub fdi: bool,
    /// Send the residuals of all rotors; otherwise the four numbers that they are projections of.
    pub residuals: bool,
    /// Which detectors run.
    pub detectors: Detectors,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            fdi: true,
            residuals: true,
            detectors: Detectors::ALL,
        }
    }
}

impl Options {
    /// Only the control law runs.
    pub const NONE: Self = Self {
        fdi: false,
        residuals: false,
        detectors: Detectors::NONE,
    };

    fn to_byte(self) -> u8 {
        let bits = [
            self.fdi,
            self.residuals,
            self.detectors.t_test,
            self.detectors.network,
            self.detectors.sequential,
        ];
        bits.iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(*bit))
    }

    fn from_byte(byte: u8) -> Self {
        let bit = |place: u8| byte >> place & 1 == 1;
        Self {
            fdi: bit(0),
            residuals: bit(1),
            detectors: Detectors {
                t_test: bit(2),
                network: bit(3),
                sequential: bit(4),
            },
        }
    }
}

/// Announces a download.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Begin {
    /// Bytes to come.
    pub length: u32,
    /// [`hash`] of them all.
    pub hash: u64,
    /// Options of the run.
    pub options: Options,
}

impl Begin {
    /// As a payload.
    pub fn write(&self, out: &mut Writer<'_>) {
        out.u32(self.length);
        out.u64(self.hash);
        out.put(&[self.options.to_byte()]);
    }
    /// From a payload.
    pub fn read(payload: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(payload);
        let begin = Self {
            length: reader.u32()?,
            hash: reader.u64()?,
            options: Options::from_byte(reader.u8()?),
        };
        reader.end(begin)
    }
}

/// Sensors and reference of one step: `SensorFrame` without run and time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensors {
    /// From 0.
    pub step: u32,
    /// Position (3), velocity (3), attitude (3), body rates (3), reference position (3), velocity (3) and yaw, battery voltage; units
    /// as in `SensorFrame`.
    pub values: [f32; 20],
}

impl Sensors {
    /// Bytes of the payload.
    pub const LENGTH: usize = 4 + 20 * 4;

    /// As a payload.
    pub fn write(&self, out: &mut Writer<'_>) {
        out.u32(self.step);
        out.floats(&self.values);
    }
    /// From a payload.
    #[inline]
    pub fn read(payload: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(payload);
        let sensors = Self {
            step: reader.u32()?,
            values: reader.floats()?,
        };
        reader.end(sensors)
    }
}

/// Verdicts of the detectors; change at the end of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdicts {
    /// Codes of T-test, network and sequential detector.
    pub codes: [i16; 3],
    /// Probability of the sequential verdict.
    pub probability: f32,
    /// Loss, low, high, share, low, high of the rotor named, and of the second one.
    pub loss: [[f32; 6]; 2],
    /// Bit mask.
    pub suspect_rotors: u16,
    /// Number of sets left open.
    pub hypothesis_count: u16,
    /// The likeliest of them, as bit masks.
    pub hypotheses: [u16; MAX_HYPOTHESES],
}

/// The FDI engine's output for a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FdiPart {
    /// The 4-axis residual.
    pub wrench_residual: [f32; 4],
    /// Of all rotors, if requested.
    pub residuals: Option<[[f32; 3]; MAX_ROTORS]>,
    /// Last step of a window.
    pub window_end: bool,
    /// Present if they may have changed.
    pub verdicts: Option<Verdicts>,
}

/// The board's answer to [`Sensors`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reply {
    /// As in the request.
    pub step: u32,
    /// Rotors of the vehicle, up to [`MAX_ROTORS`].
    pub rotor_count: u8,
    /// Fractions.
    pub duty: [f32; MAX_ROTORS],
    /// Roll, pitch, yaw, rad.
    pub attitude_setpoint: [f32; 3],
    /// Bit mask.
    pub saturated_rotors: u16,
    /// Absent if the engine runs elsewhere.
    pub fdi: Option<FdiPart>,
}

const FDI: u8 = 1;
const RESIDUALS: u8 = 2;
const WINDOW_END: u8 = 4;
const VERDICTS: u8 = 8;
const LOSS: [u8; 2] = [16, 32];
const HYPOTHESES: u8 = 64;

impl Reply {
    /// As a payload.
    #[inline]
    pub fn write(&self, out: &mut Writer<'_>) {
        let rotors = usize::from(self.rotor_count).min(MAX_ROTORS);
        let any = |values: &[f32; 6]| values.iter().any(|value| value.to_bits() != 0);
        let mut flags = 0;
        if let Some(fdi) = &self.fdi {
            flags |= FDI;
            if fdi.residuals.is_some() {
                flags |= RESIDUALS;
            }
            if fdi.window_end {
                flags |= WINDOW_END;
            }
            if let Some(verdicts) = &fdi.verdicts {
                flags |= VERDICTS;
                for (loss, bit) in verdicts.loss.iter().zip(LOSS) {
                    if any(loss) {
                        flags |= bit;
                    }
                }
                if verdicts.hypothesis_count > 0 {
                    flags |= HYPOTHESES;
                }
            }
        }
        out.u32(self.step);
        out.put(&[flags, rotors as u8]);
        out.floats(&self.duty[..rotors]);
        out.floats(&self.attitude_setpoint);
        out.u16(self.saturated_rotors);
        let Some(fdi) = &self.fdi else { return };
        out.floats(&fdi.wrench_residual);
        if let Some(residuals) = &fdi.residuals {
            out.floats(residuals[..rotors].as_flattened());
        }
        let Some(verdicts) = &fdi.verdicts else { return };
        for code in verdicts.codes {
            out.put(&code.to_le_bytes());
        }
        out.floats(&[verdicts.probability]);
        out.u16(verdicts.suspect_rotors);
        for loss in &verdicts.loss {
            if any(loss) {
                out.floats(loss);
            }
        }
        if verdicts.hypothesis_count > 0 {
            out.u16(verdicts.hypothesis_count);
            for set in verdicts.hypotheses {
                out.u16(set);
            }
        }
    }

    /// From a payload.
    pub fn read(payload: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(payload);
        let step = reader.u32()?;
        let flags = reader.u8()?;
        let has = |bit: u8| flags & bit != 0;
        let rotor_count = reader.u8()?;
        let rotors = usize::from(rotor_count);
        if rotors > MAX_ROTORS {
            return None;
        }
        let mut reply = Self {
            step,
            rotor_count,
            ..Self::default()
        };
        for duty in &mut reply.duty[..rotors] {
            *duty = reader.f32()?;
        }
        reply.attitude_setpoint = reader.floats()?;
        reply.saturated_rotors = reader.u16()?;
        if has(FDI) {
            let mut fdi = FdiPart {
                wrench_residual: reader.floats()?,
                window_end: has(WINDOW_END),
                ..FdiPart::default()
            };
            if has(RESIDUALS) {
                let mut residuals = [[0.0; 3]; MAX_ROTORS];
                for residual in &mut residuals[..rotors] {
                    *residual = reader.floats()?;
                }
                fdi.residuals = Some(residuals);
            }
            if has(VERDICTS) {
                let mut verdicts = Verdicts::default();
                for code in &mut verdicts.codes {
                    *code = reader.u16()? as i16;
                }
                verdicts.probability = reader.f32()?;
                verdicts.suspect_rotors = reader.u16()?;
                for (loss, bit) in verdicts.loss.iter_mut().zip(LOSS) {
                    if has(bit) {
                        *loss = reader.floats()?;
                    }
                }
                if has(HYPOTHESES) {
                    verdicts.hypothesis_count = reader.u16()?;
                    for set in &mut verdicts.hypotheses {
                        *set = reader.u16()?;
                    }
                }
                fdi.verdicts = Some(verdicts);
            }
            reply.fdi = Some(fdi);
        }
        reader.end(reply)
    }

    /// Bytes of the payload of a reply with the engine on board.
    ///
    /// * `residuals`: see [`Options::residuals`]   * `window_end`: with verdicts, one rotor named   * `worst`: with all optional
    ///   content
    pub const fn length(rotor_count: usize, residuals: bool, window_end: bool, worst: bool) -> usize {
        let step = 4 + 2 + 4 * rotor_count + 12 + 2 + 16;
        let all = if residuals { 12 * rotor_count } else { 0 };
        let verdicts = if window_end { 6 + 4 + 2 + 24 } else { 0 };
        let more = if worst { 24 + 2 + 2 * MAX_HYPOTHESES } else { 0 };
        step + all + verdicts + more
    }
}

/// Unit of a board's counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CostUnit {
    /// Nothing is counted.
    #[default]
    Nothing,
    /// Instructions executed.
    Instructions,
    /// Cycles of the processor.
    Cycles,
}

/// Cost of one part of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Maximum.
    pub max: u32,
    /// Step of the maximum.
    pub max_step: u32,
    /// Sum over all steps.
    pub sum: u64,
}

impl Cost {
    /// Adds one step.
    #[inline]
    pub fn push(&mut self, step: u32, cost: u32) {
        if cost > self.max {
            self.max = cost;
            self.max_step = step;
        }
        self.sum = self.sum.wrapping_add(u64::from(cost));
    }
}

/// Status of a board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Steps since the parameters were received.
    pub steps: u32,
    /// Good frames, CRC errors and garbage since it started.
    pub line: [u32; 3],
    /// Repeated requests.
    pub repeated: u32,
    /// Unit of the costs.
    pub unit: CostUnit,
    /// Cost of the control law, of the FDI engine, and of both.
    pub cost: [Cost; 3],
    /// Maximum stack use since the parameters were processed, bytes; 0 if unknown.
    pub stack_used: u32,
    /// Maximum stack use before, i.e. during their processing, which copies them.
    pub stack_before: u32,
    /// Stack size, bytes.
    pub stack_size: u32,
    /// Processor clock, Hz; 0 if meaningless.
    pub clock_hz: u32,
    /// Why it started: 0 power or reset line, 1 watchdog, 2 fault, 3 on request.
    pub reset_cause: u8,
    /// Registers of the fault, if it started after one: program counter, link register, CFSR, HFSR, BFAR (Arm v7-M, B3.2).
    pub fault: [u32; 5],
}

impl Report {
    /// Initial report.
    pub const NONE: Self = Self {
        steps: 0,
        line: [0; 3],
        repeated: 0,
        unit: CostUnit::Nothing,
        cost: [Cost {
            max: 0,
            max_step: 0,
            sum: 0,
        }; 3],
        stack_used: 0,
        stack_before: 0,
        stack_size: 0,
        clock_hz: 0,
        reset_cause: 0,
        fault: [0; 5],
    };

    /// As a payload.
    pub fn write(&self, out: &mut Writer<'_>) {
        out.u32(self.steps);
        for count in self.line {
            out.u32(count);
        }
        out.u32(self.repeated);
        out.put(&[match self.unit {
            CostUnit::Nothing => 0,
            CostUnit::Instructions => 1,
            CostUnit::Cycles => 2,
        }]);
        for cost in &self.cost {
            out.u32(cost.max);
            out.u32(cost.max_step);
            out.u64(cost.sum);
        }
        out.u32(self.stack_used);
        out.u32(self.stack_before);
        out.u32(self.stack_size);
        out.u32(self.clock_hz);
        out.put(&[self.reset_cause]);
        for register in self.fault {
            out.u32(register);
        }
    }

    /// From a payload.
    pub fn read(payload: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(payload);
        let mut report = Self {
            steps: reader.u32()?,
            ..Self::default()
        };
        for count in &mut report.line {
            *count = reader.u32()?;
        }
        report.repeated = reader.u32()?;
        report.unit = match reader.u8()? {
            0 => CostUnit::Nothing,
            1 => CostUnit::Instructions,
            2 => CostUnit::Cycles,
            _ => return None,
        };
        for cost in &mut report.cost {
            *cost = Cost {
                max: reader.u32()?,
                max_step: reader.u32()?,
                sum: reader.u64()?,
            };
        }
        report.stack_used = reader.u32()?;
        report.stack_before = reader.u32()?;
        report.stack_size = reader.u32()?;
        report.clock_hz = reader.u32()?;
        report.reset_cause = reader.u8()?;
        for register in &mut report.fault {
            *register = reader.u32()?;
        }
        reader.end(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_reply() -> impl Strategy<Value = Reply> {
        let verdicts = (
            any::<[i16; 3]>(),
            any::<u32>(),
            any::<[[u32; 6]; 2]>(),
            any::<[bool; 2]>(),
            any::<u16>(),
            any::<(bool, u16, [u16; MAX_HYPOTHESES])>(),
        )
            .prop_map(|(codes, probability, loss, present, suspect_rotors, sets)| {
                let floats = |row: [u32; 6]| row.map(|bits| f32::from_bits(bits & 0x7F7F_FFFF));
                let [first, second] = loss;
                let (some_sets, count, hypotheses) = sets;
                Verdicts {
                    codes,
                    probability: f32::from_bits(probability & 0x7F7F_FFFF),
                    loss: [
                        if present[0] { floats(first) } else { [0.0; 6] },
                        if present[1] { floats(second) } else { [0.0; 6] },
                    ],
                    suspect_rotors,
                    hypothesis_count: if some_sets { count.max(1) } else { 0 },
                    hypotheses: if some_sets { hypotheses } else { [0; MAX_HYPOTHESES] },
                }
            });
        (
            any::<u32>(),
            0u8..=16,
            proptest::array::uniform16(0.0f32..1.0),
            proptest::option::of((any::<bool>(), any::<bool>(), proptest::option::of(verdicts))),
        )
            .prop_map(|(step, rotor_count, mut duty, fdi)| {
                duty[usize::from(rotor_count)..].fill(0.0);
                let mut residuals = [[0.0; 3]; MAX_ROTORS];
                residuals[..usize::from(rotor_count)].fill([duty[0], -0.0, 1e-30]);
                Reply {
                    step,
                    rotor_count,
                    duty,
                    attitude_setpoint: [0.1, -0.2, 3.0],
                    saturated_rotors: step as u16,
                    fdi: fdi.map(|(all, window_end, verdicts)| FdiPart {
                        wrench_residual: [1.0, -2.0, 0.0, 1e-9],
                        residuals: all.then_some(residuals),
                        window_end,
                        verdicts,
                    }),
                }
            })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn prop_reply_round_trips(reply in any_reply()) {
            let mut bytes = [0; crate::frame::MAX_PAYLOAD];
            let mut writer = Writer::new(&mut bytes);
            reply.write(&mut writer);
            let length = writer.len();
            prop_assert!(length <= Reply::length(16, true, true, true));
            prop_assert_eq!(Reply::read(&bytes[..length]), Some(reply));
            // One byte less or more is not a reply.
            prop_assert_eq!(Reply::read(&bytes[..length - 1]), None);
            prop_assert_eq!(Reply::read(&bytes[..length + 1]), None);
        }

        #[test]
        fn prop_nothing_panics_on_any_payload(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
            let read = [
                Reply::read(&bytes).is_some(),
                Sensors::read(&bytes).is_some_and(|_| bytes.len() != Sensors::LENGTH),
                Begin::read(&bytes).is_some_and(|_| bytes.len() != 13),
                Report::read(&bytes).is_some_and(|_| bytes.len() != 86),
            ];
            prop_assert_eq!(&read[1..], [false; 3]);
        }

        #[test]
        fn prop_options_round_trip(byte in 0u8..32) {
            prop_assert_eq!(Options::from_byte(byte).to_byte(), byte);
        }
    }

    #[test]
    fn val_lengths_are_what_is_written() {
        let mut bytes = [0; crate::frame::MAX_PAYLOAD];
        for (rotors, residuals, window_end, worst) in
            [(6, false, false, false), (6, true, true, false), (16, true, true, true)]
        {
            let mut verdicts = Verdicts::default();
            verdicts.loss[0][0] = 1.0;
            if worst {
                verdicts.loss[1][0] = 1.0;
                verdicts.hypothesis_count = 1;
            }
            let reply = Reply {
                rotor_count: rotors,
                fdi: Some(FdiPart {
                    residuals: residuals.then_some([[0.0; 3]; MAX_ROTORS]),
                    verdicts: window_end.then_some(verdicts),
                    ..FdiPart::default()
                }),
                ..Reply::default()
            };
            let mut writer = Writer::new(&mut bytes);
            reply.write(&mut writer);
            assert_eq!(writer.len(), Reply::length(rotors.into(), residuals, window_end, worst));
        }
    }
}
