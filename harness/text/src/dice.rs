//! What is drawn by lot: every random thing of a scenario, from its seed.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::Range;

/// Draws by lot. What is drawn for a place depends on the seed and on nothing else, so that a scenario with fewer
/// faults draws the same for those that are left.
#[derive(Clone, Debug)]
pub struct Dice {
    seed: u64,
    drawn: Vec<(String, String)>,
}

impl Dice {
    /// Dice of this seed.
    pub const fn new(seed: u64) -> Self {
        Self { seed, drawn: Vec::new() }
    }

    /// A seed of its own for what is at a place.
    pub fn seed(&self, place: &str) -> u64 {
        xxh3_64_with_seed(place.as_bytes(), self.seed)
    }

    /// A value from a range, each as likely as any other, as a file would have it.
    pub fn draw(&mut self, place: &str, range: &Range) -> String {
        let fraction = (ChaCha8Rng::seed_from_u64(self.seed(place)).next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let value = range.draw(fraction);
        self.drawn.push((place.to_owned(), value.clone()));
        value
    }

    /// What has been drawn, and for which place.
    pub fn into_drawn(self) -> Vec<(String, String)> {
        self.drawn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(seed: u64, place: &str, range: &str) -> String {
        Dice::new(seed).draw(place, &Range::parse(range).unwrap().unwrap())
    }

    #[test]
    fn a_place_gets_the_same_for_a_seed() {
        assert_eq!(drawn(1, "a.at", "1 s..3 s"), drawn(1, "a.at", "1 s..3 s"));
        assert_ne!(drawn(1, "a.at", "1 s..3 s"), drawn(2, "a.at", "1 s..3 s"));
        assert_ne!(drawn(1, "a.at", "1 s..3 s"), drawn(1, "b.at", "1 s..3 s"));
        let dice: Vec<String> = (0..200).map(|seed| drawn(seed, "a", "1..6")).collect();
        assert!(["1", "2", "3", "4", "5", "6"].iter().all(|side| dice.iter().any(|drawn| drawn == side)));
        assert!(dice.iter().all(|drawn| ("1"..="6").contains(&drawn.as_str())));
    }
}
