//! Clock tree (RM0433, 8.5 and 6.6): 16 MHz crystal, PLL1 M1 N60 P2 = 480 MHz, AHB 240 MHz, all APB 120 MHz. As PX4 sets it.

use crate::register::{modify, read, wait_for, write};

/// Clock of the processor.
pub const SYSTEM_HZ: u32 = 480_000_000;
/// Clock of APB1, which feeds UART7.
pub const APB1_HZ: u32 = 120_000_000;

const PWR: u32 = 0x5802_4800;
const RCC: u32 = 0x5802_4400;
const SYSCFG_PWRCR: u32 = 0x5800_042C;
const FLASH_ACR: u32 = 0x5200_2000;

/// Switches from the internal oscillator, on which the boot loader leaves the processor, to 480 MHz.
pub fn start() {
    // The regulator gives the core's voltage; scale 1, then the overdrive of scale 0.
    wait_for(PWR + 0x04, 13);
    modify(PWR + 0x18, 0, 0b11 << 14);
    wait_for(PWR + 0x18, 13);
    modify(RCC + 0xF4, 0, 1 << 1);
    modify(SYSCFG_PWRCR, 0, 1);
    wait_for(PWR + 0x18, 13);
    // Four wait states, programming delay 2.
    write(FLASH_ACR, 0x24);
    while read(FLASH_ACR) & 0x3F != 0x24 {}
    modify(RCC, 0, 1 << 16);
    wait_for(RCC, 17);
    // PLL1 is off while it is configured.
    modify(RCC, 1 << 24, 0);
    while read(RCC) >> 25 & 1 == 1 {}
    modify(RCC + 0x28, 0x3F << 4 | 0b11, 1 << 4 | 0b10);
    modify(RCC + 0x2C, 0xF, 0b11 << 2 | 0b111 << 16);
    write(RCC + 0x30, 7 << 24 | 3 << 16 | 1 << 9 | 59);
    modify(RCC, 0, 1 << 24);
    wait_for(RCC, 25);
    // Dividers before the switch, so that no bus is ever too fast.
    write(RCC + 0x18, 0b100 << 4 | 0b1000);
    write(RCC + 0x1C, 0b100 << 8 | 0b100 << 4);
    write(RCC + 0x20, 0b100 << 4);
    modify(RCC + 0x10, 0b111, 0b011);
    while read(RCC + 0x10) >> 3 & 0b111 != 0b011 {}
}
