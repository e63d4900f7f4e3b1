//! Labelled features, their split, and their scaling.

use rotortwin_plant::random::RandomStream;

/// Rows of features with a class each. Features are f32, as the detectors have them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    features: usize,
    values: Vec<f32>,
    labels: Vec<u8>,
}

impl Samples {
    /// No rows, with `features` numbers each.
    pub fn new(features: usize) -> Self {
        Self {
            features,
            values: Vec::new(),
            labels: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn push(&mut self, row: &[f32], label: u8) {
        debug_assert_eq!(row.len(), self.features);
        self.values.extend_from_slice(row);
        self.labels.push(label);
    }

    /// Numbers per row.
    pub fn features(&self) -> usize {
        self.features
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.labels.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }

    /// Row `i`.
    pub fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.features..][..self.features]
    }

    /// Class of each row.
    pub fn labels(&self) -> &[u8] {
        &self.labels
    }

    /// Content hash over all rows and labels, in their order.
    pub fn content_hash(&self) -> String {
        let mut bytes = Vec::with_capacity(4 * self.values.len() + self.labels.len());
        bytes.extend(self.values.iter().flat_map(|value| value.to_le_bytes()));
        bytes.extend_from_slice(&self.labels);
        rotortwin_flight::run_hash::content_hash(&bytes)
    }
}

/// Row indices of the two parts, each in increasing order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Training part.
    pub training: Vec<u32>,
    /// Validation part.
    pub validation: Vec<u32>,
}

/// Splits `rows` at random so that the fraction `training_share` of each class is used for training (rounded to whole
/// rows).
pub fn stratified_split(labels: &[u8], rows: &[u32], training_share: f64, random: &mut RandomStream) -> Split {
    let classes = labels.iter().max().map_or(0, |label| usize::from(*label) + 1);
    let mut by_class: Vec<Vec<u32>> = vec![Vec::new(); classes];
    for row in rows {
        by_class[usize::from(labels[*row as usize])].push(*row);
    }
    let (mut training, mut validation) = (Vec::new(), Vec::new());
    for mut class in by_class {
        shuffle(&mut class, random);
        let count = libm::round(class.len() as f64 * training_share) as usize;
        training.extend_from_slice(&class[..count]);
        validation.extend_from_slice(&class[count..]);
    }
    training.sort_unstable();
    validation.sort_unstable();
    Split { training, validation }
}

/// Shuffles the items (Fisher–Yates).
pub fn shuffle<T>(items: &mut [T], random: &mut RandomStream) {
    for i in (1..items.len()).rev() {
        // unit() is below 1, so this is at most i.
        let j = (random.unit() * (i + 1) as f64) as usize;
        items.swap(i, j);
    }
}

/// z = (x − mean)/deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZScore {
    /// Each feature with its own mean and deviation.
    PerFeature,
    /// All features with one mean and deviation.
    Pooled,
}

impl ZScore {
    /// Name in a classifier file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::PerFeature => "per-feature",
            Self::Pooled => "pooled",
        }
    }
}

/// Mean and deviation of every feature over the training part; all equal if pooled. Sample deviation (n − 1).
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    /// Means.
    pub mean: Vec<f64>,
    /// Deviations, above 0.
    pub deviation: Vec<f64>,
}

impl Scaling {
    /// Scaling over `rows` of `samples`.
    pub fn new(samples: &Samples, rows: &[u32], kind: ZScore) -> Self {
        let features = samples.features();
        let count = rows.len() as f64;
        let mut mean = vec![0.0; features];
        for row in rows {
            for (sum, x) in mean.iter_mut().zip(samples.row(*row as usize)) {
                *sum += f64::from(*x);
            }
        }
        mean.iter_mut().for_each(|sum| *sum /= count);
        if kind == ZScore::Pooled {
            let all = mean.iter().sum::<f64>() / features as f64;
            mean.fill(all);
        }
        let mut squares = vec![0.0; features];
        for row in rows {
            for ((square, x), mean) in squares.iter_mut().zip(samples.row(*row as usize)).zip(&mean) {
                let centred = f64::from(*x) - mean;
                *square += centred * centred;
            }
        }
        let deviation = match kind {
            ZScore::PerFeature => squares.iter().map(|sum| (sum / (count - 1.0)).sqrt()).collect(),
            ZScore::Pooled => {
                let sum: f64 = squares.iter().sum();
                vec![(sum / (count * features as f64 - 1.0)).sqrt(); features]
            }
        };
        Self { mean, deviation }
    }

    /// Writes the scaled `row` to `z`.
    #[inline]
    pub fn scale(&self, row: &[f32], z: &mut [f64]) {
        for (((z, x), mean), deviation) in z.iter_mut().zip(row).zip(&self.mean).zip(&self.deviation) {
            *z = (f64::from(*x) - mean) / deviation;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_scaling_against_hand_made_numbers() {
        let mut samples = Samples::new(2);
        for row in [[1.0, 10.0], [2.0, 10.0], [3.0, 16.0]] {
            samples.push(&row, 0);
        }
        let own = Scaling::new(&samples, &[0, 1, 2], ZScore::PerFeature);
        assert_eq!((own.mean, own.deviation), (vec![2.0, 12.0], vec![1.0, 12f64.sqrt()]));
        let pooled = Scaling::new(&samples, &[0, 1, 2], ZScore::Pooled);
        // Mean 7; squares 36 + 9 + 25 + 9 + 16 + 81 = 176 over 5.
        assert_eq!((pooled.mean, pooled.deviation), (vec![7.0; 2], vec![35.2f64.sqrt(); 2]));
    }

    #[test]
    fn prop_split_keeps_the_share_of_each_class_and_every_row_once() {
        let labels: Vec<u8> = (0..1000)
            .map(|i| if i % 2 == 0 { 0 } else { 1 + (i % 6) as u8 })
            .collect();
        let rows: Vec<u32> = (100..900).collect();
        let split = stratified_split(&labels, &rows, 0.7, &mut RandomStream::new(1, "split"));
        let mut all = [split.training.clone(), split.validation.clone()].concat();
        all.sort_unstable();
        assert_eq!(all, rows);
        for class in 0..7 {
            let count = |rows: &[u32]| rows.iter().filter(|row| labels[**row as usize] == class).count() as f64;
            let (training, total) = (count(&split.training), count(&rows));
            assert!(
                (training - 0.7 * total).abs() <= 0.5,
                "class {class}: {training} of {total}"
            );
        }
        let again = stratified_split(&labels, &rows, 0.7, &mut RandomStream::new(1, "split"));
        assert_eq!(again, split);
        let other = stratified_split(&labels, &rows, 0.7, &mut RandomStream::new(2, "split"));
        assert_ne!(other, split);
    }
}
