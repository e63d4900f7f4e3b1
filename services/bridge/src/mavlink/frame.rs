//! Frames of MAVLink 2: a start byte, a header of nine bytes, a payload without its trailing zeros, a checksum with the message's CRC extra.
//!
//! The decoder accepts any byte stream and finds the frames of supported messages in it. Frames of other messages are skipped unchecked;
//! their checksum cannot be verified. Signatures are skipped, not verified.

use super::catalogue::crc_extra;
use crc::Crc;
use std::collections::VecDeque;

const START: u8 = 0xfd;
const HEADER: usize = 10;
const CHECKSUM: usize = 2;
const SIGNATURE: usize = 13;
const SIGNED: u8 = 0x01;
/// Longest payload.
pub const MAX_PAYLOAD: usize = 255;

/// One frame with its payload; bytes omitted by the sender are 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Frame counter of one sender, modulo 256.
    pub sequence: u8,
    /// Sending system.
    pub system: u8,
    /// Sending component.
    pub component: u8,
    /// Kind of message.
    pub message: u32,
    /// Bytes of the payload that were sent; a sender omits zeros at the end.
    pub length: usize,
    /// Zero-padded.
    pub payload: [u8; MAX_PAYLOAD],
}

/// Checksum of frames, from their second byte on.
const CHECKSUM_OF_FRAMES: Crc<u16> = Crc::<u16>::new(&crc::CRC_16_MCRF4XX);

fn checksum(parts: &[&[u8]]) -> u16 {
    let mut digest = CHECKSUM_OF_FRAMES.digest();
    for part in parts {
        digest.update(part);
    }
    digest.finalize()
}

/// The bytes of a frame. `payload` is at most 255 bytes of a message whose CRC extra is known.
pub fn encode(sequence: u8, system: u8, component: u8, message: u32, payload: &[u8]) -> Vec<u8> {
    // The first byte always stays.
    let zeros = payload.iter().skip(1).rev().take_while(|byte| **byte == 0).count();
    let payload = &payload[..payload.len() - zeros];
    let [a, b, c, _] = message.to_le_bytes();
    let length = u8::try_from(payload.len()).unwrap_or(u8::MAX);
    let header = [START, length, 0, 0, sequence, system, component, a, b, c];
    let extra = [crc_extra(message).unwrap_or(0)];
    let crc = checksum(&[&header[1..], payload, &extra]);
    let mut bytes = Vec::with_capacity(HEADER + payload.len() + CHECKSUM);
    bytes.extend(header);
    bytes.extend(payload);
    bytes.extend(crc.to_le_bytes());
    bytes
}

/// Finds frames in a stream.
#[derive(Debug, Default)]
pub struct Decoder {
    bytes: VecDeque<u8>,
    /// Bytes outside the frames of supported messages.
    pub noise: u64,
    /// Frames with a wrong checksum.
    pub corrupt: u64,
}

impl Decoder {
    /// Adds received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend(bytes);
    }

    /// The next frame of a known message, if it is complete.
    pub fn next_frame(&mut self) -> Option<Frame> {
        let mut at = 0;
        let bytes = self.bytes.make_contiguous();
        // An apparent frame start may be noise followed by a whole frame: all starts are tried.
        let mut waiting = None;
        // End of a valid frame, so that the length of an unknown one can be trusted.
        let mut boundary = 0;
        let found = loop {
            let Some(start) = bytes[at..].iter().position(|byte| *byte == START) else {
                break None;
            };
            at += start;
            match candidate(&bytes[at..]) {
                Candidate::Incomplete => {
                    waiting.get_or_insert(at);
                    at += 1;
                }
                Candidate::Corrupt => {
                    self.corrupt += 1;
                    at += 1;
                }
                Candidate::Unknown(length) if at == boundary => {
                    at += length;
                    boundary = at;
                }
                Candidate::Unknown(_) => at += 1,
                Candidate::Whole(frame, length) => break Some((frame, length)),
            }
        };
        let Some((frame, length)) = found else {
            let keep = waiting.unwrap_or(bytes.len());
            self.noise += keep as u64;
            self.bytes.drain(..keep);
            return None;
        };
        self.noise += at as u64;
        self.bytes.drain(..at + length);
        Some(*frame)
    }
}

