//! The recorded commands of an autopilot, as bytes: a run is replayed from them without the autopilot.
//!
//! Little endian: the eight bytes `RTCMD 1\n`, u32 parts of 0.5 ms per exchange, u32 rotors, then for each exchange, prelude included, the
//! duty of each rotor as f64.

use rotortwin_flight_core::MAX_ROTORS;
use std::io::{ErrorKind, Read};

const MAGIC: [u8; 8] = *b"RTCMD 1\n";
/// Bytes before the first exchange.
const HEADER: usize = 16;

/// The first bytes of a recording of `rotors` rotors, with an exchange every `interval_parts` × 0.5 ms.
pub fn header(interval_parts: u32, rotors: usize) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend(interval_parts.to_le_bytes());
    bytes.extend((rotors as u32).to_le_bytes());
    bytes
}

/// One exchange: the duties of all rotors.
pub fn exchange(duty: &[f64]) -> Vec<u8> {
    duty.iter().flat_map(|duty| duty.to_le_bytes()).collect()
}

/// Reads a recording.
#[derive(Debug)]
pub struct CommandReader<R> {
    source: R,
    interval_parts: u32,
    rotors: usize,
    exchanges: u64,
}

impl<R: Read> CommandReader<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// It is none, or one for another number of rotors.
    pub fn open(mut source: R, rotors: usize) -> Result<Self, String> {
        let mut header = [0; HEADER];
        let whole = source.read_exact(&mut header).is_ok();
        let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let (interval_parts, count) = (word(8), word(12));
        let fits = count as usize == rotors && rotors <= MAX_ROTORS;
        if !whole || header[..8] != MAGIC || interval_parts == 0 || !fits {
            return Err(format!("expected commands of an autopilot for {rotors} rotors"));
        }
        Ok(Self {
            source,
            interval_parts,
            rotors,
            exchanges: 0,
        })
    }

    /// Parts of 0.5 ms from one exchange to the next.
    pub fn interval_parts(&self) -> u32 {
        self.interval_parts
    }

    /// The duties of the next exchange.
    ///
    /// # Errors
    /// The recording ends, cannot be read, or holds a duty that no autopilot's link passes on.
    pub fn next_exchange(&mut self) -> Result<[f64; MAX_ROTORS], String> {
        let mut duties = [0.0; MAX_ROTORS];
        for (rotor, duty) in duties[..self.rotors].iter_mut().enumerate() {
            let mut bytes = [0; 8];
            self.source.read_exact(&mut bytes).map_err(|error| match error.kind() {
                ErrorKind::UnexpectedEof => format!("ends after {} exchanges", self.exchanges),
                _ => format!("cannot be read after {} exchanges: {error}", self.exchanges),
            })?;
            *duty = f64::from_le_bytes(bytes);
            if !(0.0..=1.0).contains(duty) {
                return Err(format!(
                    "exchange {} has a duty of {duty} for rotor {}, expected 0 to 1",
                    self.exchanges,
                    rotor + 1
                ));
            }
        }
        self.exchanges += 1;
        Ok(duties)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn val_a_recording_by_hand() {
        let mut bytes = b"RTCMD 1\n\x02\0\0\0\x04\0\0\0".to_vec();
        assert_eq!(header(2, 4), bytes);
        // 0.5, 1, 0 and 0.25.
        for high in [[0xe0, 0x3f], [0xf0, 0x3f], [0, 0], [0xd0, 0x3f]] {
            bytes.extend([0; 6]);
            bytes.extend(high);
        }
        assert_eq!(exchange(&[0.5, 1.0, 0.0, 0.25]), bytes[HEADER..]);
        let mut reader = CommandReader::open(&bytes[..], 4).unwrap();
        assert_eq!(reader.interval_parts(), 2);
        assert_eq!(reader.next_exchange().unwrap()[..5], [0.5, 1.0, 0.0, 0.25, 0.0]);
        assert_eq!(reader.next_exchange(), Err("ends after 1 exchanges".to_owned()));
    }

    #[test]
    fn val_other_bytes_are_refused() {
        let said = |bytes: &[u8], rotors| CommandReader::open(bytes, rotors).err();
        let expected = |rotors: usize| Some(format!("expected commands of an autopilot for {rotors} rotors"));
        assert_eq!(said(b"short", 6), expected(6));
        assert_eq!(said(&header(2, 4), 6), expected(6));
        assert_eq!(said(&header(0, 6), 6), expected(6));
        assert_eq!(
            said(&header(2, MAX_ROTORS + 1), MAX_ROTORS + 1),
            expected(MAX_ROTORS + 1)
        );
        for (duty, word) in [(f64::NAN, "NaN"), (-0.5, "-0.5"), (1.5, "1.5"), (f64::INFINITY, "inf")] {
            let bytes = [header(2, 2), exchange(&[0.5, 0.5]), exchange(&[0.5, duty])].concat();
            let mut reader = CommandReader::open(&bytes[..], 2).unwrap();
            reader.next_exchange().unwrap();
            assert_eq!(
                reader.next_exchange(),
                Err(format!("exchange 1 has a duty of {word} for rotor 2, expected 0 to 1"))
            );
        }
    }

    proptest! {
        #[test]
        fn prop_what_is_read_is_written_again(mut bytes in proptest::collection::vec(any::<u8>(), 0..300), rotors in 0usize..=MAX_ROTORS, framed: bool) {
            if framed {
                bytes.splice(0..0, header(8, rotors));
            }
            if let Ok(mut reader) = CommandReader::open(&bytes[..], rotors) {
                let mut again = header(reader.interval_parts(), rotors);
                for _ in 0..40 {
                    let Ok(duties) = reader.next_exchange() else { break };
                    again.extend(exchange(&duties[..rotors]));
                }
                prop_assert!(bytes.starts_with(&again));
            }
        }
    }
}
