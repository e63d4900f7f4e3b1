//! Builds the boards' programs, measures them and searches them for panics.
//!
//! Flash is the loaded data; RAM is static data plus the maximum stack of a step ([`crate::stack`]; the actual use is measured on the
//! board: `rotortwin board measure`). Sizes are compared with those in `firmware/sizes.txt`.
//!
//! Panics in the step are searched for in the linked image: starting at `Application::advance`, every branch with link and every branch
//! out of the function is followed; functions that reach `core::panicking` are counted. Constants between the code may look like branches,
//! which only makes the search stricter. Calls through pointers would escape it: the step has none (no `dyn`, no formatting), and a `BLX`
//! to a register is reported, too.

use crate::branches::{Target, branches, owner};
use crate::elf::{Image, Symbol};
use anyhow::{Context, Result, bail};
use std::collections::btree_map::{BTreeMap, Entry};
use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

/// The boards, and the function in which each starts.
const BOARDS: &[(&str, &str)] = &[
    ("mps2-an500", "__cortex_m_rt_main"),
    ("pixhawk6c", "__cortex_m_rt_main"),
];

/// Maximum bytes of flash.
const FLASH_LIMIT: u64 = 128 * 1024;

/// Maximum bytes of static data and stack of a step together.
const RAM_LIMIT: u64 = 64 * 1024;

/// Growth of a program beyond its size in [`SIZES`] that requires attention: compilers differ by less.
const GROWTH: f64 = 1.05;

/// Last accepted flash, static RAM and stack of a step of every board.
const SIZES: &str = "firmware/sizes.txt";

/// Start of a step.
const STEP: &str = "Application7advance";

/// Builds every board's program and checks it.
///
/// * `keep`: writes the sizes to [`SIZES`] instead of comparing them
pub(crate) fn run(root: &Path, keep: bool) -> Result<()> {
    let toolchain = crate::thumb::toolchain(root)?;
    let mut command = crate::thumb::cargo(&toolchain);
    command
        .current_dir(root.join("firmware"))
        .args(["build", "--quiet", "--release", "--locked"]);
    crate::command::run("firmware of the boards", &mut command)?;
    let mut complaints = Vec::new();
    let mut sizes = String::from("board flash static_ram step_stack\n");
    println!("board             flash  static RAM  stack of a step   together  functions of a step, with a panic");
    for (name, entry) in BOARDS {
        let path = root.join("target/firmware/thumbv7em-none-eabihf/release").join(name);
        let bytes = std::fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
        let image = Image::parse(&bytes).with_context(|| format!("{}", path.display()))?;
        let (flash, ram) = image.sizes();
        let stack = crate::stack::bound(&image, entry, STEP).with_context(|| format!("stack of {name}"))?;
        let search = search_panics(&image)?;
        println!(
            "{name:<13}  {flash:>8}  {ram:>10}  {stack:>15}  {:>9}  {}, {}",
            ram + stack,
            search.functions,
            search.found.len()
        );
        sizes.push_str(&format!("{name} {flash} {ram} {stack}\n"));
        if *name == "pixhawk6c" {
            let file = root.join("target/firmware/pixhawk6c.px4");
            let text = crate::px4::pack(&image.flash(), env!("CARGO_PKG_VERSION"))?;
            std::fs::write(&file, text).with_context(|| format!("writing {}", file.display()))?;
            println!("               {}", file.display());
        }
        if flash > FLASH_LIMIT {
            complaints.push(format!("{name}: {flash} bytes of flash, allowed are {FLASH_LIMIT}"));
        }
        if ram + stack > RAM_LIMIT {
            complaints.push(format!(
                "{name}: {ram} bytes of static RAM and up to {stack} bytes of stack, allowed are {RAM_LIMIT} together"
            ));
        }
        complaints.extend(
            search
                .found
                .iter()
                .map(|way| format!("{name}: a step can panic: {way}")),
        );
    }
    println!("               of at most {FLASH_LIMIT} bytes of flash and {RAM_LIMIT} bytes of RAM");
    let file = root.join(SIZES);
    if keep {
        std::fs::write(&file, sizes).with_context(|| format!("writing {}", file.display()))?;
    } else {
        let kept = std::fs::read_to_string(&file).with_context(|| format!("reading {}", file.display()))?;
        complaints.extend(grown(&kept, &sizes));
    }
    if complaints.is_empty() {
        return Ok(());
    }
    bail!("the firmware breaks its promises:\n  {}", complaints.join("\n  "))
}

/// Sizes that have grown by more than [`GROWTH`].
fn grown(kept: &str, now: &str) -> Vec<String> {
    let rows = |text: &str| -> Vec<Vec<String>> {
        text.lines()
            .map(|line| line.split_whitespace().map(str::to_owned).collect())
            .collect()
    };
    let (kept, now) = (rows(kept), rows(now));
    let mut complaints = Vec::new();
    for row in now.iter().skip(1) {
        let Some(before) = kept.iter().find(|other| other.first() == row.first()) else {
            complaints.push(format!("{SIZES} has no line for {}", row[0]));
            continue;
        };
        for ((name, value), old) in now[0].iter().zip(row).zip(before).skip(1) {
            let number = |text: &str| text.parse::<f64>().unwrap_or(0.0);
            if number(value) > GROWTH * number(old) {
                complaints.push(format!(
                    "{}: {name} has grown from {old} to {value} bytes; if that is meant, 'cargo xtask firmware --keep' writes {SIZES}",
                    row[0]
                ));
            }
        }
    }
    complaints
}

struct Search {
    functions: usize,
    /// Functions that can panic, with their call paths.
    found: Vec<String>,
}

fn search_panics(image: &Image<'_>) -> Result<Search> {
    let functions: BTreeMap<u32, &Symbol<'_>> = image.functions.iter().map(|symbol| (symbol.address, symbol)).collect();
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
            let Some(callee) = owner(&functions, address) else {
                continue;
            };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_growth_is_named() {
        let kept = "board flash\na 1000\nb 1000\n";
        assert!(grown(kept, "board flash\na 1050\nb 900\n").is_empty());
        let complaints = grown(kept, "board flash\na 1051\nc 1\n");
        assert!(
            complaints[0].starts_with("a: flash has grown from 1000 to 1051"),
            "{complaints:?}"
        );
        assert!(complaints[1].contains("no line for c"), "{complaints:?}");
    }
}
