//! DMA buffers, and their memory protection attributes.

use crate::register::write;
use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut, read_volatile, write_volatile};
use rotortwin_board::frame::MAX_ENCODED;

/// Bytes of a ring.
pub const BUFFER: usize = 512;

/// One port's DMA memory.
#[repr(C, align(32))]
struct Place {
    receive: [u8; BUFFER],
    send: [u8; MAX_ENCODED],
}

#[unsafe(link_section = ".dma")]
static mut PLACES: [MaybeUninit<Place>; 2] = [const { MaybeUninit::uninit() }; 2];

/// One port's buffers.
pub struct Buffers(*mut Place);

impl Buffers {
    /// Buffers of both ports. Call once.
    pub fn take() -> [Self; 2] {
        let base = addr_of_mut!(PLACES).cast::<Place>();
        [0, 1].map(|index| {
            // SAFETY: two places lie there; zero is a value of every byte of them.
            unsafe {
                let place = base.add(index);
                place.write_bytes(0, 1);
                Self(place)
            }
        })
    }

    pub fn receive_address(&self) -> u32 {
        // SAFETY: the place is there; only its address is taken.
        unsafe { addr_of!((*self.0).receive) as u32 }
    }

    pub fn send_address(&self) -> u32 {
        // SAFETY: as above.
        unsafe { addr_of!((*self.0).send) as u32 }
    }

    /// A byte written by the DMA.
    pub fn received(&self, at: usize) -> u8 {
        // SAFETY: the index is within the ring.
        unsafe { read_volatile(addr_of!((*self.0).receive).cast::<u8>().add(at % BUFFER)) }
    }

    /// Bytes for the DMA to send; returns how many fit.
    pub fn put(&mut self, bytes: &[u8]) -> usize {
        let length = bytes.len().min(MAX_ENCODED);
        for (index, byte) in bytes.iter().enumerate().take(length) {
            // SAFETY: the index is within the buffer; the DMA is at rest.
            unsafe { write_volatile(addr_of_mut!((*self.0).send).cast::<u8>().add(index), *byte) };
        }
        length
    }
}

const MPU_CTRL: u32 = 0xE000_ED94;
const MPU_RNR: u32 = 0xE000_ED98;
const MPU_RBAR: u32 = 0xE000_ED9C;
const MPU_RASR: u32 = 0xE000_EDA0;

/// AXI SRAM is not cached: the DMA bypasses the cache (Arm v7-M, B3.5). Normal memory, shared, never executed; everything else as
/// without an MPU.
pub fn protect() {
    write(MPU_CTRL, 0);
    write(MPU_RNR, 0);
    write(MPU_RBAR, 0x2400_0000);
    write(MPU_RASR, 1 << 28 | 0b011 << 24 | 0b001 << 19 | 1 << 18 | 18 << 1 | 1);
    write(MPU_CTRL, 0b101);
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}
