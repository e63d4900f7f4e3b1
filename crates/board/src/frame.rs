//! Frames on a serial line.
//!
//! ```text
//!  COBS( version, kind, sequence (2, little-endian), payload (0 to 512), CRC-32 (4, little-endian) ) 0x00
//! ```
//! COBS (consistent overhead byte stuffing) leaves no zero in a frame, so that a zero always ends one: whatever was lost, inserted
//! or corrupted, the receiver resynchronises at the next zero. CRC-32 is the usual one (IEEE 802.3): all burst errors of up to 32
//! bits are detected, others except for one in 4·10⁹.
//!
//! A frame costs [`overhead`] bytes beyond its payload.

use crate::PROTOCOL_VERSION;

/// Longest payload.
pub const MAX_PAYLOAD: usize = 512;
const HEADER: usize = 4;
const CRC: usize = 4;
const MAX_FRAME: usize = HEADER + MAX_PAYLOAD + CRC;
/// Longest frame on the line, the zero included.
pub const MAX_ENCODED: usize = MAX_FRAME + MAX_FRAME / 254 + 2;

/// Bytes on the line beyond a payload of this length.
pub const fn overhead(payload: usize) -> usize {
    let frame = HEADER + payload + CRC;
    HEADER + CRC + frame / 254 + 2
}

/// CRC-32 of IEEE 802.3.
pub fn crc32(bytes: &[u8]) -> u32 {
    const CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    CRC32.checksum(bytes)
}

/// Header of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Protocol version of the sender.
    pub version: u8,
    /// See [`crate::message::kind`].
    pub kind: u8,
    /// Number of the request; its answer carries the same.
    pub sequence: u16,
}

/// Writes a frame of this program's version; returns the used part of `out`.
///
/// A payload longer than [`MAX_PAYLOAD`] is truncated: no message is that long.
pub fn encode(kind: u8, sequence: u16, payload: &[u8], out: &mut [u8; MAX_ENCODED]) -> usize {
    encode_header(
        Header {
            version: PROTOCOL_VERSION,
            kind,
            sequence,
        },
        payload,
        out,
    )
}

/// [`encode`] with any version.
pub fn encode_header(header: Header, payload: &[u8], out: &mut [u8; MAX_ENCODED]) -> usize {
    let mut frame = [0; MAX_FRAME];
    let payload = &payload[..payload.len().min(MAX_PAYLOAD)];
    let end = HEADER + payload.len();
    let sequence = header.sequence.to_le_bytes();
    frame[..HEADER].copy_from_slice(&[header.version, header.kind, sequence[0], sequence[1]]);
    frame[HEADER..end].copy_from_slice(payload);
    let crc = crc32(&frame[..end]).to_le_bytes();
    frame[end..end + CRC].copy_from_slice(&crc);

    // It fits: `MAX_ENCODED` has room for the longest frame.
    let length = cobs::try_encode(&frame[..end + CRC], out).unwrap_or(0);
    if let Some(zero) = out.get_mut(length) {
        *zero = 0;
    }
    length + 1
}

/// Statistics of a receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineStatistics {
    /// Good frames.
    pub frames: u32,
    /// Frames with a wrong CRC-32.
    pub crc_errors: u32,
    /// Sequences between two zeros that are not frames: too short, too long, or not COBS.
    pub garbage: u32,
}

/// Finds frames of any length in a stream of bytes.
pub type Decoder = ShortDecoder<MAX_ENCODED>;

/// Finds frames of up to `N` bytes on the line; longer ones count as garbage.
#[derive(Clone, Debug)]
pub struct ShortDecoder<const N: usize> {
    buffer: [u8; N],
    length: usize,
    too_long: bool,
    statistics: LineStatistics,
}

impl<const N: usize> Default for ShortDecoder<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> ShortDecoder<N> {
    /// Waits for the first byte.
    pub const fn new() -> Self {
        Self {
            buffer: [0; N],
            length: 0,
            too_long: false,
            statistics: LineStatistics {
                frames: 0,
                crc_errors: 0,
                garbage: 0,
            },
        }
    }

    /// Frames and errors so far.
    pub fn statistics(&self) -> LineStatistics {
        self.statistics
    }

    /// Discards a partial frame, as after the line was lost.
    pub fn reset(&mut self) {
        self.length = 0;
        self.too_long = false;
    }

