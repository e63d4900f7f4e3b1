//! Register access, and pins as outputs.

use core::ptr::{read_volatile, write_volatile};

/// GPIO ports (RM0433, 2.3.2).
pub const GPIO_A: u32 = 0x5802_0000;
pub const GPIO_B: u32 = 0x5802_0400;
pub const GPIO_C: u32 = 0x5802_0800;
pub const GPIO_D: u32 = 0x5802_0C00;
pub const GPIO_E: u32 = 0x5802_1000;

pub fn read(address: u32) -> u32 {
    // SAFETY: called with addresses of registers and of this program's stack only.
    unsafe { read_volatile(address as *const u32) }
}

pub fn write(address: u32, value: u32) {
    // SAFETY: as in `read`.
    unsafe { write_volatile(address as *mut u32, value) }
}

/// Clears bits, then sets bits.
pub fn modify(address: u32, clear: u32, set: u32) {
    write(address, read(address) & !clear | set);
}

/// Waits until a bit is set; a board on which it never is hangs here until the watchdog resets it.
pub fn wait_for(address: u32, bit: u32) {
    while read(address) >> bit & 1 == 0 {}
}

/// A level of a pin, by BSRR.
pub fn set(port: u32, pin: u32, high: bool) {
    write(port + 0x18, if high { 1 << pin } else { 1 << (pin + 16) });
}

/// A push-pull output that starts with a level.
pub fn output(port: u32, pin: u32, high: bool) {
    set(port, pin, high);
    modify(port, 0b11 << (2 * pin), 0b01 << (2 * pin));
}

/// An alternate function, fast, with a pull-up.
pub fn alternate(port: u32, pin: u32, function: u32) {
    modify(port + 0x08, 0, 0b10 << (2 * pin));
    modify(port + 0x0C, 0b11 << (2 * pin), 0b01 << (2 * pin));
    let register = port + 0x20 + 4 * (pin / 8);
    modify(register, 0xF << (4 * (pin % 8)), function << (4 * (pin % 8)));
    modify(port, 0b11 << (2 * pin), 0b10 << (2 * pin));
}
