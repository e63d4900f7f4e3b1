//! UART0 (CMSDK): a byte stream, as on a real board.
//!
//! The model holds one received byte; the interrupt wakes the processor, which then polls. Masking interrupts around the poll
//! prevents the processor from sleeping through a byte that arrives between poll and sleep.

use crate::Mps2;
use core::ptr::{read_volatile, write_volatile};
use rotortwin_board::application::Application;

const DATA: *mut u32 = 0x4000_4000 as *mut u32;
const STATE: *mut u32 = 0x4000_4004 as *mut u32;
const CONTROL: *mut u32 = 0x4000_4008 as *mut u32;
const INTERRUPT: *mut u32 = 0x4000_400C as *mut u32;
const DIVIDER: *mut u32 = 0x4000_4010 as *mut u32;
const TX_FULL: u32 = 1;
const RX_FULL: u32 = 2;
const NVIC_ENABLE: *mut u32 = 0xE000_E100 as *mut u32;
const NVIC_CLEAR_PENDING: *mut u32 = 0xE000_E280 as *mut u32;

#[expect(unsafe_code, reason = "registers of the UART and of the interrupt controller")]
fn read(register: *mut u32) -> u32 {
    // SAFETY: called with the registers above only; they are always there.
    unsafe { read_volatile(register) }
}

#[expect(unsafe_code, reason = "registers of the UART and of the interrupt controller")]
fn write(register: *mut u32, value: u32) {
    // SAFETY: called with the registers above only; they are always there.
    unsafe { write_volatile(register, value) }
}

/// Never returns: the host ends the emulator.
pub fn serve(application: &mut Application, board: &mut Mps2) -> ! {
    write(DIVIDER, 16);
    // Transmit, receive, receive interrupt.
    write(CONTROL, 0b1011);
    cortex_m::interrupt::disable();
    write(NVIC_ENABLE, 1);
    loop {
        while read(STATE) & RX_FULL == 0 {
            cortex_m::asm::wfi();
            write(INTERRUPT, 2);
            write(NVIC_CLEAR_PENDING, 1);
        }
        let byte = read(DATA) as u8;
        if let Some(answer) = application.receive(byte, board) {
            for byte in answer {
                while read(STATE) & TX_FULL != 0 {}
                write(DATA, u32::from(*byte));
            }
        }
    }
}
