//! Random streams of the generator: xoshiro256++ (Blackman and Vigna 2019) keyed by seed and stream name, normals by Marsaglia's
//! polar method. Another generator, another seeding and another normal than the plant's, so that no stream can coincide.

/// A named stream.
#[derive(Debug, Clone)]
pub struct Stream {
    state: [u64; 4],
    spare: Option<f64>,
}

fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Stream {
    /// The stream `name` of the flight `seed`.
    pub fn new(seed: u64, name: &str) -> Self {
        // FNV-1a of the name, folded into the seed's SplitMix chain.
        let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        let mut chain = seed ^ 0x0b11_d5ee_d000_0001;
        let mut mixed = split_mix(&mut chain) ^ hash;
        Self {
            state: std::array::from_fn(|_| split_mix(&mut mixed)),
            spare: None,
        }
    }

    fn next(&mut self) -> u64 {
        let s = &mut self.state;
        let result = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        result
    }

    /// Uniform in \[0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform between two bounds.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A whole number below `count`; `count` at least 1.
    pub fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// +1 or −1.
    pub fn sign(&mut self) -> f64 {
        if self.next() >> 63 == 0 { 1.0 } else { -1.0 }
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let (a, b) = (2.0 * self.unit() - 1.0, 2.0 * self.unit() - 1.0);
            let square = a * a + b * b;
            if square > 0.0 && square < 1.0 {
                let factor = (-2.0 * libm::log(square) / square).sqrt();
                self.spare = Some(b * factor);
                return a * factor;
            }
        }
    }

    /// Three standard normals.
    pub fn normal3(&mut self) -> nalgebra::Vector3<f64> {
        let x = self.normal();
        let y = self.normal();
        nalgebra::Vector3::new(x, y, self.normal())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_normals_have_mean_0_and_variance_1() {
        let mut stream = Stream::new(7, "test");
        let n = 200_000;
        let (mut sum, mut square) = (0.0, 0.0);
        for _ in 0..n {
            let x = stream.normal();
            sum += x;
            square += x * x;
        }
        // Five standard errors of mean and variance.
        assert!((sum / f64::from(n)).abs() < 5.0 / f64::from(n).sqrt());
        assert!((square / f64::from(n) - 1.0).abs() < 5.0 * (2.0 / f64::from(n)).sqrt());
    }

    #[test]
    fn prop_streams_of_other_names_and_seeds_differ() {
        let first = |seed, name| Stream::new(seed, name).unit();
        assert_ne!(first(1, "a").to_bits(), first(1, "b").to_bits());
        assert_ne!(first(1, "a").to_bits(), first(2, "a").to_bits());
        assert_eq!(first(1, "a").to_bits(), first(1, "a").to_bits());
    }
}
