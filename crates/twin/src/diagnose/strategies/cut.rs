//! Columns that begin at a time t₀: what a whitener's memory does to their products.
//!
//! The torques are whitened by a filter that remembers ([`crate::predict::RateNoise`]: with a torque that drifts it forgets a constant one). The
//! whitened column of an effect from t₀ on is then not the rest of the whitened column of the whole effect: a step of the centre of mass is a pulse at
//! t₀, and the rest of the whole column from there on is nothing. The filter is linear. With s what it remembers of the whole column before t₀, and h the
//! response to that,
//!
//! w′_k = w_k − h_k s,   Σ w′ y = Σ w y − s·λ_y,   Σ w′_a w′_b = Σ w_a w_b − s_a·λ_b − s_b·λ_a + s_aᵀ P s_b,
//!
//! sums over k ≥ t₀, λ_y = Σ h y and P = Σ h hᵀ, both by one recursion backwards.

use rayon::prelude::*;

use crate::estimation::columns::Column;
use crate::estimation::problem::Problem;
use crate::predict::{CHANNELS, Whitener};

/// What the filter of one channel remembers of a column before each row, and the column's λ there.
#[derive(Debug, Clone)]
struct Memory {
    state: Vec<[f64; 2]>,
    echo: Vec<[f64; 2]>,
}

/// The memories of a column, channel by channel of [`Cuts`].
#[derive(Debug, Clone)]
pub(crate) struct Memories(Vec<Option<Memory>>);

/// One channel whose whitener remembers.
#[derive(Debug, Clone)]
struct CutChannel {
    channel: usize,
    weight: f64,
    residual: Vec<[f64; 2]>,
    squares: Vec<[[f64; 2]; 2]>,
}

/// Corrections of products of columns that begin at some rows of the only log.
#[derive(Debug, Clone)]
pub(crate) struct Cuts {
    at: Vec<usize>,
    channels: Vec<CutChannel>,
    /// By column of the log.
    columns: Vec<Memories>,
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

impl Cuts {
    /// * `at`: rows at which a column may begin
    pub(crate) fn new(problem: &Problem, mut at: Vec<usize>) -> Self {
        at.sort_unstable();
        at.dedup();
        let (predictor, linear) = (&problem.logs[0].predictor, &problem.linear[0]);
        let channels: Vec<CutChannel> = (0..CHANNELS)
            .filter_map(|channel| {
                let whitener = predictor.whitener(channel).filter(|one| one.remembers())?;
                Some(CutChannel {
                    channel,
                    weight: problem.weights[0][channel],
                    residual: whitener.echoes(|k| linear.residual[channel][k], &at),
                    squares: whitener.echo_squares(&at),
                })
            })
            .collect();
        let mut cuts = Self {
            at,
            channels,
            columns: Vec::new(),
        };
        cuts.columns = linear
            .columns
            .par_iter()
            .map(|column| cuts.memories(problem, column))
            .collect();
        cuts
    }

    /// Those of any column.
    pub(crate) fn memories(&self, problem: &Problem, column: &Column) -> Memories {
        let of = |one: &CutChannel| {
            let own = column[one.channel].as_ref()?;
            let whitener: &Whitener = problem.logs[0].predictor.whitener(one.channel)?;
            Some(Memory {
                state: whitener.remembered(own, &self.at),
                echo: whitener.echoes(|k| f64::from(own[k]), &self.at),
            })
        };
        Memories(self.channels.iter().map(of).collect())
    }

    /// Those of a column of the log.
    pub(crate) fn of(&self, column: usize) -> &Memories {
        &self.columns[column]
    }

    /// Place of a row among those that were given.
    pub(crate) fn place(&self, row: usize) -> usize {
        self.at.partition_point(|&at| at < row)
    }

    /// Corrects Σ w y of a column cut at a place with every column of the problem and with the residual, which is last.
    pub(crate) fn correct(&self, problem: &Problem, place: usize, cut: &Memories, products: &mut [f64]) {
        for (c, channel) in self.channels.iter().enumerate() {
            let Some(own) = &cut.0[c] else { continue };
            let state = own.state[place].map(|s| channel.weight * s);
            for (i, other) in self.columns.iter().enumerate() {
                if let Some(other) = &other.0[c] {
                    products[problem.global(0, i)] -= dot(state, other.echo[place]);
                }
            }
            if let Some(last) = products.last_mut() {
                *last -= dot(state, channel.residual[place]);
            }
        }
    }

    /// What Σ w_a w_b of two columns that are both cut at a place has to be corrected by.
    pub(crate) fn of_both(&self, place: usize, a: &Memories, b: &Memories) -> f64 {
        let channels = self.channels.iter().zip(a.0.iter().zip(&b.0));
        channels
            .filter_map(|(channel, (a, b))| {
                let (a, b) = (a.as_ref()?, b.as_ref()?);
                let form = channel.squares[place].map(|row| dot(row, b.state[place]));
                let sum =
                    dot(a.state[place], form) - dot(a.state[place], b.echo[place]) - dot(b.state[place], a.echo[place]);
                Some(channel.weight * sum)
            })
            .sum()
    }
}