    /// Processes one byte; returns a complete, valid frame of any version.
    pub fn push(&mut self, byte: u8) -> Option<(Header, &[u8])> {
        if byte != 0 {
            match self.buffer.get_mut(self.length) {
                Some(place) => {
                    *place = byte;
                    self.length += 1;
                }
                None => self.too_long = true,
            }
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if core::mem::take(&mut self.too_long) {
            self.statistics.garbage = self.statistics.garbage.wrapping_add(1);
            return None;
        }
        if length == 0 {
            // Two consecutive zeros are empty.
            return None;
        }
        let Some(length) = cobs::decode_in_place(&mut self.buffer[..length])
            .ok()
            .filter(|length| *length >= HEADER + CRC)
        else {
            self.statistics.garbage = self.statistics.garbage.wrapping_add(1);
            return None;
        };
        let (content, crc) = self.buffer[..length].split_at(length - CRC);
        if crc != crc32(content).to_le_bytes() {
            self.statistics.crc_errors = self.statistics.crc_errors.wrapping_add(1);
            return None;
        }
        self.statistics.frames = self.statistics.frames.wrapping_add(1);
        let [version, kind, low, high, payload @ ..] = content else {
            return None;
        };
        let header = Header {
            version: *version,
            kind: *kind,
            sequence: u16::from_le_bytes([*low, *high]),
        };
        Some((header, payload))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn encoded(kind: u8, sequence: u16, payload: &[u8]) -> Vec<u8> {
        let mut out = [0; MAX_ENCODED];
        let length = encode(kind, sequence, payload, &mut out);
        out[..length].to_vec()
    }

    fn decoded(bytes: &[u8]) -> Vec<(Header, Vec<u8>)> {
        let mut decoder = Decoder::default();
        bytes
            .iter()
            .filter_map(|byte| decoder.push(*byte).map(|(header, payload)| (header, payload.to_vec())))
            .collect()
    }

    #[test]
    fn val_crc32_of_the_check_string() {
        // The check value of the catalogue of CRCs (CRC-32/ISO-HDLC).
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn val_cobs_by_hand() {
        // The CRC follows; up to it this is the example of Cheshire and Baker: 11 22 00 33.
        let mut out = [0; MAX_ENCODED];
        let header = Header {
            version: 0x11,
            kind: 0x22,
            sequence: 0x3300,
        };
        encode_header(header, &[], &mut out);
        assert_eq!(out[..4], [0x03, 0x11, 0x22, 0x06]);
        assert_eq!(out[4], 0x33);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn prop_round_trip(kind: u8, sequence: u16, payload in proptest::collection::vec(any::<u8>(), 0..=MAX_PAYLOAD)) {
            let bytes = encoded(kind, sequence, &payload);
            prop_assert!(bytes.len() <= payload.len() + overhead(payload.len()));
            prop_assert_eq!(bytes.iter().filter(|b| **b == 0).count(), 1);
            let header = Header { version: PROTOCOL_VERSION, kind, sequence };
            prop_assert_eq!(decoded(&bytes), [(header, payload)]);
        }

        #[test]
        fn prop_payload_without_zeros_round_trips(length in 200usize..=MAX_PAYLOAD, byte in 1u8..) {
            let payload = std::vec![byte; length];
            let found = decoded(&encoded(5, 0x0101, &payload));
            prop_assert_eq!(&found[0].1, &payload);
        }

        #[test]
        fn prop_any_bytes_leave_the_decoder_able_to_find_the_next_frame(
            garbage in proptest::collection::vec(any::<u8>(), 0..2000),
            payload in proptest::collection::vec(any::<u8>(), 0..100),
        ) {
            let mut bytes = garbage;
            bytes.push(0);
            bytes.extend(encoded(3, 7, &payload));
            let found = decoded(&bytes);
            prop_assert_eq!(&found[found.len() - 1].1, &payload);
        }

        #[test]
        fn prop_a_changed_or_missing_byte_never_gives_a_wrong_frame(
            payload in proptest::collection::vec(any::<u8>(), 0..100), place: prop::sample::Index, change in 1u8.., remove: bool,
        ) {
            let mut bytes = encoded(3, 7, &payload);
            let place = place.index(bytes.len());
            if remove { bytes.remove(place); } else { bytes[place] ^= change; }
            bytes.push(0);
            for (header, found) in decoded(&bytes) {
                // Repeating the frame simulates a lost closing zero: the next zero closes it.
                prop_assert_eq!((header.kind, header.sequence, &found), (3, 7, &payload));
            }
        }
    }

    #[test]
    fn val_longest_payload_fits() {
        let bytes = encoded(1, 1, &[1; MAX_PAYLOAD]);
        assert!(bytes.len() <= MAX_ENCODED);
    }
}
