//! Frames in the hexadecimal output of other programs, for tests.

use super::frame::{Decoder, Frame};

pub(super) fn bytes(hex: &str) -> Vec<u8> {
    let digit = |c: u8| (c as char).to_digit(16).expect("a hexadecimal digit") as u8;
    hex.as_bytes()
        .chunks(2)
        .map(|pair| digit(pair[0]) << 4 | digit(pair[1]))
        .collect()
}

pub(super) fn frame(hex: &str) -> Frame {
    let mut decoder = Decoder::default();
    decoder.push(&bytes(hex));
    decoder.next_frame().expect("a good frame")
}