/// Interpretations of bytes that begin with a start byte.
enum Candidate {
    Incomplete,
    Corrupt,
    /// An unsupported message, with its length.
    Unknown(usize),
    /// A complete frame, with its length.
    Whole(Box<Frame>, usize),
}

fn candidate(bytes: &[u8]) -> Candidate {
    if bytes.len() < HEADER {
        return Candidate::Incomplete;
    }
    let length = usize::from(bytes[1]);
    let signature = if bytes[2] & SIGNED == 0 { 0 } else { SIGNATURE };
    let total = HEADER + length + CHECKSUM + signature;
    if bytes.len() < total {
        return Candidate::Incomplete;
    }
    let message = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
    let Some(extra) = crc_extra(message) else {
        return Candidate::Unknown(total);
    };
    let end = HEADER + length;
    if bytes[end..end + CHECKSUM] != checksum(&[&bytes[1..end], &[extra]]).to_le_bytes() {
        return Candidate::Corrupt;
    }
    let mut payload = [0; MAX_PAYLOAD];
    payload[..length].copy_from_slice(&bytes[HEADER..end]);
    let frame = Frame {
        sequence: bytes[4],
        system: bytes[5],
        component: bytes[6],
        message,
        length,
        payload,
    };
    Candidate::Whole(Box::new(frame), total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn val_the_checksum_is_the_catalogue_s() {
        // CRC-16/MCRF4XX of "123456789".
        assert_eq!(checksum(&[b"123456789"]), 0x6f91);
    }

    #[test]
    fn val_frames_survive_noise_and_damage() {
        let good = encode(7, 1, 1, 0, &[1, 2, 3, 4, 5, 6, 7, 8, 3]);
        let mut damaged = good.clone();
        damaged[12] ^= 1;
        let unknown = encode(8, 1, 1, 9999, &[1, 2, 3]);
        let mut decoder = Decoder::default();
        for part in [&b"noise"[..], &damaged, &unknown, &good, &good[..5]] {
            decoder.push(part);
        }
        let frame = decoder.next_frame().expect("the good one");
        assert_eq!(
            (frame.sequence, frame.message, &frame.payload[..3]),
            (7, 0, &[1, 2, 3][..])
        );
        assert_eq!(decoder.next_frame(), None);
        assert!(decoder.corrupt == 1 && decoder.noise >= 5);
        decoder.push(&good[5..]);
        assert!(decoder.next_frame().is_some());
    }

    #[test]
    fn regress_a_start_inside_of_a_damaged_frame_hides_nothing() {
        // The payload looks like the start of a frame of an unknown message, 40 bytes long.
        let mut damaged = encode(1, 1, 1, 0, &[START, 40, 0, 0, 0, 1, 1, 99, 99]);
        damaged[3] ^= 1;
        let good = encode(2, 1, 1, 0, &[1, 2, 3, 4, 5, 6, 7, 8, 3]);
        let mut decoder = Decoder::default();
        decoder.push(&damaged);
        decoder.push(&good);
        decoder.push(&good);
        decoder.push(&good);
        let found = std::iter::from_fn(|| decoder.next_frame()).count();
        assert_eq!(found, 3);
    }

    proptest! {
        #[test]
        fn prop_frames_come_back(sequence: u8, system: u8, payload in proptest::collection::vec(any::<u8>(), 1..=51), cut in 0usize..20) {
            let bytes = encode(sequence, system, 1, 253, &payload);
            let mut decoder = Decoder::default();
            let (head, tail) = bytes.split_at(cut.min(bytes.len()));
            decoder.push(head);
            decoder.push(tail);
            let frame = decoder.next_frame().expect("a frame");
            prop_assert_eq!(&frame.payload[..payload.len()], &payload[..]);
            prop_assert_eq!((frame.sequence, frame.system), (sequence, system));
            let zeros = payload[1..].iter().rev().take_while(|byte| **byte == 0).count();
            prop_assert_eq!(frame.length, payload.len() - zeros);
        }

        #[test]
        fn prop_no_bytes_break_the_decoder(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let mut decoder = Decoder::default();
            decoder.push(&bytes);
            while decoder.next_frame().is_some() {}
            prop_assert!(decoder.bytes.len() <= 300);
        }
    }
}
