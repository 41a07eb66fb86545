//! Draws by number: the n-th draw of a stream depends on the stream and on n alone. So a run has the same parameters in any shard, in
//! any thread and after any interruption.

/// A stream of draws: one for each parameter, by its name, so that another parameter beside it changes none of its values.
#[derive(Clone, Copy, Debug)]
pub struct Stream(u64);

impl Stream {
    /// The stream of a name under a seed.
    #[must_use]
    pub fn new(seed: u64, name: &str) -> Self {
        Self(mix(seed ^ digest([name.as_bytes()])))
    }

    /// The n-th draw, uniform in 0..1.
    #[must_use]
    pub fn uniform(self, n: u64) -> f64 {
        // 53 bits are exact.
        (self.word(n) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The n-th draw of a Latin hypercube of `of` draws: each of `of` equal strata of 0..1 has one, at a random place in it.
    #[must_use]
    pub fn stratum(self, n: u64, of: u64) -> f64 {
        ((self.permuted(n, of) as f64 + self.uniform(n)) / of as f64).min(1.0 - f64::EPSILON)
    }

    fn word(self, n: u64) -> u64 {
        mix(self.0 ^ mix(n))
    }

    /// The place of `n` in a random order of 0..`of`, without a table: a Feistel network permutes a power of 4, and what lies
    /// beyond `of` is permuted again until it lies within (cycle walking; Black and Rogaway, CT-RSA 2002).
    fn permuted(self, n: u64, of: u64) -> u64 {
        let half_bits = (64 - of.saturating_sub(1).leading_zeros()).div_ceil(2).max(1);
        let mask = (1u64 << half_bits) - 1;
        let mut at = n;
        loop {
            let (mut left, mut right) = (at >> half_bits, at & mask);
            for round in 1..=ROUNDS {
                // Not the words of `uniform`.
                let word = mix(self.0.wrapping_add(round) ^ mix(right.wrapping_mul(ODD)));
                (left, right) = (right, left ^ (word & mask));
            }
            at = left << half_bits | right;
            if at < of {
                return at;
            }
        }
    }
}

/// Four rounds are a strong permutation (Luby and Rackoff); two more for small domains.
const ROUNDS: u64 = 6;

/// 2^64 over the golden ratio, odd.
const ODD: u64 = 0x9E37_79B9_7F4A_7C15;

/// A bijection of 64 bits in which each bit of the input changes each of the output with a probability of a half: SplitMix64's
/// (Steele, Lea and Flood, OOPSLA 2014).
fn mix(word: u64) -> u64 {
    let mut z = word.wrapping_add(ODD);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// FNV-1a of texts and their lengths, 64 bits: tells sweeps apart, and protects against nothing.
pub fn digest<'a>(texts: impl IntoIterator<Item = &'a [u8]>) -> u64 {
    let add = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01B3);
    texts.into_iter().fold(0xCBF2_9CE4_8422_2325, |hash, text| {
        let hash = (text.len() as u64).to_le_bytes().iter().fold(hash, add);
        text.iter().fold(hash, add)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latin_draws_fill_each_stratum_once() {
        for of in [1, 2, 3, 7, 64, 65, 1000] {
            for seed in 0..5 {
                let stream = Stream::new(seed, "plant.j_kg_m2");
                let mut strata: Vec<u64> =
                    (0..of).map(|n| (stream.stratum(n, of) * of as f64) as u64).collect();
                if of == 1000 {
                    assert!(!strata.is_sorted(), "a random order");
                }
                strata.sort_unstable();
                assert_eq!(strata, (0..of).collect::<Vec<_>>(), "{of} of seed {seed}");
            }
        }
    }

    /// Bounds are five standard deviations of the mean of 10,000 uniform draws, and of their products' mean.
    #[test]
    fn draws_are_uniform_and_streams_independent() {
        let (a, b) = (Stream::new(1, "a"), Stream::new(1, "b"));
        let n = 10_000;
        let mean = |draw: &dyn Fn(u64) -> f64| (0..n).map(draw).sum::<f64>() / n as f64;
        let five = 5.0 / (n as f64).sqrt();
        assert!((mean(&|n| a.uniform(n)) - 0.5).abs() < five / 12f64.sqrt());
        let product = |n| (a.uniform(n) - 0.5) * (b.uniform(n) - 0.5);
        assert!(mean(&product).abs() < five / 12.0);
        let latin = |k| (a.stratum(k, n) - 0.5) * (b.stratum(k, n) - 0.5);
        assert!(mean(&latin).abs() < five / 12.0);
        let lagged = |n| (a.uniform(n) - 0.5) * (a.uniform(n + 1) - 0.5);
        assert!(mean(&lagged).abs() < five / 12.0);
    }

    #[test]
    fn draw_depends_on_seed_name_and_number_only() {
        let draw = |seed, name, n| Stream::new(seed, name).uniform(n);
        assert_eq!(draw(1, "set.KP", 7), draw(1, "set.KP", 7));
        for (seed, name, n) in [(2, "set.KP", 7), (1, "set.KI", 7), (1, "set.KP", 8)] {
            assert_ne!(draw(1, "set.KP", 7), draw(seed, name, n));
        }
    }

    #[test]
    fn digest_tells_texts_and_their_borders_apart() {
        let of = |texts: &[&str]| digest(texts.iter().map(|text| text.as_bytes()));
        assert_ne!(of(&["ab", "c"]), of(&["a", "bc"]));
        assert_ne!(of(&["ab"]), of(&["ab", ""]));
        assert_eq!(of(&["ab", "c"]), of(&["ab", "c"]));
    }
}
