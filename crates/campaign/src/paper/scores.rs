//! Accuracy of a detector: confusion matrices, means over folds, intervals over seeds.

use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_flight_core::fdi::student_t::two_sided_critical_value;

/// Counts of verdicts by truth. Classes: 0 healthy, i rotor i; verdicts also "unknown fault".
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Confusion {
    /// `counts[truth][verdict]`, n_a + 1 rows of n_a + 2; the last column is the unknown fault.
    counts: Vec<Vec<u64>>,
}

impl Confusion {
    /// Empty counts for `rotor_count` rotors.
    pub fn new(rotor_count: usize) -> Self {
        Self {
            counts: vec![vec![0; rotor_count + 2]; rotor_count + 1],
        }
    }

    /// Counts one window. "Not ready" is not a verdict and must not be counted.
    pub fn add(&mut self, truth: u8, verdict: FaultVerdict) {
        let unknown = self.counts.len();
        let column = match verdict {
            FaultVerdict::Healthy => 0,
            FaultVerdict::Faulty { rotor } => usize::from(rotor) + 1,
            // Sets of rotors name no single rotor: this table counts them as unknown.
            FaultVerdict::Unknown | FaultVerdict::FaultyPair { .. } | FaultVerdict::Ambiguous => unknown,
            FaultVerdict::NotReady => {
                debug_assert!(false, "a window without a verdict is not scored");
                unknown
            }
        };
        self.counts[usize::from(truth)][column] += 1;
    }

    /// Adds the counts of `other`.
    pub fn merge(&mut self, other: &Self) {
        for (row, other) in self.counts.iter_mut().zip(&other.counts) {
            for (count, other) in row.iter_mut().zip(other) {
                *count += other;
            }
        }
    }

    /// `counts[truth][verdict]`.
    pub fn counts(&self) -> &[Vec<u64>] {
        &self.counts
    }

    /// Windows counted.
    pub fn total(&self) -> u64 {
        self.counts.iter().flatten().sum()
    }

    /// Fraction of windows with the correct verdict; NaN if there are none.
    pub fn accuracy(&self) -> f64 {
        let right: u64 = self.counts.iter().enumerate().map(|(class, row)| row[class]).sum();
        right as f64 / self.total() as f64
    }

    /// Fraction of the windows of class `truth` with the verdict in column `verdict`; NaN if there are none.
    pub fn share(&self, truth: usize, verdict: usize) -> f64 {
        let row = &self.counts[truth];
        row[verdict] as f64 / row.iter().sum::<u64>() as f64
    }

    /// Fraction of the faulty windows whose verdict satisfies `of(rotor from 1, column)`.
    pub fn fault_share(&self, of: impl Fn(usize, usize) -> bool) -> f64 {
        let (mut hits, mut total) = (0, 0);
        for (truth, row) in self.counts.iter().enumerate().skip(1) {
            for (verdict, count) in row.iter().enumerate() {
                total += count;
                hits += if of(truth, verdict) { *count } else { 0 };
            }
        }
        hits as f64 / total as f64
    }

    /// Fraction of the faulty windows that name the correct rotor, over all rotors.
    pub fn fault_recall(&self) -> f64 {
        self.fault_share(|truth, verdict| truth == verdict)
    }

    /// Fraction of the faulty windows whose verdict is "unknown fault".
    pub fn unknown_share(&self) -> f64 {
        let unknown = self.counts.len();
        self.fault_share(|_, verdict| verdict == unknown)
    }

    /// Fraction of the faulty windows that name the rotor opposite the correct one (for an even number of rotors in a ring).
    pub fn opposite_share(&self) -> f64 {
        let rotors = self.counts.len() - 1;
        self.fault_share(|truth, verdict| verdict >= 1 && verdict == (truth - 1 + rotors / 2) % rotors + 1)
    }
}

/// Mean of the values; NaN if there are none.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Sample standard deviation (n − 1); 0 for fewer than two values.
pub fn deviation(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    let mean = mean(values);
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (squares / (values.len() - 1) as f64).sqrt()
}

/// Half of the 95 % confidence interval of the mean (Student's t); `None` for fewer than two values.
pub fn interval_95(values: &[f64]) -> Option<f64> {
    if values.len() < 2 {
        return None;
    }
    let count = values.len() as f64;
    let t = two_sided_critical_value(0.05, count - 1.0)?;
    Some(t * deviation(values) / count.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_statistics_against_hand_made_numbers() {
        let values = [98.6, 98.8, 98.5, 86.0];
        assert!((mean(&values) - 95.475).abs() < 1e-12);
        // The spread caused by a single bad fold: the paper prints 6.28 for such a set.
        assert!((deviation(&values) - 6.317_9).abs() < 1e-4);
        // t(0.975, 3) = 3.182446.
        let half = interval_95(&values).expect("four values");
        assert!((half - 3.182_446 * 6.317_9 / 2.0).abs() < 1e-3);
        assert_eq!((interval_95(&[1.0]), deviation(&[1.0])), (None, 0.0));
    }

    #[test]
    fn val_shares_of_a_small_matrix() {
        let mut confusion = Confusion::new(4);
        let faulty = |rotor| FaultVerdict::Faulty { rotor };
        for (truth, verdict) in [
            (0, FaultVerdict::Healthy),
            (0, FaultVerdict::Unknown),
            (1, faulty(0)),
            (1, faulty(2)),
            (4, faulty(1)),
            (4, FaultVerdict::Unknown),
        ] {
            confusion.add(truth, verdict);
        }
        assert_eq!(confusion.accuracy(), 2.0 / 6.0);
        assert_eq!((confusion.share(0, 0), confusion.share(0, 5)), (0.5, 0.5));
        assert_eq!(confusion.fault_recall(), 0.25);
        assert_eq!(confusion.unknown_share(), 0.25);
        assert_eq!(confusion.opposite_share(), 0.5);
        let mut twice = confusion.clone();
        twice.merge(&confusion);
        assert_eq!((twice.total(), twice.accuracy()), (12, confusion.accuracy()));
    }
}
