//! A seeded sample of the mutants, and what its score says about all of them.

/// 95 % of a normal distribution lie within so many standard deviations.
const Z: f64 = 1.96;

/// Names of the sample: those with the smallest hashes of seed and name, so that a mutant more or less leaves the others in it.
pub fn choose<'a>(names: impl Iterator<Item = &'a str>, size: usize, seed: u64) -> Vec<&'a str> {
    let mut names: Vec<(u64, &str)> = names.map(|name| (hash(seed, name), name)).collect();
    names.sort_unstable();
    names.into_iter().take(size).map(|(_, name)| name).collect()
}

/// FNV-1a over seed and name, then the finalizer of `SplitMix64`: FNV's high bits hardly depend on the last bytes.
fn hash(seed: u64, name: &str) -> u64 {
    let bytes = seed.to_le_bytes().into_iter().chain(name.bytes());
    let sum = bytes
        .fold(0xCBF2_9CE4_8422_2325_u64, |sum, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3));
    let sum = (sum ^ sum >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let sum = (sum ^ sum >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    sum ^ sum >> 31
}

/// The regular expression of exactly this name.
pub fn exactly(name: &str) -> String {
    let mut pattern = String::from("^");
    for character in name.chars() {
        // Not every sign: `\<` is the beginning of a word.
        if r"\.+*?()|[]{}^$".contains(character) {
            pattern.push('\\');
        }
        pattern.push(character);
    }
    pattern + "$"
}

/// Wilson's 95 % interval of a share, in percent, for `hits` of `tries`.
///
/// With p = hits / n: centre (p + z²/2n) / (1 + z²/n), half width z √(p(1 − p)/n + z²/4n²) / (1 + z²/n).
pub fn interval(hits: u32, tries: u32) -> (f64, f64) {
    if tries == 0 {
        return (0.0, 100.0);
    }
    let n = f64::from(tries);
    let (p, square) = (f64::from(hits) / n, Z * Z);
    let centre = p + square / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + square / (4.0 * n * n)).sqrt();
    let scale = 100.0 / (1.0 + square / n);
    (((centre - half) * scale).max(0.0), ((centre + half) * scale).min(100.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sample_depends_on_seed_and_names_alone() {
        let names: Vec<String> = (0..1000).map(|n| format!("a.rs:{n}:1: replace + with -")).collect();
        let all = || names.iter().map(String::as_str);
        let sample = choose(all(), 100, 7);
        assert_eq!(sample, choose(all().rev(), 100, 7));
        assert_ne!(sample, choose(all(), 100, 8));
        // Each tenth of the names has its share: 10 ± 9 (three standard deviations).
        for tenth in names.chunks(100) {
            let share = sample.iter().filter(|name| tenth.iter().any(|other| other == **name)).count();
            assert!((1..=19).contains(&share), "{share} of 100");
        }
        // Without the first name the sample loses that one at most.
        let fewer = choose(all().skip(1), 100, 7);
        assert!(sample.iter().filter(|name| !fewer.contains(name)).count() <= 1);
        assert_eq!(choose(all(), 2000, 7).len(), 1000);
    }

    #[test]
    fn pattern_escapes_operators() {
        assert_eq!(
            exactly("a.rs:1:2: replace <A as B>::f -> (u8, [u8; 2]) with |"),
            r"^a\.rs:1:2: replace <A as B>::f -> \(u8, \[u8; 2\]\) with \|$"
        );
    }

    #[test]
    fn interval_is_that_of_wilson() {
        // Newcombe, Statistics in Medicine 17 (1998), table I, method 3: 81 of 263, 0 of 20.
        let rounded = |(low, high): (f64, f64)| ((low * 100.0).round() / 1e4, (high * 100.0).round() / 1e4);
        assert_eq!(rounded(interval(81, 263)), (0.2553, 0.3662));
        assert_eq!(rounded(interval(0, 20)), (0.0, 0.1611));
        assert_eq!(interval(0, 0), (0.0, 100.0));
        assert!((interval(500, 500).1 - 100.0).abs() < 1e-9);
    }
}
