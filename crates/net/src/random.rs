//! Counter-based random streams: the n-th draw of a stream is a hash of its key and n.
//!
//! A stream is keyed by a seed, a purpose and up to two indices (world, vehicle, step, …), so that draws of different purposes
//! never share a state: adding a draw in one place changes no draw in another, and neither thread count nor batch size
//! can reorder them. The mixing function is the finalizer of `SplitMix64` (Steele, Lea and Flood, 2014).

/// One stream of random numbers. The whole state is two integers, so a stream is saved by saving them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    key: u64,
    counter: u64,
}

/// Weyl increment of `SplitMix64`: 2⁶⁴ over the golden ratio, rounded to odd.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl Stream {
    /// The stream of `seed` for `purpose`, for example `"agent.explore"`.
    pub fn new(seed: u64, purpose: &str) -> Self {
        Self::keyed(seed, purpose, 0, 0)
    }

    /// The stream of `seed` for `purpose`, one for each pair of indices (for example world and vehicle).
    pub fn keyed(seed: u64, purpose: &str, first: u64, second: u64) -> Self {
        let mut key = mix(seed.wrapping_add(GOLDEN));
        for byte in purpose.bytes() {
            key = mix(key ^ u64::from(byte)).wrapping_add(GOLDEN);
        }
        key = mix(key ^ first).wrapping_add(GOLDEN);
        key = mix(key ^ second).wrapping_add(GOLDEN);
        Self { key, counter: 0 }
    }

    /// A stream whose state was saved as `(key, counter)` by [`Self::state`].
    pub fn from_state(key: u64, counter: u64) -> Self {
        Self { key, counter }
    }

    /// Key and counter: all there is to save.
    pub fn state(&self) -> (u64, u64) {
        (self.key, self.counter)
    }

    /// The next 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.counter = self.counter.wrapping_add(1);
        mix(self.key.wrapping_add(self.counter.wrapping_mul(GOLDEN)))
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³.
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform in [`low`, `high`).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform in 0..`n`. The bias of the multiplication (Lemire, 2019, without rejection) is below n/2⁶⁴.
    ///
    /// # Panics
    /// If `n` is 0.
    pub fn below(&mut self, n: usize) -> usize {
        assert!(n > 0, "nothing to choose from");
        ((u128::from(self.next_u64()) * n as u128) >> 64) as usize
    }

    /// True with probability `p`.
    pub fn bernoulli(&mut self, p: f64) -> bool {
        self.uniform() < p
    }

    /// Standard normal, by Box and Muller (1958); the second of the pair is dropped, so that each call takes two draws.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        radius * libm::cos(core::f64::consts::TAU * self.uniform())
    }
}

#[cfg(test)]
mod tests {
    use super::Stream;

    #[test]
    fn draws_are_uniform_in_mean_and_variance() {
        let mut stream = Stream::new(7, "test");
        let n = 100_000;
        let draws: Vec<f64> = (0..n).map(|_| stream.uniform()).collect();
        let mean = draws.iter().sum::<f64>() / f64::from(n);
        let variance = draws.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / f64::from(n);
        assert!((mean - 0.5).abs() < 4.0 * (1.0 / 12.0_f64 / f64::from(n)).sqrt());
        assert!((variance - 1.0 / 12.0).abs() < 1e-3);
    }

    #[test]
    fn normal_draws_have_unit_variance() {
        let mut stream = Stream::new(7, "normal");
        let n = 100_000;
        let draws: Vec<f64> = (0..n).map(|_| stream.normal()).collect();
        let mean = draws.iter().sum::<f64>() / f64::from(n);
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.02);
    }

    #[test]
    fn purposes_and_indices_give_unrelated_streams() {
        let first = |mut s: Stream| s.next_u64();
        let draws = [
            first(Stream::keyed(1, "a", 0, 0)),
            first(Stream::keyed(1, "b", 0, 0)),
            first(Stream::keyed(1, "a", 1, 0)),
            first(Stream::keyed(1, "a", 0, 1)),
            first(Stream::keyed(2, "a", 0, 0)),
        ];
        for (i, x) in draws.iter().enumerate() {
            assert!(draws[i + 1..].iter().all(|y| x != y));
        }
    }

    #[test]
    fn a_saved_stream_continues() {
        let mut stream = Stream::new(3, "save");
        stream.next_u64();
        let (key, counter) = stream.state();
        assert_eq!(Stream::from_state(key, counter).next_u64(), stream.next_u64());
    }
}
