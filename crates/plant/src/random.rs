//! Random streams: one generator per noise, keyed by (run seed, stream name), so that no stream's numbers depend on another's use.
//!
//! A stream is ChaCha8 in counter mode with the key `seed ‖ name`; there is no shared generator to draw from in some order. Normals
//! come from a 256-layer ziggurat whose tables and rare branches use `libm`, so that the bits are those of every machine.
//! Not for cryptography: the seed is public.

use std::sync::LazyLock;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Longest stream name, bytes: the space in a ChaCha key in addition to the seed.
const MAX_NAME_BYTES: usize = 24;
/// Normals made at a time; a multiple of 3 so that vectors never straddle a refill.
const BATCH: usize = 96;
/// Layers of the ziggurat.
const LAYERS: usize = 256;
/// Where the tail begins, for 256 layers of equal area (Marsaglia and Tsang 2000, table 1).
const TAIL_START: f64 = 3.654_152_885_361_009;
/// Area of one layer of exp(−x²/2), same source.
const LAYER_AREA: f64 = 0.004_928_673_233_974_655;

struct Ziggurat {
    /// Right edge of each layer, falling from the pseudo-edge of layer 0 to 0.
    edge: [f64; LAYERS + 1],
    /// exp(−edge²/2).
    height: [f64; LAYERS + 1],
}

static ZIGGURAT: LazyLock<Ziggurat> = LazyLock::new(|| {
    let bell = |x: f64| libm::exp(-0.5 * x * x);
    let mut edge = [0.0; LAYERS + 1];
    edge[0] = LAYER_AREA / bell(TAIL_START);
    edge[1] = TAIL_START;
    for i in 2..LAYERS {
        edge[i] = (-2.0 * libm::log(LAYER_AREA / edge[i - 1] + bell(edge[i - 1]))).sqrt();
    }
    Ziggurat {
        edge,
        height: edge.map(bell),
    }
});

/// A named stream of random bits.
#[derive(Debug, Clone)]
pub struct RandomStream {
    generator: ChaCha8Rng,
}

impl RandomStream {
    /// The stream `name` of the run `seed`. Names longer than 24 bytes are a programming error and panic.
    pub fn new(seed: u64, name: &str) -> Self {
        assert!(
            name.len() <= MAX_NAME_BYTES,
            "stream name `{name}` is longer than {MAX_NAME_BYTES} bytes"
        );
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..8 + name.len()].copy_from_slice(name.as_bytes());
        Self {
            generator: ChaCha8Rng::from_seed(key),
        }
    }

    /// Uniform in \[0, 1), a multiple of 2⁻⁵³.
    pub fn unit(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in \[−1, 1).
    pub fn symmetric(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// One standard normal made of `bits`, drawing more bits only in the 1.2 % of cases outside the layer's rectangle.
    #[inline]
    fn normal_from(&mut self, zig: &Ziggurat, mut bits: u64) -> f64 {
        loop {
            // Low 8 bits choose the layer, the upper 53 the place in it, in [−1, 1).
            let layer = (bits & 0xff) as usize;
            let place = ((bits as i64) >> 11) as f64 * (1.0 / (1u64 << 52) as f64);
            let x = place * zig.edge[layer];
            if x.abs() < zig.edge[layer + 1] {
                return x;
            }
            if layer == 0 {
                return self.tail(place < 0.0);
            }
            let height = zig.height[layer] + (zig.height[layer + 1] - zig.height[layer]) * self.unit();
            if height < libm::exp(-0.5 * x * x) {
                return x;
            }
            bits = self.generator.next_u64();
        }
    }

    /// A normal beyond the last layer (Marsaglia 1964).
    #[cold]
    fn tail(&mut self, negative: bool) -> f64 {
        loop {
            // 1 − unit() lies in (0, 1], whose logarithm is finite.
            let x = -libm::log(1.0 - self.unit()) / TAIL_START;
            let y = -libm::log(1.0 - self.unit());
            if 2.0 * y >= x * x {
                let value = TAIL_START + x;
                return if negative { -value } else { value };
            }
        }
    }
}

/// A named stream of standard normals, made in batches.
#[derive(Debug, Clone)]
pub struct NormalStream {
    stream: RandomStream,
    ready: [f64; BATCH],
    next: usize,
}

impl NormalStream {
    /// The stream `name` of the run `seed`; see [`RandomStream::new`].
    pub fn new(seed: u64, name: &str) -> Self {
        Self {
            stream: RandomStream::new(seed, name),
            ready: [0.0; BATCH],
            next: BATCH,
        }
    }

    /// One standard normal.
    #[inline]
    pub fn sample(&mut self) -> f64 {
        if self.next >= BATCH {
            self.refill();
        }
        self.next += 1;
        self.ready[self.next - 1]
    }

    /// Three standard normals. A stream is read either by ones or by threes.
    #[inline]
    pub fn sample3(&mut self) -> [f64; 3] {
        if self.next + 3 > BATCH {
            self.refill();
        }
        let at = self.next;
        self.next += 3;
        [self.ready[at], self.ready[at + 1], self.ready[at + 2]]
    }

    #[cold]
    #[inline(never)]
    fn refill(&mut self) {
        let zig = &*ZIGGURAT;
        let mut bytes = [0; 8 * BATCH];
        self.stream.generator.fill_bytes(&mut bytes);
        let (words, _) = bytes.as_chunks::<8>();
        for (slot, word) in self.ready.iter_mut().zip(words) {
            *slot = self.stream.normal_from(zig, u64::from_le_bytes(*word));
        }
        self.next = 0;
    }
}
