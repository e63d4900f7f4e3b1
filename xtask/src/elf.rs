//! The part of 32-bit little-endian ELF that the firmware checks need: loaded segments, and functions.

use anyhow::{Context, Result, bail};

/// A function.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Symbol<'a> {
    /// Mangled.
    pub(crate) name: &'a str,
    /// Without the Thumb bit.
    pub(crate) address: u32,
    /// Bytes.
    pub(crate) size: u32,
}

#[derive(Clone, Copy, Debug)]
struct Section {
    kind: u32,
    flags: u32,
    address: u32,
    offset: usize,
    size: usize,
    link: usize,
}

/// A parsed file.
pub(crate) struct Image<'a> {
    bytes: &'a [u8],
    sections: Vec<Section>,
    /// All functions with a size.
    pub(crate) functions: Vec<Symbol<'a>>,
}

const SYMBOLS: u32 = 2;
const NO_BITS: u32 = 8;
const WRITE: u32 = 1;
const ALLOCATED: u32 = 2;
const FUNCTION: u8 = 2;

fn u16_at(bytes: &[u8], at: usize) -> Result<u16> {
    let field = bytes.get(at..at + 2).context("the file is cut short")?;
    Ok(u16::from_le_bytes(field.try_into()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32> {
    let field = bytes.get(at..at + 4).context("the file is cut short")?;
    Ok(u32::from_le_bytes(field.try_into()?))
}

impl<'a> Image<'a> {
    pub(crate) fn parse(bytes: &'a [u8]) -> Result<Self> {
        if bytes.get(..6) != Some(b"\x7fELF\x01\x01") {
            bail!("no 32-bit little-endian ELF file");
        }
        let table = u32_at(bytes, 0x20)? as usize;
        let (entry, count) = (usize::from(u16_at(bytes, 0x2E)?), usize::from(u16_at(bytes, 0x30)?));
        let sections = (0..count)
            .map(|index| {
                let at = table + index * entry;
                Ok(Section {
                    kind: u32_at(bytes, at + 4)?,
                    flags: u32_at(bytes, at + 8)?,
                    address: u32_at(bytes, at + 12)?,
                    offset: u32_at(bytes, at + 16)? as usize,
                    size: u32_at(bytes, at + 20)? as usize,
                    link: u32_at(bytes, at + 24)? as usize,
                })
            })
            .collect::<Result<Vec<_>>>()?;
        let symbols = sections
            .iter()
            .find(|section| section.kind == SYMBOLS)
            .context("the file has no symbols")?;
        let names = sections.get(symbols.link).context("the symbols have no names")?;
        let mut functions = Vec::new();
        for at in (symbols.offset..symbols.offset + symbols.size).step_by(16) {
            let size = u32_at(bytes, at + 8)?;
            if bytes.get(at + 12).is_none_or(|info| info & 0xF != FUNCTION) || size == 0 {
                continue;
            }
            let name = bytes
                .get(names.offset + u32_at(bytes, at)? as usize..)
                .and_then(|rest| rest.split(|byte| *byte == 0).next())
                .context("a name is cut short")?;
            functions.push(Symbol {
                name: std::str::from_utf8(name)?,
                address: u32_at(bytes, at + 4)? & !1,
                size,
            });
        }
        Ok(Self {
            bytes,
            sections,
            functions,
        })
    }

    /// Bytes of flash and of static RAM.
    pub(crate) fn sizes(&self) -> (u64, u64) {
        let sum = |wanted: &dyn Fn(&Section) -> bool| {
            self.sections
                .iter()
                .filter(|section| section.flags & ALLOCATED != 0 && wanted(section))
                .map(|section| section.size as u64)
                .sum()
        };
        (
            sum(&|section| section.kind != NO_BITS),
            sum(&|section| section.flags & WRITE != 0),
        )
    }

    /// The flash image, from the lowest address on: the loaded segments at their load (not run) addresses.
    pub(crate) fn flash(&self) -> Vec<u8> {
        let field = |at: usize| u32_at(self.bytes, at).unwrap_or(0) as usize;
        let (table, entry) = (field(0x1C), 32);
        let count = usize::from(u16_at(self.bytes, 0x2C).unwrap_or(0));
        let mut segments: Vec<(usize, &[u8])> = (0..count)
            .map(|index| table + index * entry)
            .filter(|at| field(*at) == 1 && field(at + 16) > 0)
            .filter_map(|at| {
                let (offset, size) = (field(at + 4), field(at + 16));
                Some((field(at + 12), self.bytes.get(offset..offset + size)?))
            })
            .collect();
        segments.sort_by_key(|(address, _)| *address);
        let start = segments.first().map_or(0, |(address, _)| *address);
        let mut image = Vec::new();
        for (address, bytes) in segments {
            image.resize((address - start).max(image.len()), 0xFF);
            image.truncate(address - start);
            image.extend_from_slice(bytes);
        }
        image
    }

    /// The bytes of a function.
    pub(crate) fn code(&self, symbol: &Symbol<'_>) -> Option<&'a [u8]> {
        let section = self.sections.iter().find(|section| {
            section.flags & ALLOCATED != 0
                && section.kind != NO_BITS
                && (symbol.address as usize)
                    .checked_sub(section.address as usize)
                    .is_some_and(|offset| offset < section.size)
        })?;
        let start = section.offset + (symbol.address - section.address) as usize;
        self.bytes.get(start..start + symbol.size as usize)
    }
}
