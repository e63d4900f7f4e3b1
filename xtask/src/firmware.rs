//! Programs of the boards: built, measured and searched for panics.
//!
//! Flash is what is loaded; RAM is what static data takes (the stack is measured on the board: `rotortwin board measure`).
//!
//! Panics in the step are sought in the linked image: from `Application::advance` on, every branch with link and every branch that
//! leaves its function is followed; the functions are counted from which one arrives in `core::panicking`. Constants between the code may look like branches, which only
//! makes the search stricter. Calls through pointers would escape it: the step has none (no `dyn`, no formatting), and a `BLX` to a
//! register is a complaint, too.

use crate::elf::{Image, Symbol};
use anyhow::{Context, Result, bail};
use std::collections::btree_map::{BTreeMap, Entry};
use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

/// Name, most bytes of flash and of static RAM.
const BOARDS: &[(&str, u64, u64)] = &[
    ("mps2-an500", 128 * 1024, 64 * 1024),
    ("pixhawk6c", 128 * 1024, 64 * 1024),
];

/// Functions of a step that may hold a way into a panic: index checks that the compiler could not prove away, because it does not know
/// that no vehicle has more than 16 rotors. None can be taken; the number may only fall.
const KNOWN_PANICS: usize = 0;

/// Where a step begins.
const STEP: &str = "Application7advance";

/// Builds every board's program and checks it.
pub(crate) fn run(root: &Path) -> Result<()> {
    let toolchain = crate::thumb::toolchain(root)?;
    let mut command = crate::thumb::cargo(&toolchain);
    command
        .current_dir(root.join("firmware"))
        .args(["build", "--quiet", "--release", "--locked"]);
    crate::run("firmware of the boards", &mut command)?;
    let mut complaints = Vec::new();
    println!("board          flash        static RAM   functions of a step, panics");
    for (name, flash_limit, ram_limit) in BOARDS {
        let path = root.join("target/firmware/thumbv7em-none-eabihf/release").join(name);
        let bytes = std::fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
        let image = Image::parse(&bytes).with_context(|| format!("{}", path.display()))?;
        let (flash, ram) = image.sizes();
        let search = search_panics(&image)?;
        println!(
            "{name:<13}  {flash:>6} bytes {ram:>6} bytes {:>6}, {}",
            search.functions,
            search.found.len()
        );
        if *name == "pixhawk6c" {
            let file = root.join("target/firmware/pixhawk6c.px4");
            let text = crate::px4::pack(&image.flash(), env!("CARGO_PKG_VERSION"))?;
            std::fs::write(&file, text).with_context(|| format!("writing {}", file.display()))?;
            println!("               {}", file.display());
        }
        if flash > *flash_limit {
            complaints.push(format!("{name}: {flash} bytes of flash, allowed are {flash_limit}"));
        }
        if ram > *ram_limit {
            complaints.push(format!("{name}: {ram} bytes of static RAM, allowed are {ram_limit}"));
        }
        if search.found.len() > KNOWN_PANICS {
            complaints.push(format!(
                "{name}: more than {KNOWN_PANICS} functions of a step can panic"
            ));
            complaints.extend(search.found.iter().map(|way| format!("{name}: {way}")));
        }
    }
    if complaints.is_empty() {
        return Ok(());
    }
    bail!("the firmware breaks its promises:\n  {}", complaints.join("\n  "))
}

struct Search {
    functions: usize,
    /// Functions that can panic, with the way to them.
    found: Vec<String>,
}

fn search_panics(image: &Image<'_>) -> Result<Search> {
    let functions: BTreeMap<u32, &Symbol<'_>> = image.functions.iter().map(|symbol| (symbol.address, symbol)).collect();
    let owner = |address: u32| {
        functions
            .range(..=address)
            .next_back()
            .filter(|(start, symbol)| address < **start + symbol.size.max(2))
            .map(|(start, _)| *start)
    };
    let start = functions
        .values()
        .find(|symbol| symbol.name.contains(STEP))
        .with_context(|| format!("the image has no function {STEP}"))?
        .address;
    let mut came_from = BTreeMap::from([(start, start)]);
    let mut queue = VecDeque::from([start]);
    let mut found = BTreeSet::new();
    while let Some(function) = queue.pop_front() {
        let symbol = functions[&function];
        let code = image
            .code(symbol)
            .with_context(|| format!("{} has no code", symbol.name))?;
        for target in branches(function, code) {
            let Target::Address(address) = target else {
                found.insert(format!(
                    "{}: a call through a pointer",
                    chain(&functions, &came_from, function)
                ));
                continue;
            };
            let Some(callee) = owner(address) else { continue };
            if callee == function {
                continue;
            }
            if functions[&callee].name.contains("9panicking") {
                found.insert(chain(&functions, &came_from, function));
            } else if let Entry::Vacant(place) = came_from.entry(callee) {
                place.insert(function);
                queue.push_back(callee);
            }
        }
    }
    Ok(Search {
        functions: came_from.len(),
        found: found.into_iter().collect(),
    })
}

fn chain(functions: &BTreeMap<u32, &Symbol<'_>>, came_from: &BTreeMap<u32, u32>, end: u32) -> String {
    let mut names = vec![functions[&end].name];
    let mut at = end;
    while came_from[&at] != at {
        at = came_from[&at];
        names.push(functions[&at].name);
    }
    names.reverse();
    names.join(" -> ")
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Address(u32),
    Register,
}

/// Where BL and the wide B and Bcc go (Arm v7-M reference manual, A7.7.12 and A7.7.18), and whether there is a BLX to a register.
fn branches(start: u32, code: &[u8]) -> Vec<Target> {
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
