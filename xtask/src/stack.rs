//! Stack of a step, from the linked image: the longest chain of frames from the program's start through `Application::advance` and below.
//!
//! A frame is everything that a function pushes or subtracts from the stack pointer, anywhere in it; so the sum is an upper bound, not a
//! measurement. Two cases are unbounded and reported: recursion, and a frame of dynamic size.

use crate::branches::{Target, branches, owner};
use crate::elf::{Image, Symbol};
use anyhow::{Context, Result, bail};
use std::collections::BTreeMap;

/// Maximum size of an exception frame: eight words, the floating-point registers, and one word for alignment.
const EXCEPTION_FRAME: u64 = 27 * 4;

struct Graph<'a> {
    functions: BTreeMap<u32, &'a Symbol<'a>>,
    calls: BTreeMap<u32, Vec<u32>>,
    frames: BTreeMap<u32, Option<u64>>,
}

/// Maximum stack of a step, bytes.
///
/// * `entry`, `step`: parts of the names of the program's entry function and of the step function
pub(crate) fn bound(image: &Image<'_>, entry: &str, step: &str) -> Result<u64> {
    let graph = Graph::new(image)?;
    let find = |part: &str| {
        let found = graph.functions.values().find(|symbol| symbol.name.contains(part));
        Ok::<u32, anyhow::Error>(
            found
                .with_context(|| format!("the image has no function {part}"))?
                .address,
        )
    };
    let (entry, step) = (find(entry)?, find(step)?);
    let below = graph.deepest(step, &mut BTreeMap::new(), &mut Vec::new())?;
    let above = graph
        .down_to(step, entry, &mut BTreeMap::new(), &mut Vec::new())?
        .context("nothing leads from the start of the program to its step")?;
    Ok(above + below + EXCEPTION_FRAME)
}

impl<'a> Graph<'a> {
    fn new(image: &'a Image<'a>) -> Result<Self> {
        let functions: BTreeMap<u32, &Symbol<'_>> =
            image.functions.iter().map(|symbol| (symbol.address, symbol)).collect();
        let mut calls = BTreeMap::new();
        let mut frames = BTreeMap::new();
        for (address, symbol) in &functions {
            let code = image
                .code(symbol)
                .with_context(|| format!("{} has no code", symbol.name))?;
            frames.insert(*address, frame(code));
            let mut targets: Vec<u32> = branches(*address, code)
                .into_iter()
                .filter_map(|target| match target {
                    Target::Address(target) => owner(&functions, target),
                    Target::Register => None,
                })
                .filter(|target| target != address)
                .collect();
            targets.sort_unstable();
            targets.dedup();
            calls.insert(*address, targets);
        }
        Ok(Self {
            functions,
            calls,
            frames,
        })
    }

    fn frame(&self, function: u32) -> Result<u64> {
        self.frames[&function]
            .with_context(|| format!("{} works out the size of its frame", self.functions[&function].name))
    }

    /// Longest chain from a function down, including its own frame.
    fn deepest(&self, function: u32, known: &mut BTreeMap<u32, u64>, path: &mut Vec<u32>) -> Result<u64> {
        if let Some(depth) = known.get(&function) {
            return Ok(*depth);
        }
        if path.contains(&function) {
            bail!("{} calls itself", self.functions[&function].name);
        }
        path.push(function);
        let mut below = 0;
        for callee in &self.calls[&function] {
            below = below.max(self.deepest(*callee, known, path)?);
        }
        path.pop();
        let depth = self.frame(function)? + below;
        known.insert(function, depth);
        Ok(depth)
    }

    /// Longest chain from `function` to above `goal`; None if there is none.
    fn down_to(
        &self,
        goal: u32,
        function: u32,
        known: &mut BTreeMap<u32, Option<u64>>,
        path: &mut Vec<u32>,
    ) -> Result<Option<u64>> {
        if function == goal {
            return Ok(Some(0));
        }
        if let Some(depth) = known.get(&function) {
            return Ok(*depth);
        }
        if path.contains(&function) {
            return Ok(None);
        }
        path.push(function);
        let mut longest = None;
        for callee in &self.calls[&function] {
            longest = longest.max(self.down_to(goal, *callee, known, path)?);
        }
        path.pop();
        let depth = match longest {
            Some(below) => Some(below + self.frame(function)?),
            None => None,
        };
        known.insert(function, depth);
        Ok(depth)
    }
}

/// Bytes that a function pushes or subtracts from the stack pointer (Arm v7-M reference manual, A7.7: PUSH, VPUSH, STR before the stack
/// pointer, SUB from it); None if by a register.
fn frame(code: &[u8]) -> Option<u64> {
    let halves: Vec<u32> = code
        .chunks_exact(2)
        .map(|half| u32::from(u16::from_le_bytes([half[0], half[1]])))
        .collect();
    let mut bytes = 0;
    let mut k = 0;
    while k < halves.len() {
        let first = halves[k];
        if first >> 11 < 0b11101 {
            if first & 0xFE00 == 0xB400 {
                bytes += 4 * u64::from((first & 0x1FF).count_ones());
            } else if first & 0xFF80 == 0xB080 {
                bytes += 4 * u64::from(first & 0x7F);
            }
            k += 1;
            continue;
        }
        let second = halves.get(k + 1).copied().unwrap_or(0);
        k += 2;
        let to_stack_pointer = second >> 8 & 0xF == 13 && second & 0x8000 == 0;
        let immediate = (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xFF;
        if first == 0xE92D {
            bytes += 4 * u64::from(second.count_ones());
        } else if first == 0xF84D && second & 0x0FFF == 0x0D04 {
            bytes += 4;
        } else if first & 0xFFBF == 0xED2D && second & 0x0E00 == 0x0A00 {
            bytes += 4 * u64::from(second & 0xFF);
        } else if first & 0xFBEF == 0xF1AD && to_stack_pointer {
            bytes += u64::from(expand(immediate));
        } else if first & 0xFBFF == 0xF2AD && to_stack_pointer {
            bytes += u64::from(immediate);
        } else if first & 0xFFEF == 0xEBAD && to_stack_pointer {
            return None;
        }
    }
    Some(bytes)
}

/// `ThumbExpandImm` (A5.3.2) of 12 bits.
fn expand(immediate: u32) -> u32 {
    let byte = immediate & 0xFF;
    match immediate >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (0x80 | byte & 0x7F).rotate_right(immediate >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(halves: &[u16]) -> Vec<u8> {
        halves.iter().flat_map(|half| half.to_le_bytes()).collect()
    }

    #[test]
    fn val_frames_by_hand() {
        // push {r4, r5, r7, lr}; push.w {r8-r11}; vpush {d8, d9}; sub sp, #16; sub.w sp, sp, #3648; subw sp, sp, #1001; str r0, [sp, #-4]!
        let all = code(&[
            0xB5B0, 0xE92D, 0x0F00, 0xED2D, 0x8B04, 0xB084, 0xF5AD, 0x6D64, 0xF2AD, 0x3DE9, 0xF84D, 0x0D04,
        ]);
        assert_eq!(frame(&all), Some(16 + 16 + 16 + 16 + 3648 + 1001 + 4));
        // add r0, sp, #16 and bx lr take nothing; sub.w sp, sp, r4 is undetermined.
        assert_eq!(frame(&code(&[0xA804, 0x4770])), Some(0));
        assert_eq!(frame(&code(&[0xEBAD, 0x0D04])), None);
    }
}
