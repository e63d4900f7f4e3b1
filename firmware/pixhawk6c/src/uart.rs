//! TELEM1 (UART7) and TELEM2 (UART5), 921,600 baud, 8N1, both ways by DMA1 (RM0433, 15, 17 and 48).
//!
//! Received bytes are written to a ring endlessly, and read from it up to the DMA's position; 512 bytes are 5.5 ms. An answer is copied
//! into a buffer and sent while the next bytes already arrive. The buffers are in AXI SRAM, which the memory protection unit makes
//! uncached ([`crate::memory`]).

use crate::clock::APB1_HZ;
use crate::memory::{BUFFER, Buffers};
use crate::register::{GPIO_C, GPIO_D, GPIO_E, alternate, modify, read, write};
use cortex_m::asm::dmb;

const RCC_APB1LENR: u32 = 0x5802_44E8;
const RCC_AHB1ENR: u32 = 0x5802_44D8;
const RCC_D2CCIP2R: u32 = 0x5802_4454;
const DMA1: u32 = 0x4002_0000;
const DMAMUX1: u32 = 0x4002_0800;
const BAUD: u32 = 921_600;

/// USART registers.
const CR1: u32 = 0x00;
const CR3: u32 = 0x08;
const BRR: u32 = 0x0C;
const ICR: u32 = 0x20;
const RDR: u32 = 0x24;
const TDR: u32 = 0x28;

/// DMA stream registers.
const CR: u32 = 0x00;
const NDTR: u32 = 0x04;
const PAR: u32 = 0x08;
const M0AR: u32 = 0x0C;

/// EN; memory increments; bytes on both sides; *bufferable*, without which a stream to or from a UART may lock up (erratum 2.3 of ES0392).
const ENABLE: u32 = 1;
const STREAM: u32 = 1 << 10 | 1 << 20;
const CIRCULAR: u32 = 1 << 8;
const FROM_MEMORY: u32 = 0b01 << 6;

/// One of the two ports.
pub struct Uart {
    base: u32,
    /// DMA1 streams, in and out.
    streams: [u32; 2],
    buffers: Buffers,
    /// Next byte of the ring.
    at: usize,
}

fn stream(number: u32) -> u32 {
    DMA1 + 0x10 + 0x18 * number
}

/// Clears all flags of a stream (LIFCR and HIFCR).
fn clear_flags(number: u32) {
    let register = DMA1 + if number < 4 { 0x08 } else { 0x0C };
    write(register, 0x3D << [0, 6, 16, 22][number as usize % 4]);
}

impl Uart {
    /// TELEM1: TX PE8, RX PE7.
    pub fn telem1(buffers: Buffers) -> Self {
        alternate(GPIO_E, 7, 7);
        alternate(GPIO_E, 8, 7);
        Self::start(0x4000_7800, 30, [0, 1], [79, 80], buffers)
    }

    /// TELEM2: TX PC12, RX PD2.
    pub fn telem2(buffers: Buffers) -> Self {
        alternate(GPIO_C, 12, 8);
        alternate(GPIO_D, 2, 8);
        Self::start(0x4000_5000, 20, [2, 3], [65, 66], buffers)
    }

    /// * `clock`: bit of RCC_APB1LENR   * `requests`: of the DMA multiplexer, in and out
    fn start(base: u32, clock: u32, streams: [u32; 2], requests: [u32; 2], buffers: Buffers) -> Self {
        modify(RCC_D2CCIP2R, 0b111, 0);
        modify(RCC_APB1LENR, 0, 1 << clock);
        modify(RCC_AHB1ENR, 0, 1);
        for (number, request) in streams.into_iter().zip(requests) {
            write(stream(number) + CR, 0);
            while read(stream(number) + CR) & ENABLE != 0 {}
            clear_flags(number);
            write(DMAMUX1 + 4 * number, request);
        }
        let [receive, send] = streams.map(stream);
        write(base + BRR, (APB1_HZ + BAUD / 2) / BAUD);
        // DMA both ways; an overrun does not stop it.
        write(base + CR3, 1 << 7 | 1 << 6 | 1 << 12);
        write(receive + PAR, base + RDR);
        write(receive + M0AR, buffers.receive_address());
        write(receive + NDTR, BUFFER as u32);
        write(receive + CR, STREAM | CIRCULAR | ENABLE);
        write(send + PAR, base + TDR);
        write(send + M0AR, buffers.send_address());
        // Transmitter, receiver, on.
        write(base + CR1, 1 << 3 | 1 << 2 | 1);
        Self {
            base,
            streams,
            buffers,
            at: 0,
        }
    }

    /// A received byte, if any.
    pub fn receive(&mut self) -> Option<u8> {
        let left = read(stream(self.streams[0]) + NDTR) as usize;
        // NDTR counts down and restarts; 0 is only visible briefly.
        let end = (BUFFER - left.min(BUFFER)) % BUFFER;
        if end == self.at {
            return None;
        }
        dmb();
        let byte = self.buffers.received(self.at);
        self.at = (self.at + 1) % BUFFER;
        Some(byte)
    }

    /// Starts sending; waits for data still being sent, at most as long as that can take.
    pub fn send(&mut self, bytes: &[u8]) {
        let number = self.streams[1];
        let send = stream(number);
        let mut patience = 10_000_000u32;
        while read(send + CR) & ENABLE != 0 && patience > 0 {
            patience -= 1;
        }
        write(send + CR, STREAM | FROM_MEMORY);
        clear_flags(number);
        let length = self.buffers.put(bytes);
        dmb();
        write(send + NDTR, length as u32);
        // Transmission complete, and errors of the receiver.
        write(self.base + ICR, 1 << 6 | 0b1110);
        write(send + CR, STREAM | FROM_MEMORY | ENABLE);
    }
}
