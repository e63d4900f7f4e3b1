//! Kalman filter of gusts: the likelihood of their size and correlation time, and the innovations once they are in the noise.
//!
//! The whitened residual of forces and torques, as means over 0.1 s, is S w + v: S is the response to a steady wind of
//! 1 m/s at that moment, v is white, and w per axis a Gauss–Markov process, w' = −w/T + σ√(2/T) n.

/// Channels of the filter: F, then M.
pub(crate) const SEEN: usize = 6;

/// Length of a mean, s.
pub(crate) const MEAN_S: f64 = 0.1;

/// A mean over 0.1 s.
pub(crate) struct Mean {
    /// Samples that count, by channel.
    pub(crate) count: [f64; SEEN],
    /// What a wind of 1 m/s along each axis does.
    pub(crate) wind: [[f64; 3]; SEEN],
    /// Residual first, then further signals.
    pub(crate) signals: Vec<[f64; SEEN]>,
}

/// One log as means.
pub(crate) struct Log {
    pub(crate) means: Vec<Mean>,
    pub(crate) level: [f64; SEEN],
}

/// Outcome of a filter: ln likelihood, and the normalised innovations of every signal by mean and channel.
pub(crate) struct Filtered {
    pub(crate) log_likelihood: f64,
    pub(crate) innovations: Vec<Vec<[f64; SEEN]>>,
}

/// Kalman filter of the gusts over one log; all signals pass through the same gains, and the residual's gives the
/// likelihood.
pub(crate) fn filter(log: &Log, rms: f64, correlation_s: f64, keep: bool) -> Filtered {
    let signals = if keep {
        log.means.first().map_or(0, |m| m.signals.len())
    } else {
        1
    };
    // State: the wind's mean over the step, then its value at the end. Over a step of d = h/T the value decays to e^−d of itself, and
    // the mean is (1 − e^−d)/d of it; what the noise adds to both, per axis:
    let d = MEAN_S / correlation_s;
    let decay = libm::exp(-d);
    let gain = (1.0 - decay) / d;
    let square = rms * rms;
    let of_mean = square * (2.0 * d - 3.0 + 4.0 * decay - decay * decay) / (d * d);
    let of_both = square * (1.0 - decay) * (1.0 - decay) / d;
    let of_value = square * (1.0 - decay * decay);
    let mut p = [[0.0; 6]; 6];
    for i in 3..6 {
        p[i][i] = square;
    }
    let mut wind = vec![[0.0; 6]; signals];
    let mut filtered = Filtered {
        log_likelihood: 0.0,
        innovations: Vec::new(),
    };
    for mean in &log.means {
        for i in 0..3 {
            for j in 0..3 {
                let before = p[3 + i][3 + j];
                let same = if i == j { 1.0 } else { 0.0 };
                p[i][j] = gain * gain * before + same * of_mean;
                p[i][3 + j] = gain * decay * before + same * of_both;
                p[3 + j][i] = p[i][3 + j];
                p[3 + i][3 + j] = decay * decay * before + same * of_value;
            }
        }
        for w in &mut wind {
            for i in 0..3 {
                w[i] = gain * w[3 + i];
                w[3 + i] *= decay;
            }
        }
        let mut out = vec![[0.0; SEEN]; if keep { signals } else { 0 }];
        for c in 0..SEEN {
            if mean.count[c] == 0.0 {
                continue;
            }
            let h = mean.wind[c];
            let ph = p.map(|row| row[0] * h[0] + row[1] * h[1] + row[2] * h[2]);
            let variance = log.level[c] * log.level[c] / mean.count[c] + h[0] * ph[0] + h[1] * ph[1] + h[2] * ph[2];
            let root = variance.sqrt();
            for (s, w) in wind.iter_mut().enumerate() {
                let e = mean.signals[s][c] - h[0] * w[0] - h[1] * w[1] - h[2] * w[2];
                for (w, ph) in w.iter_mut().zip(&ph) {
                    *w += ph * e / variance;
                }
                if s == 0 {
                    filtered.log_likelihood -= 0.5 * (e * e / variance + variance.ln());
                }
                if keep {
                    out[s][c] = e / root;
                }
            }
            for (row, a) in p.iter_mut().zip(&ph) {
                for (value, b) in row.iter_mut().zip(&ph) {
                    *value -= a * b / variance;
                }
            }
        }
        if keep {
            filtered.innovations.push(out);
        }
    }
    filtered
}
