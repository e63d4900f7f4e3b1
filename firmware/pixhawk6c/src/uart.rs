//! TELEM1: UART7, TX PE8, RX PE7, 921,600 baud, 8N1, with its FIFOs of 16 bytes (RM0433, 48).

use crate::clock::APB1_HZ;
use crate::register::{GPIO_E, alternate, modify, read, write};

const RCC_APB1LENR: u32 = 0x5802_44E8;
const RCC_D2CCIP2R: u32 = 0x5802_4454;
const UART7: u32 = 0x4000_7800;
const STATUS: u32 = UART7 + 0x1C;
const BAUD: u32 = 921_600;

pub fn start() {
    modify(RCC_D2CCIP2R, 0b111, 0);
    modify(RCC_APB1LENR, 0, 1 << 30);
    alternate(GPIO_E, 7, 7);
    alternate(GPIO_E, 8, 7);
    write(UART7 + 0x0C, (APB1_HZ + BAUD / 2) / BAUD);
    // FIFO, transmitter, receiver, on.
    write(UART7, 1 << 29 | 1 << 3 | 1 << 2 | 1);
}

/// A byte, if one has come. An overrun is cleared: its frame is lost and will come again.
pub fn receive() -> Option<u8> {
    let status = read(STATUS);
    if status & 0b1110 != 0 {
        write(UART7 + 0x20, 0b1110);
    }
    (status >> 5 & 1 == 1).then(|| read(UART7 + 0x24) as u8)
}

pub fn send(bytes: &[u8]) {
    for byte in bytes {
        while read(STATUS) >> 7 & 1 == 0 {}
        write(UART7 + 0x28, u32::from(*byte));
    }
}
