//! Verdict codes in messages, tables and files: the paper's 0 and i, and extensions.
//!
//! A rotor has its 1-based number; two rotors i < j have 100 i + j. [`FaultVerdict::code`] returns the code of a verdict,
//! [`FaultVerdict::of_code`] the verdict of a code. Labels of the true fault use the same numbers, with [`UNKNOWN`] for several faulty
//! rotors.

use super::FaultVerdict;

/// No fault.
pub const HEALTHY: i32 = 0;
/// A fault that matches no rotor; as a label: several faulty rotors.
pub const UNKNOWN: i32 = -1;
/// The evaluator is not calibrated yet, or absent.
pub const NOT_READY: i32 = -2;
/// Several sets of rotors explain the fault.
pub const AMBIGUOUS: i32 = -3;
/// Factor on the first of two rotors.
const PAIR: i32 = 100;

/// Code of two rotors, from 1: 100 i + j.
#[inline]
pub const fn of_pair(first: i32, second: i32) -> i32 {
    PAIR * first + second
}

/// Numbers, from 1, of the rotors that a code names: none, one or two. None for a code that no verdict has.
pub fn named_rotors(code: i32) -> impl Iterator<Item = u32> + Clone {
    let [first, second] = match FaultVerdict::of_code(code) {
        Some(FaultVerdict::Faulty { rotor }) => [u32::from(rotor) + 1, 0],
        Some(FaultVerdict::FaultyPair { first, second }) => [u32::from(first) + 1, u32::from(second) + 1],
        _ => [0; 2],
    };
    [first, second].into_iter().filter(|rotor| *rotor > 0)
}

impl FaultVerdict {
    /// The paper's number: 0 healthy, i rotor i (from 1), −1 unknown fault; beyond the paper −2 not ready, −3 ambiguous, and
    /// 100 i + j the rotors i and j.
    #[inline]
    pub const fn code(self) -> i32 {
        match self {
            Self::NotReady => NOT_READY,
            Self::Unknown => UNKNOWN,
            Self::Healthy => HEALTHY,
            Self::Faulty { rotor } => rotor as i32 + 1,
            Self::FaultyPair { first, second } => of_pair(first as i32 + 1, second as i32 + 1),
            Self::Ambiguous => AMBIGUOUS,
        }
    }

    /// The verdict that has this code, for a vehicle of up to 99 rotors; `None`: no verdict has it.
    pub const fn of_code(code: i32) -> Option<Self> {
        const ONE: i32 = PAIR - 1;
        let (first, second) = (code / PAIR, code % PAIR);
        Some(match code {
            HEALTHY => Self::Healthy,
            UNKNOWN => Self::Unknown,
            NOT_READY => Self::NotReady,
            AMBIGUOUS => Self::Ambiguous,
            1..=ONE => Self::Faulty {
                rotor: (code - 1) as u8,
            },
            _ if first >= 1 && first < second => Self::FaultyPair {
                first: (first - 1) as u8,
                second: (second - 1) as u8,
            },
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn prop_a_code_and_its_verdict_belong_together() {
        let rotors = 0..99;
        let singles = rotors.clone().map(|rotor| FaultVerdict::Faulty { rotor });
        let pairs = rotors.clone().flat_map(|first| {
            let second = first + 1..99;
            second.map(move |second| FaultVerdict::FaultyPair { first, second })
        });
        let others = [
            FaultVerdict::NotReady,
            FaultVerdict::Healthy,
            FaultVerdict::Unknown,
            FaultVerdict::Ambiguous,
        ];
        let mut codes = BTreeSet::new();
        for verdict in singles.chain(pairs).chain(others) {
            assert!(codes.insert(verdict.code()), "{verdict:?}");
            assert_eq!(FaultVerdict::of_code(verdict.code()), Some(verdict));
        }
        for code in -200..10_200 {
            assert_eq!(FaultVerdict::of_code(code).is_some(), codes.contains(&code), "{code}");
        }
        assert_eq!(
            (FaultVerdict::of_code(i32::MIN), FaultVerdict::of_code(i32::MAX)),
            (None, None)
        );
    }

    #[test]
    fn val_rotors_of_a_code() {
        let named = |code| named_rotors(code).collect::<Vec<u32>>();
        assert_eq!((named(3), named(106), named(1214)), (vec![3], vec![1, 6], vec![12, 14]));
        for code in [HEALTHY, UNKNOWN, NOT_READY, AMBIGUOUS, -4, 100, 101, 201, 303] {
            assert!(named(code).is_empty(), "{code}");
        }
    }
}
