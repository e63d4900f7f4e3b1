//! Branches in the boards' machine code: the call graph.

use crate::elf::Symbol;
use std::collections::BTreeMap;

/// Target of a branch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    Address(u32),
    Register,
}

/// Targets of BL and the wide B and Bcc (Arm v7-M reference manual, A7.7.12 and A7.7.18), and whether there is a BLX to a
/// register.
pub(crate) fn branches(start: u32, code: &[u8]) -> Vec<Target> {
    let halves: Vec<u32> = code
        .chunks_exact(2)
        .map(|half| u32::from(u16::from_le_bytes([half[0], half[1]])))
        .collect();
    let mut targets = Vec::new();
    let mut k = 0;
    while k < halves.len() {
        let first = halves[k];
        let address = start + 2 * k as u32;
        if first >> 11 < 0b11101 {
            // BLX register: 0100 0111 1mmm m000.
            if first & 0xFF87 == 0x4780 {
                targets.push(Target::Register);
            }
            k += 1;
            continue;
        }
        let second = halves.get(k + 1).copied().unwrap_or(0);
        k += 2;
        if first >> 11 != 0b11110 || second & 0x8000 == 0 {
            continue;
        }
        let bit = |word: u32, place: u32| word >> place & 1;
        let sign = bit(first, 10);
        let (j1, j2) = (bit(second, 13), bit(second, 11));
        let offset = if bit(second, 12) == 1 {
            // BL (bit 14 set) and B.W.
            let (i1, i2) = (1 ^ j1 ^ sign, 1 ^ j2 ^ sign);
            let raw = sign << 24 | i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | (second & 0x7FF) << 1;
            extend(raw, 25)
        } else if bit(second, 14) == 0 && (first >> 6 & 0xF) < 14 {
            let raw = sign << 20 | j2 << 19 | j1 << 18 | (first & 0x3F) << 12 | (second & 0x7FF) << 1;
            extend(raw, 21)
        } else {
            continue;
        };
        targets.push(Target::Address(address.wrapping_add(4).wrapping_add(offset)));
    }
    targets
}

/// Sign extension of a number of `bits` bits.
fn extend(raw: u32, bits: u32) -> u32 {
    let sign = 1 << (bits - 1);
    (raw ^ sign).wrapping_sub(sign)
}

/// The function that contains an address.
pub(crate) fn owner(functions: &BTreeMap<u32, &Symbol<'_>>, address: u32) -> Option<u32> {
    functions
        .range(..=address)
        .next_back()
        .filter(|(start, symbol)| address < **start + symbol.size.max(2))
        .map(|(start, _)| *start)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_branches_by_hand() {
        // bl .+4+0x100 is f000 f880; b.w .-4 is f7ff bffe to itself; bne.w .+4+8 is f040 8004; blx r3 is 4798; nop is bf00.
        let code: Vec<u8> = [0xf000u16, 0xf880, 0xf7ff, 0xbffe, 0xf040, 0x8004, 0x4798, 0xbf00]
            .iter()
            .flat_map(|half| half.to_le_bytes())
            .collect();
        let targets = branches(0x1000, &code);
        let expected = [
            Target::Address(0x1104),
            Target::Address(0x1004),
            Target::Address(0x1014),
            Target::Register,
        ];
        assert_eq!(targets, expected);
    }
}
